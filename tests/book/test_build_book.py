"""The build sees an error that a widget's callback hid from nbmake, and executes what is out of date."""

import json

import execute_pages
import pytest
from execute_pages import errors_in
from nbformat.v4 import new_code_cell, new_notebook, new_output

ERROR = new_output("error", ename="ValueError", evalue="no such coefficient", traceback=[])


def with_widget(outputs):
    model = {"model_name": "OutputModel", "state": {"outputs": outputs}}
    states = {"application/vnd.jupyter.widget-state+json": {"state": {"some-model": model}}}
    return new_notebook(cells=[new_code_cell("1")], metadata={"widgets": states})


def test_an_error_inside_a_widget_is_found():
    assert errors_in(with_widget([ERROR])) == ["ValueError: no such coefficient"]


def test_an_error_below_a_cell_is_found():
    notebook = new_notebook(cells=[new_code_cell("1", outputs=[ERROR])])
    assert errors_in(notebook) == ["ValueError: no such coefficient"]


def test_ordinary_output_is_no_error():
    assert errors_in(with_widget([new_output("stream", text="fine")])) == []


def test_only_pages_that_are_out_of_date_are_executed(tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr(execute_pages, "STAMPS", tmp_path / "stamps.json")
    monkeypatch.setattr(execute_pages, "run", lambda pages, jobs: ran.append(pages))
    monkeypatch.setattr(execute_pages, "copy_texts", lambda: None)
    (tmp_path / "stamps.json").write_text(
        json.dumps({"lbs": execute_pages.stamp("lbs"), "fourier": "of an older page"})
    )
    execute_pages.execute_outdated(["lbs", "fourier", "index"], 2)
    execute_pages.execute_outdated(["lbs"], 2)
    assert ran == [["fourier", "index"]]


def test_a_change_of_the_library_makes_every_page_old(monkeypatch):
    before = execute_pages.stamp("lbs")
    monkeypatch.setattr(execute_pages, "library_digest", lambda: "another library")
    assert execute_pages.stamp("lbs") != before


def test_an_unknown_page_is_named():
    with pytest.raises(SystemExit, match="no such page in book/: nowhere.ipynb"):
        execute_pages.copy_book(["nowhere"])


def test_the_build_stops_with_page_and_cell(tmp_path):
    path = tmp_path / "page.ipynb"
    execute_pages.nbformat.write(new_notebook(cells=[new_code_cell("1")]), path)
    with pytest.raises(SystemExit, match="page.ipynb, cell 1: wrong"):
        execute_pages.stop_at(execute_pages.each_page([path], lambda notebook: ["cell 1: wrong"]))
    execute_pages.stop_at(execute_pages.each_page([path], lambda notebook: []))
