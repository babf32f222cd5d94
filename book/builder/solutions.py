"""The code in the solutions of a page's exercises runs after the page, and prints what the solution
says.

A ```python fence inside a {solution} runs in the page's namespace, after the page's cells and the
solutions before it. The ```text fence that follows it says what it prints; without one it has to
print nothing.

The site's pages show solutions folded, but for those of graded exercises; copies and downloads have
none. With SOLUTIONS=1 in the environment, executed pages keep those of graded exercises (`make book
SOLUTIONS=1`), and copies keep all that their pages have (`make lab SOLUTIONS=1`).
"""

import os
import re
from itertools import pairwise

from nbformat.v4 import new_code_cell

TAG = "solution-of-an-exercise"
SOLUTION = re.compile(r"^(:{3,}|`{3,})\{solution\}[ \t]+(\S+)[ \t]*\n(.*?)^\1[ \t]*$", re.DOTALL | re.MULTILINE)
FENCE = re.compile(r"^(`{3,})(\w+)[ \t]*\n(.*?)^\1[ \t]*$", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
TOLERANCE = 0.02  # relative
ROUNDING = 1e-9  # two numbers below this are both rounding errors, whatever their digits
SHOWN = os.environ.get("SOLUTIONS", "") not in ("", "0")


def solutions_in(source):
    """(exercise, code, what it prints) of each python fence in the solutions of a Markdown text."""
    for _, exercise, body in SOLUTION.findall(source):
        fences = [(language, text) for _, language, text in FENCE.findall(body)]
        for (language, text), (follows, printed) in pairwise([*fences, ("", "")]):
            if language == "python":
                yield exercise, text, printed if follows == "text" else ""


def without(text, labels=None):
    """A text without the solutions of the exercises that are labelled so, without any where no
    labels are given."""

    def kept(match):
        return "" if labels is None or match[2] in labels else match[0]

    found = SOLUTION.sub(kept, text)
    return text if found == text else re.sub(r"\n{3,}", "\n\n", found).strip()


def append(notebook):
    """Before execution, behind everything else: one cell for each python fence."""
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    for exercise, code, printed in (solution for text in texts for solution in solutions_in(text)):
        about = {"tags": [TAG], "exercise": exercise, "prints": printed}
        # nbmake shows the cell when it fails: its first line says where it comes from.
        notebook.cells.append(new_code_cell(f"# The solution of {exercise}\n{code}", metadata=about))


def same_text(printed, expected):
    """Words equal, numbers within TOLERANCE of the larger one."""
    if NUMBER.sub("#", printed).split() != NUMBER.sub("#", expected).split():
        return False
    return all(
        abs(a - b) <= TOLERANCE * max(abs(a), abs(b)) or max(abs(a), abs(b)) < ROUNDING
        for a, b in zip(map(float, NUMBER.findall(printed)), map(float, NUMBER.findall(expected)), strict=True)
    )


def remove(notebook):
    """After execution: take the cells out again; returns what is wrong."""
    cells, ours = [], []
    for cell in notebook.cells:
        (ours if TAG in cell.metadata.get("tags", []) else cells).append(cell)
    notebook.cells = cells
    return [line for cell in ours for line in problems(cell)]


def problems(cell):
    """What an executed solution printed and should not have, or should have and did not."""
    where = f"solution of {cell.metadata['exercise']}"
    streams = {
        name: "".join(o.text for o in cell.outputs if o.output_type == "stream" and o.name == name)
        for name in ("stdout", "stderr")
    }
    if streams["stderr"]:
        yield f"{where}: it warns:\n{streams['stderr']}"
    if not same_text(streams["stdout"], cell.metadata["prints"]):
        yield (
            f"{where}: it prints\n{streams['stdout'].rstrip()}\n"
            f"  where the page says\n{cell.metadata['prints'].rstrip()}\n"
            f"  (words exactly, numbers within {TOLERANCE:.0%})"
        )
