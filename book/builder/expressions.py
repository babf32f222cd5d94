"""The numbers of the prose: {eval}`expression` in a Markdown cell is asked of the kernel while
nbmake executes the page.

Before execution `ask` puts a hidden question before each Markdown cell that quotes something, and
all questions again behind the last cell. Afterwards `store` takes the questions out and leaves the
answers where jupyterlab_myst keeps its own, in metadata.user_expressions of the Markdown cell:
JupyterLab shows them without a kernel, and Sphinx reads them (book/qcbook/sphinxpages.py).
"""

import re

from nbformat.v4 import new_code_cell

from qcbook.cells import in_powers

ASKED, CLOSING = "asked-expressions", "asked-at-the-end"
EVAL = re.compile(r"\{eval\}(`+)(.+?)\1", re.DOTALL)
QUESTION = """from IPython import get_ipython as _shell
from IPython.display import display as _display
_display({{'application/json': {answer}}}, raw=True)"""
# What qcbook.keep() was told, and in which runs of a cell: {name: [execution counts]}.
KEPT = "{n: sorted(c) for n, c in getattr(__import__('sys').modules.get('qcbook.cells'), 'kept_by', {}).items()}"


def expressions_in(source):
    return [match[2].strip().replace("\n", " ") for match in EVAL.finditer(source)]


def place(number, cell):
    """A cell as messages name it, counted from 1 as a reader counts."""
    return f"cell {number} ({cell.get('id', 'without id')})"


def question(expressions, tag, more="{}"):
    asked = {str(i): expression for i, expression in enumerate(expressions)}
    answer = f"{{'asked': _shell().user_expressions({asked!r}), 'kept': {more}}}"
    return new_code_cell(QUESTION.format(answer=answer), metadata={"tags": [tag]})


def ask(notebook):
    """Before execution: the questions before each Markdown cell, and all of them behind the page's
    last cell."""
    cells, everything = [], []
    for cell in notebook.cells:
        if cell.cell_type == "markdown" and (expressions := expressions_in(cell.source)):
            cells.append(question(expressions, ASKED))
            everything += expressions
        cells.append(cell)
    notebook.cells = [*cells, question(everything, CLOSING, KEPT)]


def answers(cell):
    """Results in the order asked, and the record of keep()."""
    data = next(o["data"]["application/json"] for o in cell.outputs if "application/json" in o.get("data", {}))
    asked = data["asked"]  # nbformat sorts keys as text (0, 1, 10, 2): read them by index
    return [asked[str(i)] for i in range(len(asked))], data["kept"]


def tagged(cell, tag):
    return tag in cell.metadata.get("tags", [])


def kept_twice(kept, runs):
    """Names that keep() was given by more than one cell; runs: execution count -> place of the
    cell."""
    for name, counts in sorted(kept.items()):
        if len(cells := [runs[count] for count in counts if count in runs]) > 1:
            yield f"{cells[-1]}: the key {name!r} was kept already by {cells[0]}; give it a name of its own"


def changed(expression, here, end):
    """What is wrong with one quoted number, or None. JupyterLab's 'Run All Cells' shows the value
    at the END of a page."""
    if here["status"] != "ok":
        return f"{{eval}} of {expression!r} fails here: {here['ename']}: {here['evalue']}"
    if end.get("data") != here["data"]:
        later = end["data"]["text/plain"] if "data" in end else f"{end['ename']}: {end['evalue']}"
        return f"{expression!r} is {here['data']['text/plain']} here and {later} at the end of the page"
    if (said := here["data"]["text/plain"]).startswith("np."):
        return f"{expression!r} reads {said}: make it a number of Python's"
    return None


def store(notebook):
    """After execution: take the questions out, move the answers into the Markdown cells; returns
    what is wrong."""
    wrong, cells, runs, waiting = [], [], {}, None
    closing = next(i for i, cell in enumerate(notebook.cells) if tagged(cell, CLOSING))
    final, kept = answers(notebook.cells[closing])
    final = iter(final)
    for cell in notebook.cells[:closing]:
        if tagged(cell, ASKED):
            waiting, _ = answers(cell)
            continue
        cells.append(cell)
        here = place(len(cells), cell)
        if cell.cell_type == "code" and cell.execution_count:
            runs[cell.execution_count] = here
        if waiting is not None:
            cell.metadata["user_expressions"] = [
                {"expression": asked, "result": result}
                for asked, result in zip(expressions_in(cell.source), waiting, strict=True)
            ]
            wrong += [
                f"{here}: {problem}"
                for entry in cell.metadata["user_expressions"]
                if (problem := changed(entry["expression"], entry["result"], next(final)))
            ]
            for entry in cell.metadata["user_expressions"]:
                data = entry["result"].get("data", {})
                if "text/plain" in data:
                    data["text/plain"] = in_powers(data["text/plain"])
            waiting = None
    notebook.cells = cells
    renumber(cells)
    return wrong + list(kept_twice(kept, runs))


def renumber(cells):
    """Execution counts without the gaps that the questions left."""
    ran = [cell for cell in cells if cell.cell_type == "code" and cell.execution_count]
    for count, cell in enumerate(ran, 1):
        cell.execution_count = count
        for output in cell.outputs:
            if "execution_count" in output:
                output.execution_count = count
