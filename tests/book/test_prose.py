"""Numbers in the text of the book are computed, or stand in literals.toml with the reason why they are not. Words that
judge are computed, or an assertion of the page says the same, or verdicts.toml has the reason."""

import ast
import json
import re
import tomllib
from pathlib import Path

import pytest
from prose import crowded, pages, text_of, typed_results, unbound_verdicts

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
LITERALS = tomllib.loads((HERE / "literals.toml").read_text(encoding="utf-8"))
VERDICTS = tomllib.loads((HERE / "verdicts.toml").read_text(encoding="utf-8"))
PAGES = pages(ROOT / "book")
TEXTS = [*PAGES, *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"))]
# Pages about the networks and the benchmark, on which every verdict is computed or asserted.
JUDGING = {
    "ldnet",
    "cpnet",
    "dbsnet",
    "dbsnetlosses",
    "dbsnetbest",
    "whennetwork",
    "modelcards",
    "benchmark",
    "fronts",
    "reference",
}
JUDGING |= {"addmethod", "addnetwork", "realcortex", "claims", "peers", "cpnetlooks", "cpnetlearned"}
MOST_EXCEPTIONS = 25
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


@pytest.mark.parametrize("reasons", [LITERALS, VERDICTS], ids=["literals", "verdicts"])
def test_exceptions_belong_to_pages_and_have_reasons(reasons):
    assert set(reasons) <= {path.stem for path in TEXTS}
    assert [
        phrase for section in reasons.values() for phrase, reason in section.items() if len(reason.split()) < 2
    ] == []


def asserted(path):
    """The phrases of a page that its code asserts: `assert here < there, "ours is faster"`."""
    if path.suffix == ".md":
        return set()
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    found = [node for source in code for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Assert)]
    return {node.msg.value for node in found if isinstance(node.msg, ast.Constant)}


BOUND = {path.stem: asserted(path) for path in PAGES}


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_words_that_judge_are_computed_or_asserted(path):
    """A text without code may use what any page asserts."""
    elsewhere = set().union(*BOUND.values()) if path.suffix == ".md" else set()
    reasons = VERDICTS.get(path.stem, {})
    unbound, unused = unbound_verdicts(text_of(path), BOUND.get(path.stem, set()) | elsewhere | set(reasons))
    assert unbound == [], 'assert it on the page, `assert one < other, "the phrase"`, or quote the word as {eval}`...`'
    assert [phrase for phrase in unused if phrase in reasons] == [], f"verdicts.toml, [{path.stem}]: not on the page"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_page_asserts_in_words_it_says(path):
    _, unused = unbound_verdicts(text_of(path), BOUND[path.stem])
    others = [unbound_verdicts(text_of(text), unused)[1] for text in TEXTS if text.suffix == ".md"]
    assert [phrase for phrase in unused if all(phrase in missing for missing in others)] == []


def test_there_are_few_exceptions_and_none_where_networks_are_judged():
    assert sum(map(len, VERDICTS.values())) <= MOST_EXCEPTIONS
    assert set(VERDICTS) & JUDGING == set()


@pytest.mark.parametrize(
    "text",
    ["the network wins", "it is faster", "the two are level", "near enough", "in a fraction of a second", "they agree"],
)
def test_a_word_that_judges_is_found(text):
    assert len(unbound_verdicts(text, ())[0]) == 1
    assert unbound_verdicts(text, [text])[0] == []


@pytest.mark.parametrize(
    "text", ["the two agree to {eval}`error`", "it is {eval}`word`", "a level of the fit", "`faster=True`"]
)
def test_other_words_are_left_alone(text):
    assert unbound_verdicts(text, ())[0] == []


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.stem)
def test_paragraphs_can_be_read_aloud(path):
    """At most three computed numbers in a sentence and five in a paragraph; the rest belongs into a table."""
    assert list(crowded(text_of(path))) == []


ONE = "{eval}`x`"


@pytest.mark.parametrize(
    "text, count",
    [
        (f"{ONE}, {ONE} and {ONE}. Then {ONE} and {ONE}.", 0),
        (f"{ONE}, {ONE}, {ONE} and {ONE}.", 1),
        (f"{ONE}, {ONE} and {ONE}. Then {ONE}, {ONE} and {ONE}.", 1),
        (f"- {ONE}, {ONE} and {ONE}.\n- {ONE}, {ONE} and {ONE}.", 0),
        (f"{ONE} {ONE} {ONE}\n\n{ONE} {ONE} {ONE}", 0),
        (f"| {ONE} | {ONE} | {ONE} | {ONE} |", 0),
        ("".join(f'{ONE} {{eval}}`says["a"]` ' for _ in range(3)), 0),
    ],
)
def test_computed_numbers_are_counted(text, count):
    assert len(list(crowded(text))) == count


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
