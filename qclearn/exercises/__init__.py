"""Graded exercises: what students are asked, and how an answer is checked."""

from ..lazy import offer

TABLE = {"exercise": ["EXERCISES", "check"]}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
