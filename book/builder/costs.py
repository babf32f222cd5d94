"""What a run of a page costs, seconds and memory: its kernel is asked behind the last cell, and the
page keeps it."""

import json

from nbformat.v4 import new_code_cell

from . import reading

TAG = "cost-of-the-page"
# A function, so that the page's names stay as they are for the solutions of its exercises.
CELL = """def _cost():
    import json, resource, sys, time
    from psutil import Process

    own, children = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    unit = 1 if sys.platform == "darwin" else 1024
    print(json.dumps({"seconds": time.time() - Process().create_time(), "gb": max(own, children) * unit / 1e9}))


_cost()"""


def count(notebook):
    """Before exercises are put in: the minutes of reading, as on the first page."""
    notebook.metadata["minutes"] = round(reading.minutes_of_cells(notebook.cells))


def ask(notebook):
    """Before execution, behind the page's own cells."""
    notebook.cells.append(new_code_cell(CELL, metadata={"tags": [TAG]}))


def take(notebook):
    """After execution: the answer becomes the page's metadata, the cell goes."""
    for cell in [cell for cell in notebook.cells if TAG in cell.metadata.get("tags", [])]:
        notebook.cells.remove(cell)
        notebook.metadata["cost"] = json.loads(cell.outputs[0].text)


def tell(notebook):
    """Below the page's title: minutes to read it, and what its run took, of a page that was run."""
    minutes = notebook.metadata.pop("minutes", None)
    if not (cost := notebook.metadata.get("cost")):
        return
    first = notebook.cells[0]
    told = f"*{minutes} minutes to read; {cost['seconds']:.0f} seconds and {cost['gb']:.1f} GB to run.*"
    title, line, text = first.source.partition("\n")
    first.source = f"{title}\n\n{told}\n{line}{text}"


def measured(folder):
    """page -> {"seconds": from the kernel's start, "gb": its largest memory}, of the executed pages
    in a folder."""
    found = {}
    for path in sorted(folder.glob("*.ipynb")):
        metadata = json.loads(path.read_text(encoding="utf-8"))["metadata"]
        found |= {path.stem: metadata["cost"]} if "cost" in metadata else {}
    return found
