"""Slides are notebooks: each slide has one picture, and its words have the numbers of the run."""

import json
import re

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import decks
from book.builder.execute_pages import ROOT, notebooks
from book.builder.references import chapters

DECKS = {name: nbformat.read(ROOT / "book" / f"{name}.ipynb", as_version=4) for name in notebooks("decks")}


def kinds(notebook):
    return [cell.metadata.slideshow.slide_type for cell in notebook.cells]


@pytest.mark.parametrize("name", DECKS)
def test_each_slide_is_a_title_few_words_one_picture_and_notes(name):
    cells, slides = DECKS[name].cells, []
    assert set(kinds(DECKS[name])) <= {"slide", "-", "fragment", "notes", "skip"}
    for cell, kind in zip(cells, kinds(DECKS[name])):
        if kind == "slide":
            slides.append([])
        if kind != "skip":
            slides[-1].append((cell.cell_type, cell.source))
    assert 7 <= len(slides) <= 9 and DECKS[name].metadata.title == slides[0][0][1].splitlines()[0].removeprefix("# ")
    for (_, words), (_, code), (_, notes) in slides:
        assert re.match(r"##? .+\n\n.{20,230} \[.+\]\(\.\./\w+\.ipynb\)$", words) and len(notes) > 40, words
        assert len(re.findall(r"^(?:slide|explorable)\(", code, re.MULTILINE)) == 1, words
    assert sum("explorable(" in code for _, (_, code), _ in slides) == 1


def test_words_have_the_numbers_of_the_run_and_nothing_comes_from_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(decks, "SOURCE", tmp_path)
    answers = [{"result": {"status": "ok", "data": {"text/plain": text}}} for text in ("'1.25'", "7")]
    words = '## One\n\n{eval}`f"{x:.2f}"` and {eval}`y` [The fit](../fit.ipynb)'
    words = new_markdown_cell(words, metadata={"user_expressions": answers})
    live = new_output("display_data", data={"text/html": '<div class="qc-live" data-page="lbs"></div>'})
    cells = [words, new_code_cell("code", outputs=[live]), new_markdown_cell("said")]
    for cell, kind in zip(cells, ("slide", "-", "notes")):
        cell.metadata["slideshow"] = {"slide_type": kind}
    for name in DECKS:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        nbformat.write(new_notebook(cells=cells, metadata={"title": "A deck"}), tmp_path / f"{name}.ipynb")
    decks.write(tmp_path / "out", "../_static", r" \1(../\2.html)")
    assert {f"decks/{path.stem}" for path in (tmp_path / "out").iterdir()} == set(DECKS)
    for path in (tmp_path / "out").iterdir():
        text = path.read_text(encoding="utf-8")
        assert '1.25 and 7 <a href="../fit.html">The fit</a>' in text
        assert 'data-explorables="lbs"' in text and "<title>A deck</title>" in text
        assert "http" not in text and ">code<" not in text and "../_static/vendor/reveal/reveal.js" in text


def test_the_guide_for_teachers_names_each_deck_and_no_page_is_cut_into_slides():
    guide = (ROOT / "book" / "teaching.md").read_text(encoding="utf-8")
    plan = (ROOT / "book" / "teaching.toml").read_text(encoding="utf-8")
    for name in DECKS:
        assert f"{name}.html" in guide and f"deck *{name.removeprefix('decks/')}*" in plan
    pages = (ROOT / "book" / f"{page}.ipynb" for page in chapters())
    tags = {
        tag
        for path in pages
        if path.exists()
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        for tag in cell["metadata"].get("tags", [])
    }
    assert {tag for tag in tags if tag.startswith(("slide-", "more-"))} == set()
