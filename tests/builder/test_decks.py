"""Slides take from tagged cells what a slide can hold, and each deck has an explorable."""

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import decks
from book.builder.references import BOOK

CELL = "Above.\n\n## One\n\nA sentence, $a. b$ in it. Another one.\n\n$$x$$\n\n- a list\n\n## Two\n\nMore."


def markdown(*tags, source=CELL):
    return new_markdown_cell(source, metadata={"tags": list(tags)})


def test_every_deck_has_an_explorable():
    cells = {
        (name, "explorable(" in cell.source)
        for page in decks.pages()
        for cell in nbformat.read(BOOK / f"{page}.ipynb", as_version=4).cells
        for name, _ in decks.tagged(cell)
    }
    assert (
        {name for name, live in cells if live} == {name for name, _ in cells} == set(decks.TITLES)
    )


def test_a_slide_takes_what_stands_below_the_first_heading_and_more_what_stands_above():
    assert [decks.part(CELL, kind) for kind in ("more", "slide")] == [
        ("", "Above.\n\n"),
        ("One", CELL.split("## One")[1].split("## Two")[0]),
    ]
    assert decks.part("No heading.", "slide") == ("", "No heading.")


def test_of_a_paragraph_the_first_sentence_is_shown_and_formulas_and_lists_are_whole():
    assert (
        decks.shortened(decks.part(CELL, "slide")[1])
        == "A sentence, $a. b$ in it.\n\n$$x$$\n\n- a list"
    )
    assert (
        decks.shortened("**Printed.** This. **Right.** That.")
        == "**Printed.** This. **Right.** That."
    )


@pytest.mark.parametrize(
    "kind", ["{prf:proof}", "{admonition} Answers\n:class: dropdown", "{solution} ex-a"]
)
def test_proofs_and_answers_are_left_out(kind):
    assert (
        decks.LEFT_OUT.sub("", f"Before.\n\n:::{kind}\nHidden.\n\n:::\n\nAfter.")
        == "Before.\n\n\n\nAfter."
    )


def test_slides_go_on_with_the_last_heading_and_show_pictures_with_their_words():
    picture = new_output("display_data", data={"image/png": "QUJD"}, metadata={"alt": "a <disk>"})
    live = new_output(
        "display_data", data={"text/html": '<div class="qc-live" data-page="lbs"></div>'}
    )
    cells = [
        markdown(),
        new_code_cell("1", outputs=[picture], metadata={"tags": ["slide-lbs"]}),
        markdown("more-lbs", "slide-lbs"),
        new_code_cell("2", outputs=[live], metadata={"tags": ["more-lbs", "hide-input"]}),
    ]
    one, two = decks.slides("page", new_notebook(cells=cells))["lbs"]
    assert (one.title, two.title) == ("Two", "One")
    assert (
        'alt="a &lt;disk&gt;"' in one.html()
        and "Above." in one.html()
        and 'class="beside"' in one.html()
    )
    assert 'class="live"' in two.html() and "Another one" in two.html().split('class="notes"')[1]


@pytest.mark.parametrize(
    "tag, told", [("slide-nothing", "decks are opening"), ("more-lbs", "before any is tagged")]
)
def test_a_wrong_tag_stops_the_build(tag, told):
    with pytest.raises(SystemExit, match=told):
        decks.slides("page", new_notebook(cells=[markdown(tag)]))
