"""Graded exercises: what students are asked, how an answer is checked, and how a folder of notebooks is graded."""

import lazy_loader as lazy

TABLE = {
    "exercise": ["EXERCISES", "check"],
    "handedin": ["UNANSWERED"],
    "grading": ["GradingError", "Limits", "feedback", "found_in", "grade", "is_isolated", "table", "to_read"],
}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
