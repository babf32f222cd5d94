"""The files of the built site: complete, and numbered as the copies are. `make book` builds it
first."""

import re
from collections import Counter

import nbformat
import pytest
from places import ROOT, SITE

from book.builder import costs, references
from book.builder.execute_pages import SOURCE

MOST_GB = 1.5  # of a page's run


def test_every_page_of_the_contents_is_built():
    expected = {f"{page}.html" for page in references.chapters()}
    assert expected, "book/_toc.yml names no page"
    missing = expected - {path.name for path in SITE.glob("*.html")}
    assert not missing, "build the site with `make book` first"


def test_every_notebook_is_in_the_contents():
    assert {path.stem for path in (ROOT / "book").glob("*.ipynb")} <= set(references.chapters())


def test_no_page_takes_more_memory_than_a_student_has():
    found = costs.measured(SOURCE)
    assert len(found) > 40
    assert {page: cost["gb"] for page, cost in found.items() if cost["gb"] > MOST_GB} == {}


@pytest.mark.parametrize("page", ["fourier", "live"])
def test_there_are_widgets(page):
    assert "application/vnd.jupyter.widget-view+json" in (SITE / f"{page}.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.parametrize("page", references.chapters())
def test_the_copies_count_as_the_book_does(page):
    """Numbers of equations, figures and theorems in references to another page are counted from the
    sources."""
    shown = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1]
    in_book = Counter(re.findall(r'<span class="eqno">(\([\d.]+\))', shown)) + Counter(
        text.strip() for text in re.findall(r'<span class="caption-number">([A-Z][^<]*)', shown)
    )
    counted = Counter(
        target.text
        for _, target in references.numbered(
            references.markdown_of(page), page, references.chapters()[page]
        )
        if target.kind != "section"
    )
    assert counted == in_book


NOTATION = re.compile(
    r"\{[\w:-]+\}`|^ *(?::{3,}|`{3,})\{|^\([\w:-]+\)=$", re.MULTILINE
)  # roles, directives, labels


@pytest.mark.parametrize(
    "path", sorted((ROOT / "book").glob("*.ipynb")), ids=lambda path: path.stem
)
def test_the_notebook_offered_for_download_reads_right_in_any_viewer(path):
    """VS Code, Colab and GitHub know no notation of MyST: numbers stand in the text, and a picture
    for each figure."""
    assert f"_sources/{path.name}" in (SITE / f"{path.stem}.html").read_text(encoding="utf-8")
    cells = nbformat.read(SITE / "_sources" / path.name, as_version=4).cells
    left = [
        found
        for cell in cells
        if cell.cell_type == "markdown"
        for found in NOTATION.findall(cell.source)
    ]
    assert left == []
    pictures = [
        cell
        for cell in cells
        if any(
            "scrapbook" in output.get("metadata", {}) and "image/png" in output.data
            for output in cell.get("outputs", [])
        )
    ]
    assert len(pictures) == sum(
        "show_figure(" in cell.source for cell in cells if cell.cell_type == "code"
    )


def test_notation_that_is_left_is_found():
    assert NOTATION.search("first\nabout {eval}`n` faces\nlast")


def test_the_explorables_weigh_at_most_six_megabytes_in_all():
    files = [path for path in (SITE / "_static" / "live").rglob("*") if path.is_file()]
    assert files and sum(path.stat().st_size for path in files) < 6e6
