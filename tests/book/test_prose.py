"""Numbers in the text of the book are computed, or stand in literals.toml with the reason why they are not."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from prose import pages, text_of, typed_results

HERE = Path(__file__).resolve().parent
LITERALS = tomllib.loads((HERE / "literals.toml").read_text(encoding="utf-8"))
PAGES = pages(HERE.parents[1] / "book")


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_numbers_in_the_text_are_computed(path):
    typed, unused = typed_results(text_of(path), LITERALS.get(path.stem, {}))
    assert typed == [], "compute them and quote them as {eval}`...`, or give the reason in tests/book/literals.toml"
    assert unused == [], f"tests/book/literals.toml, [{path.stem}]: the page has no such phrase"


NOTEBOOKS = [path for path in PAGES if path.suffix == ".ipynb"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_that_print_a_table_say_so_to_the_site(path):
    """Else the site shows its rows as text."""
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    tables = [cell for cell in cells if re.search(r"^table\(", "".join(cell["source"]), re.MULTILINE)]
    bare = [cell["id"] for cell in tables if cell["metadata"].get("mystnb") != {"markdown_format": "myst"}]
    assert bare == [], 'give these cells the metadata {"mystnb": {"markdown_format": "myst"}}'


def test_literals_belong_to_pages_and_have_reasons():
    assert set(LITERALS) <= {path.stem for path in PAGES}
    assert [
        phrase for section in LITERALS.values() for phrase, reason in section.items() if len(reason.split()) < 2
    ] == []


@pytest.mark.parametrize(
    "text",
    [
        "an error of 0.90 mm",
        "an error of 1.4",
        "20 mm long",
        "within 5 %",
        "within 5% of it",
        "7 times faster",
        "a 3-fold gain",
        "ten times slower",
        "it takes 12 seconds",
        "it takes\n12 seconds",
        "2e-3 s",
        "(0.5)",
        "**17** and **0.93**",
        "4×",
        ":::{figure}\n:name: fig-a\n\nAn error of 0.3.\n\n:::",
        "| 0.25 |",
        "turned by 30 degrees",
    ],
)
def test_a_typed_result_is_found(text):
    assert len(typed_results(text, {})[0]) == 1


@pytest.mark.parametrize(
    "text",
    [
        'an error of {eval}`f"{num.x:.2f}"` mm',
        "for $t = 0.5$ s",
        "$$\nx = 0.5\n$$ (eq-a)",
        "`gamma=0.5`",
        "17 chapters, in 2023",
        "```python\nx = 0.5\n```",
        "see [the paper](https://doi.org/10.1016/j.x)",
        ":::{figure} _assets/v1.5.png\n:width: 0.5\n:::",
        "128 × 128 pixels",
        "fsaverage5 surface",
        "E3, chapter 4",
        "$\\mu = 0.3$ and\n$\\nu = 0.4$",
        "\\begin{align}\n0.5\n\\end{align}",
    ],
)
def test_other_numbers_are_left_alone(text):
    assert typed_results(text, {})[0] == []


def test_a_literal_explains_its_phrase_and_no_other():
    typed, unused = typed_results("2.5 mm thick,\nnot 2.5 mm wide", {"2.5 mm thick, not": "why", "7 mm": "why"})
    assert len(typed) == 1 and "wide" in typed[0] and unused == ["7 mm"]
