"""Cells on the site: a folded cell that prints nothing has no bar of its own."""

from types import SimpleNamespace

from docutils import nodes
from docutils.utils import new_document

from qcbook.sphinxpages import JoinFolded, escape_text, mark_silent


def cell(code, folded, prints=False):
    made = nodes.container(nb_element="cell_code")
    made += nodes.container("", nodes.literal_block(code, code), nb_element="cell_code_source")
    if prints:
        made += nodes.container(nb_element="cell_code_output")
    if folded:
        made["hide_mode"] = "input"
    return made


def joined(*cells):
    page = new_document("page")
    page.extend(cells)
    mark_silent(None, page)
    numbers = {"page": {"figure": {"fig-a": (3, 1)}}}
    page.settings.env = SimpleNamespace(toc_fignumbers=numbers, docname="page")
    JoinFolded(page).run()
    return [(one.get("hide_mode"), [block.astext() for block in one.children[0]]) for one in page]


def test_the_bar_of_a_folded_cell_names_what_it_makes():
    cells = [
        cell('show_figure(a, "fig-a", "words")', True, True),
        *(cell("a", True, True) for _ in range(4)),
        cell("b", True),
    ]
    for one, made in zip(cells[1:], ("12", "<table>", "<iframe>", "<div class=qc-live>"), strict=False):
        one.children[1] += nodes.raw(made, made, format="html")
    joined(*cells)
    made = (
        "Fig. 3.1",
        "the output below",
        "the table below",
        "the picture below",
        "the explorable below",
        "the numbers in the text",
    )
    assert [one.get("prompt_show") for one in cells] == [f"Show the code of {what}" for what in made]


def test_a_folded_cell_that_prints_nothing_joins_the_next_folded_one_but_not_across_visible_code():
    cells = cell("a = 1", True), cell("b = 2", True), cell("print(a)", True, True), cell("c", True)
    assert joined(*cells) == [("input", ["a = 1", "b = 2", "print(a)"]), ("input", ["c"])]
    cells = cell("a = 1", True), cell("b = 2", False), cell("print(a)", True, True)
    assert joined(*cells) == [("input", ["a = 1"]), (None, ["b = 2"]), ("input", ["print(a)"])]


def test_shell_lines_of_a_help_text_are_code_and_stay_as_they_are():
    help_text = ["On a*b:", "", "|     run $A_/*.gii \\", "|       --out `b`", ""]
    help_text += ["| word:  the `name`", "|         and a*b"]
    escape_text(None, None, help_text)
    block = [".. code-block:: shell", "", "    run $A_/*.gii \\", "      --out `b`", ""]
    assert help_text == ["On a\\*b:", "", *block, "| word:  the ``name``", "|         and a\\*b"]
