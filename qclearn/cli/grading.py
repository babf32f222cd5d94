"""`qclearn grade`: a folder of students' notebooks to a csv and a page of feedback each."""

import csv
import secrets
from pathlib import Path

import click

from ..files.safe import write_whole
from .output import output_folder, say


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False))
@click.option(
    "--out", default="grades.csv", show_default=True, help="csv to write; feedback goes into a folder beside."
)
@click.option("--seed", type=int, help="Draws the inputs of the checks, not 0; drawn and told where none is given.")
@click.option(
    "--seconds", default=30.0, show_default=True, help="For a cell or a check; ten times that for a notebook."
)
@click.option("--gb", default=4.0, show_default=True, help="Memory of a notebook.")
@click.option("--jobs", default=2, show_default=True, help="Notebooks side by side.")
def grade(folder, out, seed, seconds, gb, jobs):
    """Grade the notebooks in FOLDER (*.ipynb, one a student) into a csv.

    This runs the students' code with your rights, each notebook in a process of its own with limits of time and memory,
    without network where the system allows that. Where you do not trust the code, run this in a container. The command
    itself writes the csv and, in a folder of its name without suffix, a page of feedback for each student, and nothing
    else. What students wrote in words stands on the page to-read.md there; the column 'to read' says who wrote any.
    """
    from ..exercises import GradingError, Limits, is_isolated, to_read
    from ..exercises import grade as graded_of

    out = Path(out)
    if out.suffix != ".csv" or not out.parent.is_dir():
        raise GradingError(f"{out}: give a name that ends in .csv, in a folder that exists")
    seed = 1 + secrets.randbelow(2**31) if seed is None else seed
    network = "without network" if is_isolated() else "with the network, which this system does not let them give up"
    say(f"running the students' code as you, {network}: what you do not trust, grade in a container")
    found = graded_of(folder, seed, Limits(seconds, gb), jobs)
    read = to_read(found)
    with output_folder(out.with_suffix("")) as pages:
        write_pages(pages, found, read)
    write_whole(out, lambda path: write_table(path, found))
    say(f"{len(found)} notebooks, seed {seed}: written to {out}, feedback to {out.with_suffix('')}/")
    if read:
        say(f"sentences to read: {out.with_suffix('') / 'to-read.md'}")


def write_pages(folder, found, read):
    """A page for each student, and the one for the teacher."""
    from ..exercises import feedback

    for graded in found:
        (folder / f"{graded.student}.md").write_text(feedback(graded), encoding="utf-8")
    if read:
        (folder / "to-read.md").write_text(read, encoding="utf-8")


def write_table(path, found):
    from ..exercises import table

    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(table(found))
