"""No page takes longer to read than an hour; how the minutes are counted."""

import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell

from book.builder import reading
from book.builder.references import chapters

LONGEST = 60


@pytest.mark.parametrize("page", chapters())
def test_a_page_is_read_within_an_hour(page):
    assert reading.minutes(page) <= LONGEST


def test_words_equations_and_visible_lines_count_and_what_is_folded_does_not():
    words = new_markdown_cell("word " * 300)
    equation = new_markdown_cell("$$\nx\n$$")
    lines = new_code_cell("x = 1\n" * 10)
    hidden = new_code_cell("x = 1\n" * 10, metadata={"tags": ["hide-input"]})
    assert reading.minutes_of_cells([words, hidden]) == pytest.approx(2)
    assert reading.minutes_of_cells([lines]) == pytest.approx(2)
    assert reading.minutes_of_cells([equation]) == pytest.approx(1 / 0.67)
