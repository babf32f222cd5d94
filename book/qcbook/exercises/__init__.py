"""Graded exercises: what students are asked, how an answer is checked, and how a folder of notebooks is graded."""

from qclearn.lazy import offer

TABLE = {
    "exercise": ["EXERCISES", "check"],
    "handedin": ["UNANSWERED"],
    "grading": ["GradingError", "Limits", "feedback", "found_in", "grade", "is_isolated", "table", "to_read"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
