"""What a page may not do: a figure without its caption, a caption without its figure."""

import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import guards

SHOW = 'keep(n=1)\nshow_figure(fig, "fig-a", "A curve.")'
CAPTION = ":::{figure}\n:name: fig-a\n\nA caption.\n\n:::\n"


def found(*cells):
    kinds = [new_markdown_cell if "{figure}" in cell or cell == "Text." else new_code_cell for cell in cells]
    made = [kind(cell, id=f"c{i}") for i, (kind, cell) in enumerate(zip(kinds, cells), 1)]
    return list(guards.figures(new_notebook(cells=made)))


def test_a_figure_with_its_caption_is_right_and_one_with_a_file_needs_no_cell():
    assert found(SHOW, CAPTION + "Text.", 'show_figure(fig, "fig-b", "b")', CAPTION.replace("fig-a", "fig-b")) == []
    assert found("1", ":::{figure} _assets/a.svg\n:name: fig-a\n\nA caption.\n\n:::") == []


@pytest.mark.parametrize("cells, says", [
    ([SHOW, "Text."], "cell 2 (c2): it has to open with the caption of the figure 'fig-a'"),
    (["1", CAPTION], "cell 2 (c2): the caption 'fig-a' does not stand below its figure"),
    ([SHOW + "\nprint(1)", CAPTION], "cell 1 (c1): show_figure(...) has to be its last statement"),
])  # fmt: skip
def test_a_mistake_is_named(cells, says):
    assert says in "\n".join(found(*cells))


def test_a_picture_that_nobody_describes_is_named():
    plain = new_output("display_data", data={"image/png": ""})
    named = new_output("display_data", data={"image/png": ""}, metadata={"scrapbook": {"name": "fig-a"}})
    notebook = new_notebook(cells=[new_code_cell("plt.show()", outputs=[plain]), new_code_cell(SHOW, outputs=[named])])
    assert len(list(guards.pictures_without_a_name(notebook))) == 1
