"""What is committed: notebooks without outputs, with short cells and narrow code, and no trace of anybody's machine."""

import ast
import re
import subprocess
from pathlib import Path

import nbformat
import pytest

from book.builder.references import markdown_of
from book.builder.solutions import solutions_in

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOKS = sorted((ROOT / "book").glob("*.ipynb"))
PAGES = [*NOTEBOOKS, *sorted((ROOT / "book").glob("*.md"))]
NOTEBOOKS += sorted((ROOT / "book" / "decks").glob("*.ipynb"))
LONGEST_CELL = 30
MOST_IMPORTS = 6
WIDEST_LINE = 76  # what the site shows without sideways scrolling
# Somebody's folder, absolute or as seen from here.
MACHINE_PATH = re.compile(r"(?<![\w.:/-])/(?:root|home|work|Users|tmp)/\w+|\.\./share[d]\b|file:///\w")

MEASURED = re.compile("seconds|memory_mb|perf_counter|process_time|monotonic|maxrss")
ORDER = ast.Lt, ast.LtE, ast.Gt, ast.GtE


def absolute_limits(source):
    """Comparisons of a time or memory with a number; a sign, and ten seconds of waiting, hold on every machine."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Compare) and MEASURED.search(text := ast.unparse(node)):
            smallest = 10 if "perf_counter" in text else float("inf")
            sides = [ast.unparse(side) for side in (node.left, *node.comparators)]
            numbers = [float(side) for side in sides if re.fullmatch(r"[\d.e]+", side)]
            if any(isinstance(op, ORDER) for op in node.ops) and any(0 < number < smallest for number in numbers):
                yield f"line {node.lineno}: {text}"


def test_no_test_depends_on_the_speed_or_the_memory_of_a_machine():
    texts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")}
    assert {name: limits for name, text in texts.items() if (limits := list(absolute_limits(text)))} == {}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_is_committed_without_outputs(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    ran = [i for i, cell in enumerate(notebook.cells) if cell.get("outputs") or cell.get("execution_count")]
    assert ran == [], "clear the outputs: make clear"
    answered = [i for i, cell in enumerate(notebook.cells) if "user_expressions" in cell.metadata]
    assert answered == [], "JupyterLab stored the numbers of the prose; clear them: make clear"
    assert "widgets" not in notebook.metadata


def test_pages_grow_subjects_of_the_generation_that_was_measured():
    """A page that reads kept figures may not lay them beside subjects of the generator's newest generation."""
    asked = {}
    for path in NOTEBOOKS:
        sources = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
        if any("read_measured(" in source for source in sources):
            calls = [node for source in sources for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
            names = [getattr(call.func, "id", getattr(call.func, "attr", "")) for call in calls]
            grown = [call for call, name in zip(calls, names) if name in ("hemispheres", "mapped_subject")]
            asked |= {path.stem: ["generation" in [word.arg for word in call.keywords] for call in grown]}
    assert {"benchmark", "ldnet"} <= {page for page, calls in asked.items() if calls}
    assert [page for page, calls in asked.items() if not all(calls)] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_are_short_and_visible_ones_have_few_imports(path):
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert {cell.id: cell.source for cell in cells if len(cell.source.splitlines()) > LONGEST_CELL} == {}
    imports = {
        cell.id: len(re.findall(r"^\s*(?:import|from) ", cell.source, re.MULTILINE))
        for cell in cells
        if "hide-input" not in cell.metadata.get("tags", []) and "slideshow" not in cell.metadata
    }
    assert {name: count for name, count in imports.items() if count > MOST_IMPORTS} == {}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_code_of_cells_and_of_solutions_is_narrow(path):
    codes = []
    for cell in nbformat.read(path, as_version=4).cells:
        solved = [code for _, code, _ in solutions_in(cell.source)]
        codes += [cell.source] if cell.cell_type == "code" else solved
    assert [line for code in codes for line in code.splitlines() if len(line) > WIDEST_LINE] == []


NAMED = re.compile(r"(?<![\w./-])(?:qclearn|data_synth|tests|book)/[\w./-]*\w")
GUIDES = [ROOT / "CONTRIBUTING.md", *(ROOT / folder / "README.md" for folder in (".", "book/builder", "book/studies"))]
# What a guide warns of, what the reader of the page 'How to add a network' would write, and what an older commit has.
NOT_THERE = {"book/_static", "qclearn/nets/ringnet.py", "tests/nets/test_ringnet.py"}


@pytest.mark.parametrize("text", [*GUIDES, *PAGES], ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_files_that_a_text_names_are_there(text):
    words = text.read_text(encoding="utf-8") if text.suffix == ".md" else markdown_of(text.stem)
    assert [name for name in sorted(set(NAMED.findall(words)) - NOT_THERE) if not (ROOT / name).exists()] == []


def test_no_file_names_a_machine():
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git repository: nothing says which files belong to it")
    files = [ROOT / name for name in listed.split("\0") if name and "_assets/vendor/" not in name]
    found = {}
    for file in files:
        try:
            text = file.read_text(encoding="utf-8")
        except (UnicodeDecodeError, FileNotFoundError, IsADirectoryError):  # a link to a folder
            continue
        if match := MACHINE_PATH.search(text):
            found[str(file.relative_to(ROOT))] = match.group()
    assert found == {}
