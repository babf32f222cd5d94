"""Slides take from tagged cells what a slide can hold, and each deck has an explorable."""

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import decks
from book.builder.references import BOOK, chapters

CELL = """Above.

## One

A sentence, $a. b$ in it. Another one, see [there](there.ipynb).

$$x$$

- a list

**Theorem 1.1** (Name)

All. Of it.

Proof. Hidden.

∎

## Two

More."""
NO_SLIDES = new_notebook(cells=[new_markdown_cell("# Elsewhere")])


def deck(*cells, name="lbs"):
    return decks.deck(name, {"elsewhere": NO_SLIDES, "page": new_notebook(cells=list(cells))}).cells


def test_every_deck_has_an_explorable():
    notebooks = [BOOK / f"{page}.ipynb" for page in chapters() if (BOOK / f"{page}.ipynb").exists()]
    cells = {
        (name, "explorable(" in cell.source)
        for path in notebooks
        for cell in nbformat.read(path, as_version=4).cells
        for _, name in decks.tagged(cell)
    }
    assert {name for name, live in cells if live} == {name for name, _ in cells} == set(decks.TITLES)


def test_a_slide_has_a_heading_short_words_and_whole_ones_for_the_speaker():
    made = deck(new_markdown_cell(CELL, metadata={"tags": ["slide-lbs"]}))
    assert [cell.metadata.slideshow.slide_type for cell in made] == ["slide", "-", "notes"]
    assert made[0].source == "## One"
    assert made[1].source == "A sentence, $a. b$ in it.\n\n$$x$$\n\n- a list\n\n**Theorem 1.1** (Name)\n\nAll. Of it."
    assert "Another one, see there." in made[2].source and "Proof. Hidden." in made[2].source


def test_slides_go_on_with_the_last_heading_and_show_pictures_tables_and_explorables():
    shown = ('<img class="page-figure">', '<div class="qc-live" data-page="lbs"></div>', "<iframe></iframe>")
    outputs = [new_output("display_data", data={"text/html": each}) for each in shown]
    cells = [
        new_markdown_cell(CELL),
        new_code_cell("1", outputs=outputs, metadata={"tags": ["slide-lbs"]}),
        new_markdown_cell(CELL, metadata={"tags": ["more-lbs", "slide-lbs"]}),
    ]
    made = deck(*cells)
    assert [cell.source for cell in made[:5]] == ["## Two", "1", "Above.", "Above.\n\n", "## One"]
    assert [output.data["text/html"] for output in made[1].outputs] == list(shown[:2])


@pytest.mark.parametrize("tag, told", [("slide-nothing", "decks are opening"), ("more-lbs", "before any is tagged")])
def test_a_wrong_tag_stops_the_build(tag, told):
    with pytest.raises(SystemExit, match=told):
        deck(new_markdown_cell(CELL, metadata={"tags": [tag]}))


def test_a_page_of_slides_loads_nothing_from_elsewhere(tmp_path):
    cells = [new_markdown_cell(CELL, metadata={"tags": [f"slide-{name}"]}) for name in decks.TITLES]
    decks.write({"page": new_notebook(cells=cells)}, tmp_path, "_static")
    for name in decks.TITLES:
        text = (tmp_path / f"{name}.html").read_text(encoding="utf-8")
        assert "http" not in text and "<script defer" in text and "_static/decks.js" in text
