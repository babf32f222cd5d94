"""The HTML page on a finished registration."""

import lazy_loader as lazy

TABLE = {"pair": ["write_pair"]}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
