"""What a template's rounds leave in a folder: a file for each subject and round."""

import io
import json

import numpy as np

from ..files.begun import Begun
from ..files.safe import npz_arrays
from .subject import Fitted


class TemplateError(ValueError):
    """A group that no template can be made of, or a folder that is not this group's: says what and what to do."""


class Folder:
    """The registrations of finished rounds, by round and subject's key; path, settings: those of `Begun`."""

    def __init__(self, path, settings):
        self.begun = Begun(path, settings, TemplateError)

    def read(self, number, key):
        """The `Fitted` of a subject in a round, or None where none is kept or its file is damaged: it is made again."""
        try:
            arrays = npz_arrays(self.begun.read(name_of(number, key)), lambda name: True)
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
        self.begun.keep(name_of(number, key), data.getvalue())


def name_of(number, key):
    """The file of a round and a subject."""
    return f"round-{number}-{key}.npz"
