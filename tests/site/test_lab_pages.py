"""Pages in a real JupyterLab, a few that hold each kind of element between them: nothing unknown,
nothing unresolved, each figure with its picture, description and caption, and the numbers of the
book. `make lab-copies` makes the pages; planted faults show that each of these is noticed. The
other copies are checked as files, by `test_copies.py`."""

import re
from itertools import islice

import nbformat
import pytest
from copies import FAULTS, all_kinds, fewest, in_the_book, planted, squeezed
from laboratory import sign
from places import EXECUTED

# Two workers of xdist share the tests in JupyterLab, pages and widgets: each starts one server.
pytestmark = pytest.mark.xdist_group("pages in JupyterLab")
RUN = ["lbs", "fourier"]  # also run by 'Run All Cells' from the source without outputs
CLOCK = re.compile(r"second|_ms|time")  # numbers that differ from run to run


def faults(cells, figures, numbers, scenes=0, unsure=()):
    """What is wrong with a page as JupyterLab shows it. figures: the numbers of its captions in the
    book; numbers: those of its text in the book, of which the positions `unsure` may differ;
    scenes: how many the book has."""

    def of(what):
        return [entry for cell in cells for entry in cell[what]]

    text = "\n".join(cell["text"] for cell in cells)
    yield from re.findall(r"[^\n]*Unknown (?:Directive|Role)[^\n]*", text)
    yield from (
        f"raw role: {raw}"
        for raw in re.findall(
            r"\{(?:eval|glue:\w+|figure|numref|eq|cite:\w|prf:\w+|term)\}\S*", text
        )
    )
    yield from (f"numbered: {proof}" for proof in re.findall(r"^Proof \d+", text, re.MULTILINE))
    yield from (f"small caption: {caption}" for caption in of("small"))
    yield from (f"unresolved: {name}" for name in of("unknown"))
    yield from (f"error: {error}" for error in of("errors"))
    yield from (f"no picture: {name}" for name in of("broken"))
    yield from (
        f"figure without a description or a picture: {alt!r}, {width} px"
        for alt, width in of("figures")
        if alt in ("", "Image") or width < 50
    )  # 'Image' is JupyterLab's own word for what has no description
    captions = [re.match(r"Figure\s([\d.]*\d)", caption) for caption in of("captions")]
    if [caption and caption[1] for caption in captions] != figures:
        yield f"captions: {of('captions')}; in the book {figures}"
    if len(of("figures")) != len(figures):
        yield f"{len(of('figures'))} figures below cells; in the book {len(figures)}"
    if len(of("scenes")) != scenes:
        yield f"{len(of('scenes'))} scenes; in the book {scenes}"
    yield from (
        f"a scene fills {100 * share:.0f} % of its cell" for share in of("scenes") if share < 0.95
    )
    shown = [squeezed(number) for number in of("numbers")]
    if len(shown) != len(numbers):
        yield f"{len(shown)} numbers; in the book {len(numbers)}"
    for position, (here, there) in enumerate(zip(shown, numbers, strict=False)):
        if here != there and position not in unsure:
            yield f"number {position + 1} is {here}; in the book {there}"


def clock_times(page):
    """Positions, among the numbers of a page's text, of those that a clock gave."""
    cells = nbformat.read(EXECUTED / f"{page}.ipynb", as_version=4).cells
    asked = [
        entry["expression"] for cell in cells for entry in cell.metadata.get("user_expressions", [])
    ]
    return {position for position, expression in enumerate(asked) if CLOCK.search(expression)}


def test_the_executed_pages_read_in_jupyterlab(reader, lab):
    found = {}
    for page in fewest(all_kinds()):
        sign(lab.home, [lab.root / "copies" / f"{page}.ipynb"])  # as `make lab-copies` does
        found[page] = list(faults(reader.read(f"copies/{page}.ipynb"), *in_the_book(page)))
    assert {page: seen for page, seen in found.items() if seen} == {}


@pytest.mark.parametrize("page", RUN)
def test_the_source_reads_in_jupyterlab_after_run_all(reader, page):
    found = list(
        faults(reader.run(f"sources/{page}.ipynb"), *in_the_book(page), unsure=clock_times(page))
    )
    # The source itself still cites and points to other pages in a notation that only the book
    # resolves, and JupyterLab has its own way with captions and proofs.
    foreign = ("unresolved", "captions", "small caption", "numbered")
    assert [fault for fault in found if not fault.startswith(foreign)] == []


@pytest.fixture(scope="module")
def seen(reader, lab):
    """What JupyterLab shows of the page that is right, "", and of each with a fault: all of them in
    one notebook."""
    pages = {name: planted(*FAULTS[name][:2]) if name else planted() for name in ("", *FAULTS)}
    pages = {name: nbformat.reads(text, as_version=4) for name, text in pages.items()}
    whole = pages[""] | {"cells": [cell for page in pages.values() for cell in page.cells]}
    for k, cell in enumerate(whole["cells"]):
        cell["id"] = f"cell-{k}"
    path = lab.root / "planted" / "faults.ipynb"
    nbformat.write(nbformat.from_dict(whole), path)
    sign(lab.home, [path])
    cells = iter(reader.read("planted/faults.ipynb"))
    return {name: list(islice(cells, len(page.cells))) for name, page in pages.items()}


def found_in(cells):
    return list(faults(cells, ["4.1"], ["0.25"], scenes=1))


def test_a_page_that_is_right_has_no_fault(seen):
    assert found_in(seen[""]) == []


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_noticed(seen, name):
    found = found_in(seen[name])
    assert any(FAULTS[name][2] in fault for fault in found), found
