"""What the pages of the book and the command line draw with: plots, scenes, widgets, and numbers for the prose."""

__all__ = ["keep", "num", "show_figure", "table"]


def __getattr__(name):
    if name not in (*__all__, "kept_by"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import cells  # here: needs IPython, which the command line's figure does without

    return getattr(cells, name)
