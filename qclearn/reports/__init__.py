"""HTML pages on finished registrations: one of a pair, and one of a group with a table."""

import lazy_loader as lazy

TABLE = {"group": ["write_group"], "pair": ["write_pair"]}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
