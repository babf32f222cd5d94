"""The HTML page on a finished registration."""

from ..interrupts import attach

TABLE = {"pair": "write_pair"}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
