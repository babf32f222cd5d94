"""A course folder for nbgrader, build/course: source/ and release/ have an assignment each,
teacher/ the solutions with points and known mistakes.

`make course` takes all graded exercises in the order of the book, and those of each week of the
guide for teachers; named ones make an assignment of their own:

    python -m book.builder.course --name week3 alpha-signs accept-fold
"""

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from . import references, teaching
from .execute_pages import ROOT
from .graded import EXERCISES, IMPORTS, call, words

COURSE = ROOT / "build" / "course"
SETTINGS = Path(__file__).with_name("nbgrader_config.py")
KERNEL = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
# References to the book, which all have words of their own: {prf:ref}`words <label>`,
# [words](#label).
REFERENCE = re.compile(r"\{prf:ref\}`([^`<]+?)\s*<[^`]+`|\[([^\]]+)\]\(#?[\w.:-]+\)")
INTRODUCTION = """# Exercises

Fill in the blanks. `check` says whether an answer is right, as often as you like. Answers are graded with other
numbers than those of `check`. Keep the cells and the names of the functions, run all cells once more in a fresh kernel,
and hand in this notebook under your own name."""
FOR_TEACHERS = """# Exercises, for teachers

Not for students. nbgrader grades the notebooks that they hand in: see the guide for teachers."""


def in_order():
    """The names of all exercises, by their page in the contents."""
    pages = list(references.chapters())
    return sorted(EXERCISES, key=lambda name: (pages.index(EXERCISES[name].page), name))


def in_words(source):
    """What a text refers to in the book, in words alone."""
    return REFERENCE.sub(lambda match: f"*{match[1] or match[2]}*", source)


def question(exercise):
    terms = f"{exercise.points} points, about {exercise.minutes} minutes; page *{teaching.title(exercise.page)}*."
    return markdown(exercise, "question", f"## {exercise.title}\n\n{terms}\n\n{in_words(words(exercise))}")


def source_notebook(names, seed=1):
    """What nbgrader releases and grades: it takes the solutions and the hidden tests out
    between their marks."""
    cells = [new_markdown_cell(INTRODUCTION, id="introduction", metadata={"tags": ["introduction"]}), imports()]
    for exercise in map(EXERCISES.get, names):
        cells.append(question(exercise))
        cells.append(code(exercise, "answer", exercise.source, solution=True))
        test = hidden_test(exercise, seed)
        cells.append(code(exercise, "check", test, grade=True, locked=True, points=exercise.points))
        if exercise.read:
            kind = {"grade": True, "solution": True, "points": 0, "cell_type": "markdown"}
            cells.append(markdown(exercise, "sentence", "", **kind))
    return new_notebook(cells=cells, metadata=KERNEL)


def teacher_notebook(names):
    """The solutions, each with its check and the known mistakes, below a table of points."""
    cells = [new_markdown_cell(f"{FOR_TEACHERS}\n\n{overview(names)}", id="introduction"), imports()]
    for exercise in map(EXERCISES.get, names):
        cells.append(question(exercise))
        cells.append(code(exercise, "answer", exercise.solved))
        cells.append(code(exercise, "check", call(exercise)))
        cells.append(markdown(exercise, "mistakes", in_words(mistakes(exercise))))
    return new_notebook(cells=cells, metadata=KERNEL)


def imports():
    return new_code_cell(IMPORTS, id="imports")


def hidden_test(exercise, seed):
    """The check that students see, and what nbgrader hides: it raises the sentence on a wrong
    answer, for the feedback.

    seed: draws its inputs; the students' own check has 0.
    """
    return f"""{call(exercise)}
### BEGIN HIDDEN TESTS
from qcbook.exercises import EXERCISES

try:
    EXERCISES["{exercise.name}"].check({exercise.asks_for}, seed={seed})
except AssertionError as error:
    raise AssertionError(str(error)) from None  # the sentence, without the library's lines
### END HIDDEN TESTS"""


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
    """What a cell is and, where something is graded or filled in, what nbgrader has to know (schema
    3)."""
    entries = {"tags": [part], "exercise": exercise.name}
    if nbgrader:
        usual = {"grade": False, "solution": False, "locked": False, "task": False, "cell_type": "code"}
        entries["nbgrader"] = usual | {"schema_version": 3, "grade_id": f"{exercise.name}-{part}"} | nbgrader
    return entries


def code(exercise, part, source, **nbgrader):
    meta = metadata(exercise, part, nbgrader)
    return new_code_cell(source.rstrip(), id=f"{exercise.name}-{part}", metadata=meta)


def markdown(exercise, part, source, **nbgrader):
    meta = metadata(exercise, part, nbgrader)
    return new_markdown_cell(source.rstrip(), id=f"{exercise.name}-{part}", metadata=meta)


def write(names, name, folder=COURSE, seed=1):
    """Write an assignment of these exercises into a course folder; (source, teacher's notebook),
    paths."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(SETTINGS, folder)
    source = folder / "source" / name / f"{name}.ipynb"
    teacher = folder / "teacher" / f"{name}.ipynb"
    for path, notebook in ((source, source_notebook(names, seed)), (teacher, teacher_notebook(names))):
        nbformat.validate(notebook)
        path.parent.mkdir(parents=True, exist_ok=True)
        nbformat.write(notebook, path)
    (folder / "downloaded" / name / "archive").mkdir(parents=True, exist_ok=True)
    return source, teacher


def release(name, folder=COURSE):
    """Let nbgrader write the students' notebook of an assignment, or of all ('*'), and its
    gradebook; the paths.

    SystemExit with nbgrader's reason if it refuses, for instance to change cells that students have
    handed in.
    """
    command = [sys.executable, "-m", "nbgrader", "generate_assignment", f"--assignment={name}", "--force"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if run.returncode:
        reasons = [line.strip() for line in run.stderr.splitlines() if re.match(r" *[\w.]+(Error|Exception): ", line)]
        reason = (reasons or run.stderr.splitlines() or ["it gave none"])[-1]
        raise SystemExit(f"course: nbgrader makes no release of {name} in {folder}: {reason}")
    return sorted((folder / "release").glob(f"{name}/*.ipynb"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("exercises", nargs="*", help="names, in order; all, and each week's, where none is given")
    parser.add_argument("--name", default="exercises", help="of the assignment")
    parser.add_argument("--seed", type=int, default=1, help="draws the inputs of the hidden tests; not 0")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.exercises if name not in EXERCISES]:
        sys.exit(f"course: no such exercise: {', '.join(unknown)}; there are {', '.join(in_order())}")
    if not re.fullmatch(r"[\w-]+", arguments.name):
        sys.exit(f"course: --name {arguments.name}: letters, digits, - and _ alone: it names folders")
    if arguments.seed < 1:
        sys.exit(f"course: --seed {arguments.seed}: the students' own checks draw by 0; give 1 or more")
    chosen = {arguments.name: arguments.exercises or in_order()}
    if not arguments.exercises:
        chosen |= {f"week{number}": names for number, (_, _, names) in enumerate(teaching.weeks(), 1)}
    for name, names in chosen.items():
        write(names, name, seed=arguments.seed)
    for path in release(arguments.name if arguments.exercises else "*"):
        print(f"course: {path.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
