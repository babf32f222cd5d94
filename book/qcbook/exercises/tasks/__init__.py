"""The graded exercises, one file each; `book/qcbook/exercises/exercise.py` says what such a file
holds."""

import numpy as np


class Misfit(Exception):
    """Words on an answer that has not the form that is asked for."""


def shaped(said, shape):
    """What an answer returns as an array, which has to have this shape."""
    said = np.asarray(said)
    if said.shape != shape:
        raise Misfit(f"an array of shape {shape} is asked for, and it returns {said.shape or 'no array'}")
    return said


def parts(said, count, words):
    """What an answer returns as so many parts, which have to stand in a tuple, a list or an array."""
    fits = isinstance(said, (tuple, list)) or (isinstance(said, np.ndarray) and said.ndim)
    if not fits or len(said) != count:
        raise Misfit(f"{count} things are asked for, in a tuple or an array: {words}")
    return said
