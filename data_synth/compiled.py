"""Compilation of the inner loops by numba, cached on disk where that is possible."""

from numba import njit


def compiled(function):
    """The function compiled at its first call, without the interpreter's lock; deterministic."""
    try:
        return njit(cache=True, nogil=True)(function)
    except RuntimeError:  # no writable folder for numba's cache, as in a read-only installation
        return njit(nogil=True)(function)
