"""Graded exercises on the pages: a page names one, as `place` writes it, and every reader of the
page gets its question in place of that, made of the same file as the students' notebook; the build
gets its solution, too."""

import re

from qcbook.exercises import EXERCISES


def places(head):
    """The pattern of what stands in a page's source where the build puts something by name: its
    head, and a line."""
    return re.compile(rf"^:::\{{admonition\}} {head} ([\w-]+)[ \t]*\n[^\n]*\n:::[ \t]*$", re.MULTILINE)


PLACE = places("Graded exercise")
IMPORTS = "import numpy as np\n\nimport qclearn as qc\nfrom qcbook.exercises import check"


def place(name):
    """What a page's source says where a question is to stand; JupyterLab shows it as it is."""
    return f":::{{admonition}} Graded exercise {name}\nIn the book and its copies the question stands here.\n:::"


def label(exercise):
    return f"ex-{exercise.name}"


def call(exercise):
    return f'check("{exercise.name}", {exercise.asks_for})'


def words(exercise):
    """What is asked, MyST text without the blank."""
    return exercise.words + (f"\n\nIn words, for your teacher: {exercise.read}" if exercise.read else "")


def question(exercise):
    """An {exercise} with words and blank."""
    return f""":::{{exercise}} {exercise.title}
:label: {label(exercise)}
:class: graded

*Graded: {exercise.points} points, about {exercise.minutes} minutes.* {words(exercise)}

```python
{exercise.blank.rstrip()}
```

After `from qcbook.exercises import check`, the call `{call(exercise)}` says whether it is right.

:::"""


def solution(exercise):
    """The {solution}, with what its check prints."""
    return f""":::{{solution}} {label(exercise)}
:class: dropdown

```python
{IMPORTS}

{exercise.solved.rstrip()}


{call(exercise)}
```

```text
✓ {exercise.name}: right, {exercise.points} points.
```

:::"""


def put(text, with_solutions=False):
    """A page's text with the questions of the graded exercises that it names; KeyError for one that
    is not there."""

    def text_of(match):
        if match[1] not in EXERCISES:
            raise KeyError(
                f"there is no graded exercise {match[1]!r}; book/qcbook/exercises/tasks has {', '.join(EXERCISES)}"
            )
        exercise = EXERCISES[match[1]]
        return question(exercise) + (f"\n\n{solution(exercise)}" if with_solutions else "")

    return PLACE.sub(text_of, text)


def labels():
    """The labels of all graded exercises."""
    return {label(exercise) for exercise in EXERCISES.values()}
