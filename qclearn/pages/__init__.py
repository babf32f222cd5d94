"""What the pages of the book and the command line draw with: plots, scenes, explorables, and numbers for the prose."""

from importlib import import_module

EXPLORABLES = ("Mobius", "Mu", "Tuner", "Sulci", "Landmarks", "LBS", "Boundary", "Growth")
CELLS = ("keep", "kept", "kept_by", "num", "show_figure", "table")
# What is offered here -> its module, loaded when it is asked for: the command line's figure does without IPython.
_HOMES = {
    **dict.fromkeys(CELLS, "cells"),
    "explorable": "live",
    **{name: f"explore_{name.lower()}" for name in EXPLORABLES},
}
__all__ = sorted(_HOMES.keys() - {"kept_by"})


def __getattr__(name):
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)
