"""What students get of a built book: no solution, and the same question on the page as in the notebook."""

import nbformat
import pytest
from places import COPIES, SITE

from book.builder import course, references
from book.builder.graded import EXERCISES, PLACE, call
from leaks import drift, graded_lines, leaks, page_lines, text_of

pytestmark = pytest.mark.xdist_group("solutions")  # one notebook of a student serves all
KINDS = {".html", ".ipynb", ".md", ".txt", ".py", ".js", ".json"}


def files(folder):
    return [path for path in sorted(folder.rglob("*")) if path.suffix in KINDS]


@pytest.fixture(scope="module")
def student(tmp_path_factory):
    folder = tmp_path_factory.mktemp("course")
    course.write(course.in_order(), "exercises", folder)
    return course.release("exercises", folder)[0]


def test_no_solution_of_a_graded_exercise_is_in_anything_that_was_built(student):
    assert len(files(SITE)) > 60 and len(files(COPIES)) > 30
    assert leaks([*files(SITE), *files(COPIES), student], graded_lines()) == {}


def test_downloads_and_copies_have_no_solution():
    for page, lines in page_lines().items():
        assert leaks([SITE / "_sources" / f"{page}.ipynb", COPIES / f"{page}.ipynb"], {page: lines}) == {}


def test_the_site_has_the_solutions_of_other_exercises():
    found = {
        page: lines for page, lines in page_lines().items() if lines and leaks([SITE / f"{page}.html"], {page: lines})
    }
    assert len(found) > 10


def test_the_sites_pages_and_the_notebook_ask_the_same(student):
    notebook, asked = nbformat.read(student, as_version=4), set()
    for path in sorted(references.BOOK.glob("*.ipynb")):
        text = "\n".join(cell.source for cell in nbformat.read(path, as_version=4).cells)
        if names := set(PLACE.findall(text)):
            assert list(drift(nbformat.read(SITE / "_sources" / path.name, as_version=4), notebook)) == []
            shown = text_of(SITE / f"{path.stem}.html")
            assert [name for name in names if call(EXERCISES[name]) not in shown] == []
            asked |= names
    assert asked
