"""The build sees an error that a widget's callback hid from nbmake."""

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
