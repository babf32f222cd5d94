"""Numbers in the text of the book are computed, or stand in literals.toml with the reason why they are not."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from prose import pages, text_of, typed_results

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
LITERALS = tomllib.loads((HERE / "literals.toml").read_text(encoding="utf-8"))
PAGES = pages(ROOT / "book")
TEXTS = [*PAGES, *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"))]
NOTEBOOKS = [path for path in PAGES if path.suffix == ".ipynb"]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_numbers_in_the_text_are_computed(path):
    typed, unused = typed_results(text_of(path), LITERALS.get(path.stem, {}))
    assert typed == [], "compute them and quote them as {eval}`...`, or give the reason in tests/book/literals.toml"
    assert unused == [], f"tests/book/literals.toml, [{path.stem}]: the page has no such phrase"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_that_print_a_table_say_so_to_the_site(path):
    """Else the site shows its rows as text."""
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    tables = [cell for cell in cells if re.search(r"^table\(", "".join(cell["source"]), re.MULTILINE)]
    bare = [cell["id"] for cell in tables if cell["metadata"].get("mystnb") != {"markdown_format": "myst"}]
    assert bare == [], 'give these cells the metadata {"mystnb": {"markdown_format": "myst"}}'


def test_exceptions_belong_to_pages_and_have_reasons():
    assert set(LITERALS) <= {path.stem for path in TEXTS}
    reasons = [(phrase, reason) for section in LITERALS.values() for phrase, reason in section.items()]
    assert [phrase for phrase, reason in reasons if len(reason.split()) < 2] == []


def test_a_typed_result_is_found_and_a_computed_one_is_left_alone():
    (found,), _ = typed_results('an error of 0.90 mm, computed: {eval}`f"{num.x:.2f}"` mm', {})
    assert "0.90 mm" in found
