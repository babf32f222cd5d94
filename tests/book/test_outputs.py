"""No output of an executed page is the bare representation of a Python object."""

import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(path.stem for path in (ROOT / "book").glob("*.ipynb"))
# A call, as in Text(0, 0.5, 'error') or array([1, 2]); an object, as in <Axes: >; a list of either.
BARE = re.compile(r"\s*[\[({]*(?:[A-Za-z_][\w.]*\(|<[A-Za-z_])")


def bare(output):
    """The text of an output that has no other form and begins as a representation does, else ''."""
    forms = output.get("data", {"text/plain": output.get("text", "")})
    return forms["text/plain"] if set(forms) == {"text/plain"} and BARE.match(forms["text/plain"]) else ""


@pytest.mark.parametrize("page", PAGES)
def test_no_output_is_a_bare_representation(page):
    executed = ROOT / "build" / "book" / f"{page}.ipynb"
    if not executed.exists():
        pytest.skip("the page has not been executed here yet")
    cells = nbformat.read(executed, as_version=4).cells
    found = {cell.id: text for cell in cells for output in cell.get("outputs", []) if (text := bare(output))}
    assert found == {}, "end these cells with a semicolon, or show what a reader needs to see"
