"""HTML pages on finished registrations: one of a pair, and one of a group with a table."""

from ..lazy import offer

TABLE = {
    "group": ["write_group"],
    "pair": ["write_pair"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
