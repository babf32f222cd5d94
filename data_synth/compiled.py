"""Compilation of the inner loops by numba: kept on disk where there is a place for it, in memory
elsewhere."""

from numba import njit


def compiled(function):
    """The function compiled at its first call, without the interpreter's lock; the same result on
    every run."""
    try:
        return njit(cache=True, nogil=True)(function)
    except (
        RuntimeError
    ):  # numba found no writable folder for its cache, as in a read-only installation
        return njit(nogil=True)(function)
