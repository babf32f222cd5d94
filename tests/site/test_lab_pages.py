"""Pages in a real JupyterLab, copies and sources after 'Run All Cells': nothing unresolved, the book's numbers."""

import html
import re

import nbformat
import pytest
from laboratory import sign
from places import EXECUTED, SITE

from qcbook.cells import in_powers

# All tests in JupyterLab, of pages and of widgets, share one server.
pytestmark = pytest.mark.xdist_group("JupyterLab")
READ = ["index", "lbs", "notation", "teaching"]  # between them figures, scenes, explorables, tables, theorems, boxes
RUN = ["fourier"]  # with widgets
CLOCK = re.compile(r"second|_ms|time")  # numbers that differ from run to run
NUMBER = re.compile(r'<span class="computed">(.*?)</span>', re.DOTALL)
RAW = re.compile(r"[^\n]*Unknown (?:Directive|Role)[^\n]*|\{(?:eval|figure|numref|eq|cite:\w|prf:\w+|term)\}\S*|:::")


def faults(cells):
    """What is wrong with a page as JupyterLab shows it."""

    def of(what):
        return [entry for cell in cells for entry in cell[what]]

    yield from (f"raw: {text}" for text in RAW.findall("\n".join(cell["text"] for cell in cells)))
    yield from (f"error: {error}" for error in of("errors"))
    yield from (f"no picture: {name}" for name in of("broken"))
    # 'Image' is JupyterLab's own word for what has no description.
    figures = [(alt, width) for alt, width in of("figures") if alt in ("", "Image") or width < 50]
    yield from (f"figure without a description or a picture: {alt!r}, {width} px" for alt, width in figures)
    yield from (f"a scene fills {100 * share:.0f} % of its cell" for share in of("scenes") if share < 0.95)


def shown_figures(page):
    """Figures and scenes of an executed page."""
    cells = nbformat.read(EXECUTED / f"{page}.ipynb", as_version=4).cells
    text = "".join(o.get("data", {}).get("text/html", "") for c in cells for o in c.get("outputs", []))
    return text.count('class="page-figure"'), text.count('<iframe class="scene"')


@pytest.mark.parametrize("page", READ)
def test_a_copy_reads_in_jupyterlab(reader, lab, page):
    sign(lab.home, [lab.root / "copies" / f"{page}.ipynb"])  # as `make lab-copies` does
    cells = reader.read(f"copies/{page}.ipynb")
    assert [*faults(cells), *(f"unresolved: {name}" for cell in cells for name in cell["unknown"])] == []
    if (EXECUTED / f"{page}.ipynb").exists():
        seen = [sum(len(cell[what]) for cell in cells) for what in ("figures", "scenes")]
        assert tuple(seen) == shown_figures(page)


@pytest.mark.parametrize("page", RUN)
def test_the_source_reads_in_jupyterlab_after_run_all(reader, page):
    cells = reader.run(f"sources/{page}.ipynb")
    assert list(faults(cells)) == []  # citations and references to other pages are for the book alone to resolve
    article = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1]
    asked = [
        entry["expression"]
        for cell in nbformat.read(EXECUTED / f"{page}.ipynb", as_version=4).cells
        for entry in cell.metadata.get("user_expressions", [])
    ]
    book = [" ".join(html.unescape(number).split()) for number in NUMBER.findall(article)]
    # The book writes powers of ten.
    shown = [" ".join(in_powers(number).split()) for cell in cells for number in cell["numbers"]]
    assert len(shown) == len(book) == len(asked)
    differ = [three for three in zip(asked, shown, book, strict=True) if three[1] != three[2]]
    assert [three for three in differ if not CLOCK.search(three[0])] == []
