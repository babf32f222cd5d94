"""The numbers of the prose: asked as the page is executed, stored in its Markdown cells, of one value a page."""

import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import expressions
from qcbook.cells import in_powers


def result(text):
    return {"status": "ok", "data": {"text/plain": text}, "metadata": {}}


FAILURE = {"status": "error", "ename": "AttributeError", "evalue": "no 'count'"}


def executed(*cells, answers, end, kept=None):
    """The notebook as nbmake would leave it: each question answered by the next of `answers`, at the end by `end`."""
    notebook = new_notebook(cells=list(cells))
    expressions.ask(notebook)
    given = [*answers, end]
    for count, cell in enumerate((cell for cell in notebook.cells if cell.cell_type == "code"), 1):
        cell.execution_count = count
        if cell.metadata.get("tags"):
            asked = {str(i): answer for i, answer in enumerate(given.pop(0))}
            data = {"application/json": {"asked": dict(sorted(asked.items())), "kept": kept or {}}}
            cell.outputs = [new_output("display_data", data=data)]
    return notebook


def test_expressions_are_found_whatever_their_quotes():
    text = 'From {eval}`n` to {eval}`f"{num.x:.2f}"`, {eval}``a["`"]``.'
    assert expressions.expressions_in(text) == ["n", 'f"{num.x:.2f}"', 'a["`"]']


def test_answers_are_stored_where_jupyterlab_reads_them():
    texts = "".join(f"{{eval}}`x{i}` " for i in range(11))  # eleven: the keys 0, 1, 10, 2 are not in their order
    values = [result(str(i)) for i in range(11)]
    notebook = executed(new_code_cell("1"), new_markdown_cell(texts), new_code_cell("2"), answers=[values], end=values)
    assert expressions.store(notebook) == []
    assert [cell.source for cell in notebook.cells] == ["1", texts, "2"]
    assert [cell.execution_count for cell in notebook.cells[::2]] == [1, 2]
    stored = [(e["expression"], e["result"]["data"]["text/plain"]) for e in notebook.cells[1].metadata.user_expressions]
    assert stored == [(f"x{i}", str(i)) for i in range(11)]


def test_a_failing_expression_is_named_with_its_cell():
    notebook = executed(
        new_code_cell("1"), new_markdown_cell("{eval}`num.count`", id="prose"), answers=[[FAILURE]], end=[result("1")]
    )
    [line] = expressions.store(notebook)
    assert line.startswith("cell 2 (prose): ") and "num.count" in line and "AttributeError" in line


@pytest.mark.parametrize("end, told", [(result("2"), "'n' is 1 here and 2 at the end"), (FAILURE, "AttributeError")])
def test_a_value_that_changes_later_or_is_gone_is_named(end, told):
    notebook = executed(new_markdown_cell("{eval}`n`"), answers=[[result("1")]], end=[end])
    [line] = expressions.store(notebook)
    assert told in line


def test_a_number_of_numpys_is_named():
    notebook = executed(new_markdown_cell("{eval}`n`"), answers=[[result("np.int64(1)")]], end=[result("np.int64(1)")])
    [line] = expressions.store(notebook)
    assert "'n' reads np.int64(1)" in line


def test_a_key_kept_by_two_cells_is_named():
    cells = new_code_cell("keep(**a)", id="first"), new_code_cell("keep(**b)", id="second")
    [line] = expressions.store(executed(*cells, answers=[], end=[], kept={"error": [1, 2], "size": [2]}))
    assert line.startswith("cell 2 (second): ") and "'error'" in line and "cell 1 (first)" in line


def test_powers_of_ten_are_written_as_a_reader_writes_them():
    written = {"1e-03": "10⁻³", "0e+00": "0", "2.0e+00": "2.0", "x1e-03": "x1e-03"}
    written["'3e-05 mm'"] = "'3\u00a0×\u00a010⁻⁵ mm'"
    assert {text: in_powers(text) for text in written} == written
