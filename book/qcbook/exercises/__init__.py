"""Graded exercises: what students are asked, and how an answer is checked."""

import lazy_loader as lazy

TABLE = {"exercise": ["EXERCISES", "check"]}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
