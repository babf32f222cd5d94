"""How long a page is to read: words, displayed equations and lines of visible code, each at its own
pace."""

import re

import nbformat

from .references import BOOK, CODE
from .solutions import SOLUTION

WORDS, EQUATIONS, LINES = 150, 0.67, 5  # a minute
FOLDED = re.compile(r"^(:{3,}|`{3,})\{\w+\}[^\n]*\n:class:[^\n]*\bdropdown\b.*?^\1[ \t]*$", re.DOTALL | re.MULTILINE)
EQUATION = re.compile(
    r"\$\$.*?\$\$(?:[ \t]*\([\w:-]+\))?|^(:{3,}|`{3,})\{math\}.*?^\1[ \t]*$", re.DOTALL | re.MULTILINE
)
# What no reader reads: fences, options, labels, names of roles, where a link leads.
MARKS = re.compile(r"^(?::{3,}|`{3,})\S*|^:[\w-]+:.*$|^\([\w:-]+\)=$|\{[\w:]+\}(?=`)|(?<=\])\([^)\s]*\)", re.MULTILINE)
WORD = re.compile(r"[^\W_]+(?:['’.-]\w+)*")


def minutes_of_text(text):
    """Of Markdown text, what is folded left out; code in fences is read as code."""
    text = FOLDED.sub("", SOLUTION.sub("", text))
    lines = sum(max(len(match[0].splitlines()) - 2, 0) for match in CODE.finditer(text))
    text = CODE.sub("", text)
    equations = len(EQUATION.findall(text))
    words = len(WORD.findall(MARKS.sub("", re.sub(r"`+[^`]*`+|\$[^$]+\$", " x ", EQUATION.sub("", text)))))
    return words / WORDS + equations / EQUATIONS + lines / LINES


def minutes(page, book=BOOK):
    """Minutes of a page of the book; code that is hidden costs none."""
    if (path := book / f"{page}.md").exists():
        return minutes_of_text(path.read_text(encoding="utf-8"))
    total = 0
    for cell in nbformat.read(book / f"{page}.ipynb", as_version=4).cells:
        if cell.cell_type == "markdown":
            total += minutes_of_text(cell.source)
        elif "hide-input" not in cell.metadata.get("tags", []):
            total += len(cell.source.splitlines()) / LINES
    return total
