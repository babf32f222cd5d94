"""The pages as notebooks, the copies for JupyterLab and the downloads: nothing of MyST is left, everything is there."""

import re
from collections import Counter

import nbformat
import pytest
from places import COPIES, EXECUTED, SITE

from book.builder import references, solutions

FOLDERS = {"copy": COPIES, "download": SITE / "_sources"}
PAGES = {
    kind: [page for page in references.chapters() if kind == "copy" or (references.BOOK / f"{page}.ipynb").exists()]
    for kind in FOLDERS
}
MYST = re.compile(r"\{[\w:-]+\}`|^ *(?::{3,}|`{3,})\{|^\([\w:-]+\)=$|^:{3,}|<<cell", re.MULTILINE)
LINK = re.compile(r"(!?)\[([^\[\]]*)\]\((\w[\w./-]*|#[^)]*)\)")
NUMBER = re.compile(r"^\*\*((?:Fig\.|Exercise|[A-Z][a-z]+) [\d.]*\d)\.?\*\*|\\tag\{([\d.]+)\}", re.MULTILINE)
ZERO = re.compile(r"\|\s*(-?\d+\.\d*0)\s*(?=\|)")  # a number in a table whose last digit may get lost


def prose(notebook):
    """The Markdown cells, and the tables that code cells show."""
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    texts += [output.data["text/markdown"] for output in outputs if "text/markdown" in output.get("data", {})]
    return references.CODE.sub("", "\n\n".join(texts))


def faults(notebook, folder):
    """What a reader would miss or stumble over, in words."""
    text = prose(notebook)
    yield from (f"MyST: {mark}" for mark in MYST.findall(text))
    yield from ("solution" for _ in re.findall(r"\*\*Solution to", text) if not solutions.SHOWN)
    for picture, words, target in LINK.findall(text):
        place = target if picture or target.endswith((".ipynb", ".toml")) else f"no notebook: {target}"
        if not (COPIES / place).exists():
            yield f"leads nowhere: {target}"
        if picture and not words:
            yield f"no description: {target}"
    for cell in (cell for cell in notebook.cells if cell.cell_type == "code"):
        if not cell.execution_count:
            yield f"not run: {cell.source[:40]}"
        if ("hide-input" in cell.metadata.get("tags", [])) != cell.metadata.get("jupyter", {}).get(
            "source_hidden", False
        ):
            yield f"not folded: {cell.source[:40]}"
        figures = [output for output in cell.outputs if "alt" in output.get("metadata", {})]
        if len(figures) != ("show_figure(" in cell.source and "def show_figure" not in cell.source):
            yield f"{len(figures)} figures: {cell.source[:40]}"
        for data in (figure.data for figure in figures):
            if "image/png" not in data or (folder == COPIES) != ("<img alt=" in data.get("text/html", "")):
                yield f"no picture, or no description: {cell.source[:40]}"


@pytest.mark.parametrize("kind, page", [(kind, page) for kind, pages in PAGES.items() for page in pages])
def test_a_notebook_has_no_fault_and_all_cells_of_its_page(kind, page):
    notebook = nbformat.read(FOLDERS[kind] / f"{page}.ipynb", as_version=4)
    assert list(faults(notebook, FOLDERS[kind])) == []
    if (executed := EXECUTED / f"{page}.ipynb").exists():
        code = [cell for cell in nbformat.read(executed, as_version=4).cells if cell.cell_type == "code"]
        copied = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert [cell.source for cell in copied] == [cell.source for cell in code]
        assert [len(cell.outputs) for cell in copied] == [len(cell.outputs) for cell in code]
        kept, shown = (ZERO.findall(prose(nbformat.v4.new_notebook(cells=cells))) for cells in (copied, code))
        assert kept == shown


@pytest.mark.parametrize("page", references.chapters())
def test_a_copy_counts_as_the_site_does(page):
    shown = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1]
    on_the_site = re.findall(r'<span class="eqno">\(([\d.]+)\)', shown)
    on_the_site += [text.strip() for text in re.findall(r'<span class="caption-number">([A-Z][^<]*\d)', shown)]
    text = prose(nbformat.read(COPIES / f"{page}.ipynb", as_version=4))
    assert Counter(a or b for a, b in NUMBER.findall(text)) == Counter(on_the_site)


def test_a_link_that_leads_nowhere_is_found():
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("first\n[a](#fig-x)\nlast")])
    assert list(faults(notebook, COPIES))
