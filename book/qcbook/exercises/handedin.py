"""A notebook that was handed in: its code, the exercises that it names, and what it says to the teacher.

Students rename and merge cells, write where they like, and save with programs that drop metadata: what they did counts
wherever it stands. Nothing that a file holds may stop the grading of the others.
"""

import json
import os
import re
from dataclasses import dataclass
from functools import cached_property

from .exercise import EXERCISES

UNANSWERED = "*Your answer here.*"
_LARGEST = 100_000_000  # bytes of a notebook
_NO_ANSWER = re.compile(rf"{re.escape(UNANSWERED)}|YOUR ANSWER HERE")  # the second is nbgrader's
_UNFIT = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")  # control characters, halves of characters
_CHECK = re.compile(r"""^([ \t]*)check\((["'])[\w-]+\2[^;\n]*\)[ \t]*(?:#.*)?$""", re.MULTILINE)
_SUSPECT = re.compile(r"\bEXERCISES\b|exercises(?:\.| import )tasks|\.solution\b|_getframe|f_locals|sys\.modules")
_TITLES = {f"## {exercise.title}": name for name, exercise in EXERCISES.items()}


def clean(text):
    """A text that every file, csv and terminal takes."""
    return _UNFIT.sub("\ufffd", text.replace("\r\n", "\n"))


@dataclass(frozen=True)
class Cell:
    """A cell as the format has it; exercise: the one that its metadata name, pictures: how many are attached."""

    kind: str
    source: str
    tags: frozenset
    exercise: str
    pictures: int

    @property
    def begins(self):
        """The exercise whose question this is, known by its metadata or, where they are lost, by its heading."""
        return self.exercise if "question" in self.tags else _TITLES.get(self.source.partition("\n")[0].strip())

    @property
    def words(self):
        text = _NO_ANSWER.sub("", self.source).strip()
        many = f"{self.pictures} picture{'s' * (self.pictures > 1)}"
        return clean(text + f"\n\n(has {many}: open the notebook)" * bool(self.pictures)).strip()


@dataclass(frozen=True)
class HandedIn:
    """A student's notebook; unread: why the file is none, in words for its student."""

    student: str
    cells: tuple = ()
    unread: str = ""

    @property
    def names(self):
        """The exercises that the cells name, in their order."""
        found = (name for cell in self.cells for name in (cell.exercise, cell.begins))
        return [name for name in dict.fromkeys(found) if name in EXERCISES]

    @property
    def code(self):
        """The code cells without the student's own checks, which cost time and decide nothing."""
        return [_CHECK.sub(r"\1pass", cell.source) for cell in self.cells if cell.kind == "code"]

    @cached_property
    def written(self):
        """exercise -> what a student wrote for the teacher: in the cell for it, and in own cells below the question."""
        found, below = {}, ""
        for cell in self.cells:
            below = cell.begins or below
            own = cell.kind == "markdown" and not (cell.tags or cell.exercise or cell.begins)
            name = cell.exercise if "sentence" in cell.tags else below if own else ""
            if name in EXERCISES and EXERCISES[name].read and cell.words:
                found.setdefault(name, []).append(cell.words)
        return {name: "\n\n".join(found[name]) for name in EXERCISES if name in found}

    @property
    def look_at(self):
        """What a teacher should see for himself: words of the code by which a check can be deceived, lost metadata."""
        words = sorted({word for source in self.code for word in _SUSPECT.findall(source)})
        lost = self.cells and not any(cell.exercise for cell in self.cells)
        return ", ".join([*words, *["the cells have lost their metadata"] * bool(lost)])


def read(path):
    """The `HandedIn` of a file."""
    student = clean(os.fsencode(path.stem).decode("utf-8", "replace"))
    try:
        if path.stat().st_size > _LARGEST:
            return HandedIn(student, unread=f"the file has more than {_LARGEST // 10**6} MB: clear its outputs")
        notebook = json.loads(path.read_text(encoding="utf-8-sig"))
        if "worksheets" in notebook:
            return HandedIn(
                student, unread="the file has an old format (nbformat 3): open it in Jupyter and save it anew"
            )
        return HandedIn(student, tuple(map(_cell, notebook["cells"])))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return HandedIn(student, unread="the file is not a notebook")


def _cell(cell):
    tags, exercise = (cell["metadata"].get(key) for key in ("tags", "exercise"))
    tags = frozenset(tag for tag in tags if isinstance(tag, str)) if isinstance(tags, list) else frozenset()
    named = exercise if isinstance(exercise, str) else ""
    return Cell(cell["cell_type"], "".join(cell["source"]), tags, named, len(cell.get("attachments") or ()))
