"""The prose of a page without formulas, code and computed numbers, and the numbers in it that look like results."""

import re
from functools import cache
from pathlib import Path

import nbformat

MASK = "\N{WHITE SQUARE}"
# In this order: what is fenced goes before what is between dollars, that before what is between backticks.
NO_PROSE = [
    # code; the fences of directives have braces behind their backticks
    r"(?s)^(?P<f>`{3,})\w*[ \t]*\n.*?^(?P=f)[ \t]*$",
    r"(?s)^(?P<m>:{3,}|`{3,})\{(?:math|code-block|bibliography|raw)\}.*?^(?P=m)[ \t]*$",
    r"(?s)\$\$.*?\$\$(?:[ \t]*\([\w:-]+\))?",
    r"(?s)\\begin\{(?P<e>align\*?|equation\*?|gather\*?)\}.*?\\end\{(?P=e)\}",
    r"\$[^$]+\$",
    r"\{[\w:-]+\}(?P<r>`+).*?(?P=r)",  # a role
    r"(?P<c>`+)(?!\{).*?(?P=c)",
    r"^:{3,}\{(?:figure|image)\}.*$",
    r"^:[\w-]+:.*$",
    r"^\([\w:-]+\)=[ \t]*$",  # a file, an option, a label
    r"(?<=\])\([^)\s]*\)",
    r"<https?://[^>]*>",
    r"https?://\S+",
    r"(?s)<!--.*?-->",
]
WORD = "two|three|four|five|six|seven|eight|nine|ten|twelve|twenty|thirty|forty|fifty|hundred|thousand|million"
UNIT = (
    "mm|cm|µm|nm|m|km|ms|µs|s|sec|min|h|seconds?|minutes?|hours?|days?|weeks?|months?|years?|kB|MB|GB|kilobytes?|"
    "megabytes?|gigabytes?|Hz|degrees?|°|millimetres?|centimetres?|metres?|milliseconds?|microseconds?|percent|per cent"
)
NUMBER = r"(?<![\w.])\d+(?:[.,]\d+)*(?:[eE][-+]?\d+)?"
RESULT = re.compile(
    rf"(?<![\w.])\d+\.\d+(?:[eE][-+]?\d+)?(?![\w.]*\d)|{NUMBER}\s?%|{NUMBER}(?:\s|-)?(?:{UNIT})(?![\w])"
    rf"|(?:{NUMBER}|\b(?:{WORD}))(?:\s|-)?(?:times|fold)\b|{NUMBER}\s?×(?!\s?\d)"
)


@cache
def text_of(path):
    if path.suffix == ".md":
        return path.read_text(encoding="utf-8")
    cells = nbformat.read(path, as_version=4).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


@cache
def prose(text):
    for pattern in NO_PROSE:
        text = re.sub(pattern, MASK, text, flags=re.MULTILINE)
    return re.sub(r"\s+", " ", text)


def typed_results(text, literals):
    """(numbers that look like results and stand in no literal, with what is around them; literals that are missing)."""
    text = prose(text)
    unused = [phrase for phrase in literals if phrase not in text]
    for phrase in sorted(literals, key=len, reverse=True):
        text = text.replace(phrase, MASK)
    return [text[max(0, match.start() - 30) : match.end() + 20] for match in RESULT.finditer(text)], unused


def pages(book):
    return sorted(path for path in Path(book).iterdir() if path.suffix in (".ipynb", ".md"))
