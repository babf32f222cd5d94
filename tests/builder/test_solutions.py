"""The solutions of exercises: their code is found, run in order, and held to what the page says it prints."""

import re

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


def test_fences_are_found_in_order_with_what_they_print():
    assert list(solutions_in(PAGE)) == [
        ("ex-first", "x = 3\n", ""),
        ("ex-first", 'print("x is", x)\n', "x is 3\n"),
        ("ex-second", "quiet = True\n", ""),
    ]


def test_solutions_run_behind_the_page_and_are_removed_again():
    notebook = new_notebook(cells=[new_markdown_cell(PAGE), new_code_cell("x = 1")])
    append(notebook)
    heads = [cell.source.splitlines()[0] for cell in notebook.cells[2:]]
    assert heads == [f"# The solution of {name}" for name in ("ex-first", "ex-first", "ex-second")]
    notebook.cells[3].outputs = [new_output("stream", name="stdout", text="x is 3\n")]
    assert remove(notebook) == []
    assert [cell.source for cell in notebook.cells] == [PAGE, "x = 1"]


SAME = [
    ("x is 3", "x  is 3\n"), ("0.99 s", "1.00 s"), ("-1.01e-3", "-0.001"), ("3e-13", "7e-12"), ("0.5+0.2j", "0.5+0.2j"),
]  # fmt: skip
OTHER = [("x is 3", "y is 3"), ("0.97 s", "1.00 s"), ("0.001", "-0.001"), ("3e-8", "7e-8"), ("3 flips", "4 flips")]


def test_the_same_text_has_the_same_words_and_near_numbers():
    assert [pair for pair in SAME if not same_text(*pair)] == []
    assert [pair for pair in [*OTHER, ("1 2", "1"), ("", "1"), ("1", "")] if same_text(*pair)] == []


@pytest.mark.parametrize("prints, stream, text, told", [
    ("x is 3\n", "stdout", "x is 4\n", "ex-first.*x is 4.*x is 3"),
    ("", "stderr", "DeprecationWarning: old", "DeprecationWarning"),
    ("", "stdout", "surprise", "surprise"),  # code without a text may not print
])  # fmt: skip
def test_what_a_solution_should_not_print_is_a_problem(prints, stream, text, told):
    output = new_output("stream", name=stream, text=text)
    [line] = problems(new_code_cell("", outputs=[output], metadata={"exercise": "ex-first", "prints": prints}))
    assert re.search(told, line, re.DOTALL)
