"""All copies for JupyterLab as files: captions, numbers, references, pictures and scenes are those
of the book. What JupyterLab makes of each kind of element, `test_lab_pages.py` asks on a few pages
that hold all kinds between them."""

import nbformat
import pytest
from copies import (
    FAULTS,
    all_kinds,
    copy_of,
    faults_of_file,
    fewest,
    in_the_book,
    kinds,
    planted,
    without_solutions,
)

from book.builder import references


def test_each_copy_reads_as_the_book_does():
    found = {
        page: list(faults_of_file(copy_of(page), chapter, *in_the_book(page)))
        for page, chapter in references.chapters().items()
    }
    assert {page: faults for page, faults in found.items() if faults} == {}


def test_the_pages_that_jupyterlab_opens_hold_each_kind_of_element():
    held = all_kinds()
    chosen = fewest(held)
    assert set().union(*(held[page] for page in chosen)) == set().union(*held.values())
    assert len(chosen) <= len(held) / 2  # else one may as well open all


def test_few_pages_are_chosen_and_they_hold_all():
    assert fewest({"a": {1}, "b": {1, 2}, "c": {3, 4, 5}, "d": {2, 3}}) == ["c", "b"]


def found_in(text):
    """The faults of a planted page, and its kinds that no page of the book has."""
    page = nbformat.reads(text, as_version=4)
    new = kinds(page) - set().union(*all_kinds().values())
    return [*faults_of_file(page, 4, ["4.1"], ["0.25"], scenes=1), *sorted(new)]


def test_a_copy_that_is_right_has_no_fault():
    assert found_in(planted()) == []


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_noticed(name):
    before, after, _, told = FAULTS[name]
    found = found_in(planted(before, after))
    assert any(told in fault for fault in found), found


def test_numbers_in_the_boxes_of_solutions_do_not_count():
    box = '<div class="solution dropdown admonition"><p>0.1</p><div><div>0.2</div></div></div>'
    assert without_solutions(f"a <div>b</div> {box} c {box}") == "a <div>b</div>  c "
