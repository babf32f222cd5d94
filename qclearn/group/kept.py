"""The folder of a template's rounds: a file for each subject and round."""

import io
import json

import numpy as np

from ..io.checkpoint import Checkpoint
from ..io.safe import npz_arrays
from .subject import Fitted

NAME = "round-{}-{}.npz"  # of a round's number and a subject's key


class TemplateError(ValueError):
    """No template can be made of a group, or a folder is not this group's: says why and what to do."""


class Folder:
    """The registrations of finished rounds, by round and subject's key; path, settings: those of
    `Checkpoint`."""

    def __init__(self, path, settings):
        self.checkpoint = Checkpoint(path, settings, TemplateError)

    def read(self, number, key):
        """The `Fitted` of a subject in a round; None where none is kept or its file is damaged."""
        try:
            arrays = npz_arrays(self.checkpoint.read(NAME.format(number, key)), lambda name: True)
            told = json.loads(str(arrays["told"]))
            return Fitted(arrays["f"] if arrays["f"].size else None, **told)
        except Exception:
            return None

    def keep(self, number, key, found):
        """Write a `Fitted`, whole or not at all."""
        told = {name: getattr(found, name) for name in ("reasons", "words", "r")}
        data = io.BytesIO()
        f = np.zeros(0, complex) if found.f is None else found.f
        np.savez(data, f=f, told=np.array(json.dumps(told)))
        self.checkpoint.write(NAME.format(number, key), data.getvalue())
