"""What is read of finished registrations: a page for one pair, a page and a table for a group, each one file."""

from ..lazy import offer

TABLE = {
    "group": ["write_group"],
    "pair": ["write_pair"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
