"""`qclearn grade`: a folder of students' notebooks to a csv and a page of feedback each."""

import csv
import secrets
from importlib.util import find_spec
from pathlib import Path

import click

from ..io.safe import write_whole
from .output import output_folder, say

TO_READ = "to-read.md"


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False))
@click.option(
    "--out", default="grades.csv", show_default=True, help="csv to write; feedback goes into a folder beside."
)
@click.option(
    "--sheet",
    type=click.Path(exists=True, dir_okay=False),
    help="The notebook that was handed out: its exercises are asked for. Without it, those that any hand-in names.",
)
@click.option("--seed", type=int, help="Draws the inputs of the checks, not 0; drawn and told where none is given.")
@click.option(
    "--seconds", default=30.0, show_default=True, help="For a cell or a check; ten times that for a notebook."
)
@click.option("--gb", default=4.0, show_default=True, help="Memory of a notebook.")
@click.option("--jobs", default=2, show_default=True, help="Notebooks side by side.")
def grade(folder, out, sheet, seed, seconds, gb, jobs):
    """Grade the notebooks in FOLDER (*.ipynb, one a student) into a csv.

    This runs the students' code with your rights, each notebook in a process of its own with limits of time and memory,
    without network where the system allows that. Where you do not trust the code, run this in a container, and not as
    root, whom no limit of processes binds: docker run --user 1000 --network none --pids-limit 256 --memory 8g ...

    The command itself writes the csv and, in a folder of its name without suffix, a page of feedback for each student,
    and nothing else. What students wrote in words stands on the page to-read.md there; the column 'to read' says who
    wrote any, the column 'look at' where code names what a check could be deceived by.
    """
    if find_spec("qcbook") is None:
        raise ImportError("grading needs the package qcbook, which is missing here: install qclearn from its wheel")
    from qcbook.exercises import GradingError, Limits, found_in, is_isolated, to_read
    from qcbook.exercises import grade as graded_of

    out = Path(out)
    if out.suffix != ".csv" or not out.parent.is_dir():
        raise GradingError(f"{out}: give a name that ends in .csv, in a folder that exists")
    if out.with_suffix("").resolve() == Path(folder).resolve():
        raise GradingError(
            f"{out}: the feedback would go among what was handed in; give a name other than the folder's"
        )
    seed = 1 + secrets.randbelow(2**31) if seed is None else seed
    network = "without network" if is_isolated() else "with the network, which this system does not let them give up"
    say(f"running the students' code as you, {network}: what you do not trust, grade in a container")
    if passed_over := [str(path) for path in found_in(folder)[1]]:
        say(f"passed over, for they lie in folders below or do not end in .ipynb: {', '.join(passed_over)}")
    found = graded_of(folder, seed, Limits(seconds, gb), jobs, sheet)
    read = to_read(found)
    with output_folder(out.with_suffix(""), instead=[TO_READ]) as pages:
        write_pages(pages, found, read)
    write_whole(out, lambda path: write_table(path, found))
    pages = out.with_suffix("")
    many = f"{len(found)} notebook{'s' * (len(found) > 1)}"
    say(f"{many}, seed {seed}: written to {out}, feedback to {pages}/")
    if read:
        say(f"sentences to read: {pages / TO_READ}")


def write_pages(folder, found, read):
    """A page for each student, and the one for the teacher."""
    from qcbook.exercises import feedback

    for graded in found:
        page = folder / f"{graded.student}.md"
        while page.name == TO_READ or page.exists():  # names may be the same once they can be shown
            page = page.with_name(f"{page.stem}-.md")
        page.write_text(feedback(graded), encoding="utf-8")
    if read:
        (folder / TO_READ).write_text(read, encoding="utf-8")


def write_table(path, found):
    from qcbook.exercises import table

    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(table(found))
