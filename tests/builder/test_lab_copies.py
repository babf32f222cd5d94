"""Copies of pages for reading: what a reader changed is not lost."""

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from book.builder import lab_copies


def page(text, count=None):
    return new_notebook(cells=[new_markdown_cell(text), new_code_cell("1", execution_count=count)])


def texts(folder):
    paths = sorted(folder.glob("*.ipynb"))
    return {path.stem: nbformat.read(path, as_version=4).cells[0].source for path in paths}


@pytest.fixture
def folder(tmp_path):
    lab_copies.write_copies(tmp_path, {"a": page("old"), "b": page("b")})
    return tmp_path


def test_a_changed_copy_stays_while_its_page_does(folder, capsys):
    nbformat.write(page("mine"), folder / "a.ipynb")
    lab_copies.write_copies(folder, {"a": page("old")})
    assert texts(folder) == {"a": "mine", "b": "b"} and capsys.readouterr().err == ""


def test_a_changed_copy_is_kept_beside_the_new_one(folder, capsys):
    for mine, new in (("mine", "new"), ("mine too", "newer")):
        nbformat.write(page(mine), folder / "a.ipynb")
        lab_copies.write_copies(folder, {"a": page(new)})
        assert "you changed a.ipynb" in capsys.readouterr().err
    assert texts(folder) == {"a": "newer", "a-mine": "mine", "a-mine-2": "mine too", "b": "b"}


def test_a_copy_that_was_only_run_is_replaced(folder):
    nbformat.write(page("old", count=7), folder / "a.ipynb")
    lab_copies.write_copies(folder, {"a": page("new")})
    assert texts(folder) == {"a": "new", "b": "b"}


def test_nothing_is_lost_without_copy_record_or_format(folder):
    (folder / "b.ipynb").unlink()
    lab_copies.write_copies(folder, {"a": page("old"), "b": page("new")})
    assert texts(folder) == {"a": "old", "b": "new"}
    (folder / lab_copies.RECORD).write_text("{}")
    lab_copies.write_copies(folder, {"a": page("new")})
    assert texts(folder) == {"a": "new", "a-mine": "old", "b": "new"}
    (folder / "b.ipynb").write_text("half a file")
    lab_copies.write_copies(folder, {"b": page("newer")})
    assert (folder / "b-mine.ipynb").read_text() == "half a file"
