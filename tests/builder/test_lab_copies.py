"""Copies of pages for reading: what JupyterLab does not know becomes text, and what a reader
changed is not lost."""

import json

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder import lab_copies
from book.builder.plain import for_plain_viewers
from book.builder.readable import Readable, as_notebook, for_jupyterlab
from book.builder.references import Literature, Target

TARGETS = {
    "eq-here": Target("here", "equation", "(2.1)"),
    "eq-there": Target("there", "equation", "(3.4)"),
    "fig-there": Target("there", "figure", "Fig. 3.1"),
    "thm-there": Target("there", "theorem", "Theorem 3.2"),
    "ex-here": Target("here", "exercise", "Exercise 2.1"),
    "erratum-3": Target("errata", "section", "E3 The weight"),
}


@pytest.fixture(scope="module")
def literature():
    return Literature()


@pytest.fixture
def lab(literature):
    return Readable("here", TARGETS, literature).text


@pytest.mark.parametrize(
    "source, copy",
    [
        ("By {eq}`eq-here`.", "By {eq}`eq-here`."),
        ("By {eq}`eq-there`.", "By [(3.4)](there.ipynb)."),
        ("By {prf:ref}`the theorem <thm-there>`.", "By [the theorem](there.ipynb)."),
        (
            "In {numref}`picture %s <fig-there>` and {numref}`fig-there`.",
            "In [picture 3.1](there.ipynb) and [Fig. 3.1](there.ipynb).",
        ),
        (
            "See [E3](#erratum-3) and [this](#eq-here).",
            "See [E3](errata.ipynb) and [this](#eq-here).",
        ),
        (
            "A {term}`gyrus`, two {term}`sulci <sulcus>`.",
            "A [gyrus](glossary.ipynb), two [sulci](glossary.ipynb).",
        ),
        ("{eval}`n` [notes](notation.md)", "{eval}`n` [notes](notation.ipynb)"),
        ("{cite:t}`guo2023automatic` say", "[Guo *et al.* \\[2023\\]](bibliography.ipynb) say"),
        (
            "{cite:p}`guo2023automatic,pinkall1993computing`",
            "\\[[Guo *et al.*, 2023](bibliography.ipynb), [Pinkall and Polthier, "
            "1993](bibliography.ipynb)\\]",
        ),
        ("```text\n{eq}`eq-there`\n```", "```text\n{eq}`eq-there`\n```"),
    ],
)
def test_what_jupyterlab_does_not_know_becomes_text_with_a_link(lab, source, copy):
    assert lab(source) == copy


def test_a_reference_that_sphinx_writes_becomes_its_names():
    text = "```{eval-rst}\n.. currentmodule:: qclearn\n.. autofunction:: register\n```\n"
    (cell,) = as_notebook(text).cells
    assert (
        cell.source.startswith("`register`: the site has the text.")
        and "{eval-rst}" not in cell.source
    )


def test_the_bibliography_is_listed(lab):
    listed = lab("# Bibliography\n\n```{bibliography}\n```\n")
    assert "{bibliography}" not in listed and "- Yuchen Guo" in listed


@pytest.mark.parametrize(
    "source, says", [("{eq}`eq-nowhere`", "eq-nowhere"), ("{cite:p}`nobody`", "nobody")]
)
def test_what_leads_nowhere_is_named(lab, source, says):
    with pytest.raises(KeyError, match=says):
        lab(source)


def executed():
    value = {"status": "ok", "data": {"text/plain": "'0.5'"}}
    text = (
        "# Here\n\n$$ x $$ (eq-here)\n\nFrom {eq}`eq-here`: {eval}`n` by "
        "{cite:t}`guo2023automatic`.\n\n"
        ":::{prf:theorem} Name\n:label: thm-here\n\nText.\n\n:::\n\n"
        ":::{prf:proof}\n\nShort.\n\n:::\n\n"
        ":::{exercise} Title\n:label: ex-here\n\nDo.\n\n:::\n\n"
        ":::{solution} ex-here\n:class: dropdown\n\n```python\nprint(':::')\n```\n\n:::\n"
    )
    picture = new_output(
        "display_data", data={"image/png": "aGk=", "text/html": "<img>", "text/plain": "words"}
    )
    caption = ":::{figure}\n:name: fig-here\n\nA caption.\n\n:::\n\nMore."
    return new_notebook(
        cells=[
            new_markdown_cell(
                text, metadata={"user_expressions": [{"expression": "n", "result": value}]}
            ),
            new_code_cell("keep(n=1)", metadata={"tags": ["hide-input"]}, outputs=[picture]),
            new_markdown_cell(caption),
        ]
    )


def test_the_lab_copy_counts_as_the_book_and_folds_what_is_hidden(literature):
    notebook = for_jupyterlab(executed(), Readable("here", TARGETS, literature), 2)
    front = notebook.cells[0].source.split("---\n")[1]
    assert (
        "enumerator: 2.%s" in front
        and "proof:theorem" in front
        and "# Here" in notebook.cells[0].source
    )
    assert ":::{prf:proof}\n:nonumber: true\n" in notebook.cells[0].source
    assert notebook.cells[2].source.startswith(":::{figure}\n:class: not-prose\n:name: fig-here\n")
    assert notebook.cells[1].metadata["jupyter"]["source_hidden"]
    assert notebook.cells[0].metadata.user_expressions


@pytest.mark.parametrize("make", [for_jupyterlab, for_plain_viewers])
def test_references_in_tables_that_cells_made_become_links_to_pages(literature, make):
    output = new_output(
        "execute_result", data={"text/markdown": "| [E3](#erratum-3) |"}, execution_count=1
    )
    notebook = new_notebook(
        cells=[new_markdown_cell("# Here"), new_code_cell("table()", outputs=[output])]
    )
    made = make(
        notebook, Readable("here", TARGETS, literature, plain=make is for_plain_viewers), None
    )
    assert made.cells[1].outputs[0].data["text/markdown"] == "| [E3](errata.ipynb) |"


def test_the_plain_copy_has_neither_role_nor_directive(literature):
    notebook = for_plain_viewers(executed(), Readable("here", TARGETS, literature, plain=True), 2)
    first, code, caption = (cell.source for cell in notebook.cells)
    assert code == "keep(n=1)" and notebook.cells[1].metadata["jupyter"]["source_hidden"]
    assert set(notebook.cells[1].outputs[0].data) == {"image/png", "text/plain"}
    assert "user_expressions" not in notebook.cells[0].metadata
    assert "From (2.1): 0.5 by [Guo" in first and "\\tag{2.1}" in first
    assert "**Theorem 2.1** (Name)\n" in first and "**Exercise 2.1** (Title)\n" in first
    assert "**Solution of Exercise 2.1**\n" in first and "print(':::')" in first
    assert caption.startswith("**Fig. 2.1.** A caption.\n") and caption.endswith("More.\n")
    assert not [line for line in (first + caption).splitlines() if line.startswith(":")]


def copies(folder, stamps, text="page"):
    return lab_copies.write_copies(folder, stamps, lambda page: as_notebook(f"{text} {page}"))


def text_of(path):
    return nbformat.read(path, as_version=4).cells[0].source


def test_only_what_is_older_is_made(tmp_path):
    assert copies(tmp_path, {"a": "1", "b": "1"}) == ["a", "b"]
    assert copies(tmp_path, {"a": "1", "b": "2"}, "new") == ["b"]
    assert [text_of(tmp_path / name) for name in ("a.ipynb", "b.ipynb")] == ["page a", "new b"]


def test_what_a_reader_changed_is_kept_beside_the_new_copy(tmp_path, capsys):
    copies(tmp_path, {"a": "1"})
    for turn in ("mine", "mine-2"):
        (tmp_path / "a.ipynb").write_text(nbformat.writes(as_notebook(turn)), encoding="utf-8")
        assert copies(tmp_path, {"a": turn}) == ["a"]
        assert f"a-{turn}.ipynb" in capsys.readouterr().err
        assert (
            text_of(tmp_path / f"a-{turn}.ipynb") == turn
            and text_of(tmp_path / "a.ipynb") == "page a"
        )


def test_what_a_reader_changed_stays_while_its_page_does(tmp_path, capsys):
    copies(tmp_path, {"a": "1"})
    (tmp_path / "a.ipynb").write_text(nbformat.writes(as_notebook("mine")), encoding="utf-8")
    assert copies(tmp_path, {"a": "1"}) == []
    assert text_of(tmp_path / "a.ipynb") == "mine" and capsys.readouterr().err == ""


def test_a_copy_that_was_only_run_is_replaced(tmp_path):
    cells = [new_code_cell("1")]
    lab_copies.write_copies(tmp_path, {"a": "1"}, lambda page: new_notebook(cells=cells))
    ran = new_notebook(cells=[new_code_cell("1", execution_count=7)], metadata={"widgets": {}})
    (tmp_path / "a.ipynb").write_text(nbformat.writes(ran), encoding="utf-8")
    assert copies(tmp_path, {"a": "2"}) == ["a"] and list(tmp_path.glob("*-mine*")) == []


def test_a_deleted_copy_and_a_lost_record_are_no_trouble(tmp_path):
    copies(tmp_path, {"a": "1", "b": "1"})
    (tmp_path / "a.ipynb").unlink()
    assert copies(tmp_path, {"a": "1", "b": "1"}) == ["a"]
    (tmp_path / lab_copies.RECORD).write_text(json.dumps({}))
    assert copies(tmp_path, {"a": "1"}) == ["a"] and (tmp_path / "a-mine.ipynb").exists()


def test_a_copy_that_is_no_notebook_any_more_is_kept(tmp_path):
    copies(tmp_path, {"a": "1"})
    (tmp_path / "a.ipynb").write_text("half a file", encoding="utf-8")
    assert (
        copies(tmp_path, {"a": "2"}) == ["a"]
        and (tmp_path / "a-mine.ipynb").read_text() == "half a file"
    )
