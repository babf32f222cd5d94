"""Names in code font are there: of the library, of what a method gets, of commands, options, targets and reports."""

import inspect
import re
from itertools import pairwise
from pathlib import Path
from pydoc import locate

import nbformat
import pytest

from book.builder.references import CODE, chapters, markdown_of
from qclearn.cli import cli
from reports import REPORT

ROOT = Path(__file__).resolve().parents[2]
GUIDES = ["CONTRIBUTING.md", "README.md", "book/builder/README.md", "book/studies/README.md"]
TEXTS = {page: markdown_of(page) for page in chapters()} | {name: (ROOT / name).read_text("utf-8") for name in GUIDES}
# What a page calls so -> its class -> what that has.
CLASSES = {"problem": "registration.problem.Problem", "pair": "registration.start.SurfacePair"}
CLASSES |= dict.fromkeys(["moving", "control"], "surfaces.conformal.ParameterizedSurface")
CLASSES |= {"disk": "plane.disk.Disk", "surface": "Surface", "result": "Registration"}
CLASSES |= {"sphere": "benchmark.methods.spheres.Sphere"}
HELD = {name: locate(f"qclearn.{path}") for name, path in CLASSES.items()}
HELD = {
    name: {*dir(held), *inspect.get_annotations(held), *re.findall(r"self\.(\w+)", inspect.getsource(held))}
    for name, held in HELD.items()
}
# Options of dask, nbgrader and a study stand beside ours; commands and options add keys to a report.
OPTIONS = {"--help", "--left", "--Execute.timeout"}
OPTIONS |= {
    option for command in cli.commands.values() for one in command.params for option in one.opts + one.secondary_opts
}
TARGETS = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
KEYS = REPORT | {"inputs", "landmarks", "versions", "command", "uncertainty", "curves"}
# A name of ours -> whether it is there; a name of something else matches none.
RULES = {
    r"(qc(?:\.[A-Za-z_]\w*)+)(?![\w/.]).*": lambda path: locate(f"qclearn{path[2:]}") is not None,
    r"((?:qclearn|data_synth|qcbook)(?:\.[A-Za-z_]\w*)+)(?![\w/.]).*": lambda path: locate(path) is not None,
    r"((?:problem|pair|result|disk|surface)(?:\.\w+)+).*": lambda path: all(
        name in HELD[before] for before, name in pairwise(path.split(".")) if before in HELD
    ),
    r"(--[\w.-]+).*": OPTIONS.__contains__,
    r"qclearn (\w+).*": {*cli.commands, "COMMAND"}.__contains__,
    r"make ([a-z-]+).*": TARGETS.__contains__,
    r".*report\[\"(\w+)\"\].*": KEYS.__contains__,
}


def spans(text):
    return re.findall(r"(?<![`}\w])`([^`\n]+)`(?!`)", CODE.sub("", text))


def missing(text):
    matches = ((span, there, re.fullmatch(rule, span)) for span in spans(text) for rule, there in RULES.items())
    return [span for span, there, match in matches if match and not there(match[1])]


@pytest.mark.parametrize("name", TEXTS)
def test_names_in_code_font_are_there(name):
    assert missing(TEXTS[name]) == []


@pytest.mark.parametrize("page, others", [("addmethod", {"whole", "points"}), ("addnetwork", set())])
def test_bare_names_of_a_how_to_are_in_its_code_or_in_what_it_names(page, others):
    cells = nbformat.read(ROOT / f"book/{page}.ipynb", as_version=4).cells
    known = set(re.findall(r"\w+", " ".join(cell.source for cell in cells if cell.cell_type == "code")))
    bare = {span for span in spans(TEXTS[page]) if re.fullmatch(r"[a-z_]+", span)}
    assert bare - known - HELD["problem"] == others <= HELD["sphere"]


def test_names_that_are_not_there_are_found():
    wrong = ["qc.registers", "qclearn.plane.disc.Disk", "problem.sides", "problem.pair.moving.disc", "--landmark x"]
    wrong += ["qclearn landmarks", "make picture", 'report["dice"]']
    assert missing(" ".join(f"`{one}`" for one in wrong)) == wrong
