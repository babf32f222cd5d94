"""The notebooks of a course, below build/course: student/ has blanks and checks, teacher/ solutions, points and known
mistakes, and nbgrader/ is what nbgrader releases and grades.

`make course` takes all graded exercises in the order of the book, and those of each week of the guide for teachers;
named ones make a sheet of their own:

    python tools/course.py --name week3 alpha-signs accept-fold
"""

import argparse
import re
import sys

import nbformat
import references
import teaching
from execute_pages import ROOT
from graded import EXERCISES, IMPORTS, call, words
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from qclearn.exercises import UNANSWERED

COURSE = ROOT / "build" / "course"
READERS = "student", "teacher", "nbgrader"
KERNEL = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
# References to the book, which all have words of their own: {prf:ref}`words <label>`, [words](#label).
REFERENCE = re.compile(r"\{prf:ref\}`([^`<]+?)\s*<[^`]+`|\[([^\]]+)\]\(#?[\w.:-]+\)")
INTRODUCTION = """# Exercises

Fill in the blanks. `check` says whether an answer is right, as often as you like. Answers are graded with other
numbers than those of `check`. Keep the names of the functions, and hand in this notebook under your own name."""
FOR_TEACHERS = """# Exercises, for teachers

Not for students. `qclearn grade FOLDER --out grades.csv` grades the notebooks that were handed in."""


def in_order():
    """The names of all exercises, by their page in the contents."""
    pages = list(references.chapters())
    return sorted(EXERCISES, key=lambda name: (pages.index(EXERCISES[name].page), name))


def in_words(source):
    """What a text refers to in the book, in words alone."""
    return REFERENCE.sub(lambda match: f"*{match[1] or match[2]}*", source)


class Sheets:
    """Makes the notebooks; what the text refers to in the book is said in words."""

    def question(self, exercise):
        told = f"{exercise.points} points, about {exercise.minutes} minutes; page *{teaching.title(exercise.page)}*."
        return markdown(exercise, "question", f"## {exercise.title}\n\n{told}\n\n{in_words(words(exercise))}")

    def notebook(self, names, reader="student"):
        """For one of READERS: with blanks; with solutions, points and mistakes; with marks that nbgrader takes out."""
        teacher, graded = reader == "teacher", reader == "nbgrader"
        intro = f"{FOR_TEACHERS}\n\n{overview(names)}" if teacher else INTRODUCTION
        cells = [new_markdown_cell(intro, id="introduction", metadata={"tags": ["introduction"]})]
        cells.append(new_code_cell(IMPORTS, id="imports"))
        for exercise in map(EXERCISES.get, names):
            answer = exercise.solved if teacher else exercise.source if graded else exercise.blank
            checked = hidden(exercise) if graded else call(exercise)
            cells += [
                self.question(exercise),
                code(exercise, "answer", answer, solution=True),
                code(exercise, "check", checked, grade=True, locked=True, points=exercise.points),
            ]
            if exercise.read:
                kind = {"grade": True, "solution": True, "points": 0, "cell_type": "markdown"}
                cells.append(markdown(exercise, "sentence", UNANSWERED, **kind))
            if teacher:
                cells.append(markdown(exercise, "mistakes", in_words(mistakes(exercise))))
        return new_notebook(cells=cells, metadata=KERNEL)


def hidden(exercise):
    """The check of nbgrader's source: it hides what raises where the answer is not right."""
    raising = f'EXERCISES["{exercise.name}"].check({exercise.asks_for}, seed=1)'
    tests = f"from qclearn.exercises import EXERCISES\n\n{raising}"
    return f"{call(exercise)}\n### BEGIN HIDDEN TESTS\n{tests}\n### END HIDDEN TESTS"


def row(*cells):
    return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |\n"


def overview(names):
    """A table of the exercises with their points, in all at its end."""
    chosen = [EXERCISES[name] for name in names]
    text = row("exercise", "page", "minutes", "points", "to read") + row(*["---"] * 5)
    text += "".join(row(e.name, e.page, e.minutes, e.points, "a sentence" if e.read else "") for e in chosen)
    return text + row("in all", "", *(sum(getattr(e, what) for e in chosen) for what in ("minutes", "points")), "")


def mistakes(exercise):
    """A table of the known mistakes and of what a student is told."""
    return (
        row("mistake", "what a student is told")
        + row("---", "---")
        + "".join(row(name, sentence) for name, sentence in exercise.sentences.items())
    )


def metadata(exercise, part, nbgrader):
    """What a cell is, for `qclearn grade` and, where something is graded or filled in, for nbgrader (schema 3)."""
    found = {"tags": [part], "exercise": exercise.name}
    if nbgrader:
        usual = {"grade": False, "solution": False, "locked": False, "task": False, "cell_type": "code"}
        found["nbgrader"] = usual | {"schema_version": 3, "grade_id": f"{exercise.name}-{part}"} | nbgrader
    return found


def code(exercise, part, source, **nbgrader):
    meta = metadata(exercise, part, nbgrader)
    return new_code_cell(source.rstrip(), id=f"{exercise.name}-{part}", metadata=meta)


def markdown(exercise, part, source, **nbgrader):
    meta = metadata(exercise, part, nbgrader)
    return new_markdown_cell(source.rstrip(), id=f"{exercise.name}-{part}", metadata=meta)


def write(names, name, folder=COURSE, sheets=None):
    """Write the notebooks of a sheet below a folder, one for each of READERS; returns the paths."""
    sheets, paths = sheets or Sheets(), []
    for reader in READERS:
        notebook = sheets.notebook(names, reader)
        nbformat.validate(notebook)
        (folder / reader).mkdir(parents=True, exist_ok=True)
        paths.append(folder / reader / f"{name}.ipynb")
        nbformat.write(notebook, paths[-1])
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("exercises", nargs="*", help="names, in order; all, and each week's, where none is given")
    parser.add_argument("--name", default="exercises", help="of the notebooks")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.exercises if name not in EXERCISES]:
        sys.exit(f"course: no such exercise: {', '.join(unknown)}; there are {', '.join(in_order())}")
    chosen, sheets = {arguments.name: arguments.exercises or in_order()}, Sheets()
    if not arguments.exercises:
        chosen |= {f"week{number}": names for number, (_, _, names) in enumerate(teaching.weeks(), 1)}
    for path in (path for name, names in chosen.items() for path in write(names, name, sheets=sheets)):
        print(f"course: {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
