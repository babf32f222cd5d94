"""The build sees an error that a widget's callback hid from nbmake."""

import importlib.util
from pathlib import Path

import pytest
from nbformat.v4 import new_code_cell, new_notebook, new_output

TOOL = Path(__file__).resolve().parent.parent / "tools" / "build_book.py"
ERROR = new_output("error", ename="ValueError", evalue="no such coefficient", traceback=[])


@pytest.fixture(scope="module")
def build_book():
    specification = importlib.util.spec_from_file_location("build_book", TOOL)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def with_widget(outputs):
    model = {"model_name": "OutputModel", "state": {"outputs": outputs}}
    states = {"application/vnd.jupyter.widget-state+json": {"state": {"some-model": model}}}
    return new_notebook(cells=[new_code_cell("1")], metadata={"widgets": states})


def test_an_error_inside_a_widget_is_found(build_book):
    assert build_book.errors_in(with_widget([ERROR])) == ["ValueError: no such coefficient"]


def test_an_error_below_a_cell_is_found(build_book):
    notebook = new_notebook(cells=[new_code_cell("1", outputs=[ERROR])])
    assert build_book.errors_in(notebook) == ["ValueError: no such coefficient"]


def test_ordinary_output_is_no_error(build_book):
    assert build_book.errors_in(with_widget([new_output("stream", text="fine")])) == []
