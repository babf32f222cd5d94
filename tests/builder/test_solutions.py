"""The solutions of exercises: their code is found, run in order, and held to what the page says it
prints."""

import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from book.builder.solutions import append, problems, remove, same_text, solutions_in

PAGE = """
:::{solution} ex-first
:class: dropdown

Words.

```python
x = 3
```

```python
print("x is", x)
```

prints

```text
x is 3
```

:::

```python
outside = "a solution"
```

::::{solution} ex-second
```python
quiet = True
```
::::
"""


def executed(prints, stdout="", stderr=""):
    outputs = [
        new_output("stream", name=name, text=text) for name, text in (("stdout", stdout), ("stderr", stderr)) if text
    ]
    return new_code_cell("", outputs=outputs, metadata={"exercise": "ex-first", "prints": prints})


def test_fences_are_found_in_order_with_what_they_print():
    assert list(solutions_in(PAGE)) == [
        ("ex-first", "x = 3\n", ""),
        ("ex-first", 'print("x is", x)\n', "x is 3\n"),
        ("ex-second", "quiet = True\n", ""),
    ]


def test_solutions_run_behind_the_page_and_are_removed_again():
    notebook = new_notebook(cells=[new_markdown_cell(PAGE), new_code_cell("x = 1")])
    append(notebook)
    assert [cell.source.splitlines()[0] for cell in notebook.cells[2:]] == [
        "# The solution of ex-first",
        "# The solution of ex-first",
        "# The solution of ex-second",
    ]
    notebook.cells[3].outputs = [new_output("stream", name="stdout", text="x is 3\n")]
    assert remove(notebook) == []
    assert [cell.source for cell in notebook.cells] == [PAGE, "x = 1"]


@pytest.mark.parametrize(
    "printed, expected",
    [
        ("x is 3", "x  is 3\n"),
        ("0.99 s", "1.00 s"),
        ("-1.01e-3", "-0.001"),
        ("3e-13", "7e-12"),
        ("mu = 0.5+0.2j", "mu = 0.5+0.2j"),
    ],
)
def test_the_same_text(printed, expected):
    assert same_text(printed, expected)


@pytest.mark.parametrize(
    "printed, expected",
    [
        ("x is 3", "y is 3"),
        ("0.97 s", "1.00 s"),
        ("0.001", "-0.001"),
        ("3e-8", "7e-8"),
        ("3 flips", "4 flips"),
        ("1 2", "1"),
        ("", "1"),
        ("1", ""),
    ],
)
def test_another_text(printed, expected):
    assert not same_text(printed, expected)


def test_a_wrong_number_names_the_exercise():
    [line] = problems(executed("x is 3\n", stdout="x is 4\n"))
    assert "ex-first" in line and "x is 4" in line and "x is 3" in line


def test_a_warning_is_a_problem():
    [line] = problems(executed("", stderr="DeprecationWarning: old"))
    assert "DeprecationWarning" in line


def test_code_without_a_text_may_not_print():
    assert len(list(problems(executed("", stdout="surprise")))) == 1
