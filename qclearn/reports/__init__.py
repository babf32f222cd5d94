"""What is read of finished registrations: a page for one pair, a page and a table for a group, each one file."""

import lazy_loader as lazy

TABLE = {
    "group": ["write_group"],
    "pair": ["write_pair"],
}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
