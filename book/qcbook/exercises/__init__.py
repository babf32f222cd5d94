"""Graded exercises: what students are asked, and how an answer is checked."""

from qclearn.interrupts import attach

TABLE = {"exercise": "EXERCISES check"}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
