"""Every page in a real JupyterLab: nothing unknown, nothing unresolved, each figure with its picture, description and
caption, and the numbers of the book. `make lab-copies` makes the pages; planted faults show that each of these is
noticed."""

import html
import json
import re
from itertools import islice

import nbformat
import pytest
import references
from laboratory import sign
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from places import EXECUTED, SITE
from readable import Readable, for_jupyterlab

# One worker of xdist has all tests in JupyterLab, about half of the time of tests/site: one server is started.
pytestmark = pytest.mark.xdist_group("JupyterLab")
PAGES = list(references.chapters())
RUN = ["lbs", "fourier"]  # also run by 'Run All Cells' from the source without outputs
CLOCK = re.compile(r"second|_ms|time")  # numbers that differ from run to run
NUMBER = re.compile(r'<span class="computed">(.*?)</span>', re.DOTALL)
CAPTION = re.compile(r'<span class="caption-number">(?:Fig\.|Figure)\s*([\d.]*\d)')


def squeezed(text):
    return " ".join(text.split())


def faults(cells, figures, numbers, scenes=0, unsure=()):
    """What is wrong with a page as JupyterLab shows it. figures: the numbers of its captions in the book; numbers:
    those of its text in the book, of which the positions `unsure` may differ; scenes: how many the book has."""

    def of(what):
        return [entry for cell in cells for entry in cell[what]]

    text = "\n".join(cell["text"] for cell in cells)
    yield from re.findall(r"[^\n]*Unknown (?:Directive|Role)[^\n]*", text)
    yield from (
        f"raw role: {raw}"
        for raw in re.findall(r"\{(?:eval|glue:\w+|figure|numref|eq|cite:\w|prf:\w+|term)\}\S*", text)
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
    yield from (f"a scene fills {100 * share:.0f} % of its cell" for share in of("scenes") if share < 0.95)
    shown = [squeezed(number) for number in of("numbers")]
    if len(shown) != len(numbers):
        yield f"{len(shown)} numbers; in the book {len(numbers)}"
    for position, (here, there) in enumerate(zip(shown, numbers, strict=False)):
        if here != there and position not in unsure:
            yield f"number {position + 1} is {here}; in the book {there}"


def in_the_book(page):
    """(numbers of the captions, numbers of the text, number of 3-D scenes) of a page of the site."""
    article = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1].split("</article>", 1)[0]
    numbers = [squeezed(html.unescape(number)) for number in NUMBER.findall(article)]
    return CAPTION.findall(article), numbers, article.count('<iframe class="scene"')


def clock_times(page):
    """Positions, among the numbers of a page's text, of those that a clock gave."""
    cells = nbformat.read(EXECUTED / f"{page}.ipynb", as_version=4).cells
    asked = [entry["expression"] for cell in cells for entry in cell.metadata.get("user_expressions", [])]
    return {position for position, expression in enumerate(asked) if CLOCK.search(expression)}


@pytest.mark.parametrize("page", PAGES)
def test_the_executed_page_reads_in_jupyterlab(reader, lab, page):
    sign(lab.home, [lab.root / "copies" / f"{page}.ipynb"])  # as `make lab-copies` does
    assert list(faults(reader.read(f"copies/{page}.ipynb"), *in_the_book(page))) == []


@pytest.mark.parametrize("page", RUN)
def test_the_source_reads_in_jupyterlab_after_run_all(reader, page):
    found = list(faults(reader.run(f"sources/{page}.ipynb"), *in_the_book(page), unsure=clock_times(page)))
    # The source itself still cites and points to other pages in a notation that only the book resolves, and
    # JupyterLab has its own way with captions and proofs.
    foreign = ("unresolved", "captions", "small caption", "numbered")
    assert [fault for fault in found if not fault.startswith(foreign)] == []


# One small page that is right, and the same with a fault.
PNG = (
    "iVBORw0KGgoAAAANSUhEUgAAAEAAAABACAIAAAAlC+aJAAAAQklEQVR4nO3PQQkAMAwEwVOe/FxXxFEYWDBwk3Y+LXNAAAEEEEAAAQQQQAABBB"
    "BAAAEEEEAAAQQQQAABBBBAAAEEENgDFIBQwq0AAAAASUVORK5CYII="
)
VALUE = {"status": "ok", "data": {"text/plain": "'0.25'"}, "metadata": {}}
TEXT = "# A page\n\nAs {cite:t}`guo2023automatic` say, {eval}`n`. See {numref}`fig-a`.\n\n:::{prf:proof}\nIt is.\n:::\n"
FIGURE = f'<img class="page-figure" alt="A square." src="data:image/png;base64,{PNG}">'
SCENE = '<iframe class="scene" width="100%" srcdoc="a scene"></iframe>'
# What is planted: name -> (what stands there, what takes its place, how the finding begins).
FAULTS = {
    "a glue role": ("{eval}`n`", "{glue:text}`n`", "number 1 is n"),
    "a glue figure": (":::{figure}", ":::{glue:figure} n", "glue:figure - Unknown Directive"),
    "a missing caption": (":::{figure}", ":::{note}", "captions: []"),
    "a missing description": ('alt="A square."', 'alt=""', "figure without a description"),
    "a stale number": ("'0.25'", "'0.26'", "number 1 is 0.26"),
    "an unanswered number": ("user_expressions", "nothing", "0 numbers"),
    "an unresolved citation": ("As ", "As {cite:p}`lui2013texture` and ", "unresolved: lui2013texture"),
    "an unresolved reference": ("See ", "See {eq}`eq-there` and ", "unresolved: eq-there"),
    "a numbered proof": (":nonumber: true", ":class: x", "numbered: Proof 1"),
    "a small caption": (":class: not-prose", ":class: x", "small caption: Figure"),
    "a scene that is not shown": ("<iframe", "<ifrome", "0 scenes; in the book 1"),
    "a narrow scene": ('width="100%"', 'width="300"', "a scene fills"),
    "an unknown directive": ("# A page", ":::{gallery}\nA\n:::", "gallery - Unknown Directive"),
}


def planted(before="", after=""):
    """A small page as a copy for JupyterLab, with `after` in place of `before`."""
    caption = ":::{figure}\n:name: fig-a\n\nA caption.\n\n:::\n"
    notebook = new_notebook(
        metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}},
        cells=[
            new_markdown_cell(TEXT, id="a", metadata={"user_expressions": [{"expression": "n", "result": VALUE}]}),
            new_code_cell("1", id="b", outputs=[new_output("display_data", data={"text/html": FIGURE + SCENE})]),
            new_markdown_cell(caption, id="c"),
        ],
    )
    targets = {"fig-a": references.Target("a", "figure", "Fig. 4.1")}
    text = nbformat.writes(for_jupyterlab(notebook, Readable("a", targets, references.Literature()), 4))
    before, after = (json.dumps(part)[1:-1] for part in (before, after))
    assert before in text
    return text.replace(before, after, 1)


@pytest.fixture(scope="module")
def seen(reader, lab):
    """What JupyterLab shows of the page that is right, "", and of each with a fault: all of them in one notebook."""
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
