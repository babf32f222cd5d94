"""What the contents and the sources of the book hold: chapters, and the text of a page."""

import re
from pathlib import Path

import nbformat
import yaml

from . import graded

BOOK = Path(__file__).resolve().parents[2] / "book"
CODE = re.compile(r"^(?P<fence>`{3,})\w*[ \t]*\n.*?^(?P=fence)[ \t]*$", re.DOTALL | re.MULTILINE)
# What gives a place its label: an equation, a directive, or the line above a heading or a
# paragraph.
LABEL = re.compile(r"\$\$[ \t]*\(([\w:-]+)\)|^:(?:label|name):[ \t]*(\S+)|^\(([\w:-]+)\)=", re.MULTILINE)


def pages_of(contents):
    """(page, number of the chapter or None) in the order of a _toc.yml."""
    listed, chapter = [(contents["root"], None)], 0
    for part in contents.get("parts", []):
        for entry in part["chapters"]:
            chapter += bool(part.get("numbered"))
            listed.append((entry["file"], chapter if part.get("numbered") else None))
    return listed


def chapters(book=BOOK):
    """page -> number of its chapter, None for a page without one; in the order of the contents."""
    return dict(pages_of(yaml.safe_load((book / "_toc.yml").read_text(encoding="utf-8"))))


def markdown_of(page, book=BOOK):
    path = book / f"{page}.ipynb"
    if not path.exists():
        return (book / f"{page}.md").read_text(encoding="utf-8")
    cells = nbformat.read(path, as_version=4).cells
    return graded.put("\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown"))


def labels(page, book=BOOK):
    """(label, where its mark ends in the text) of a page, in order."""
    text = CODE.sub(lambda match: " " * len(match[0]), markdown_of(page, book))
    return [(match[match.lastindex], match.end()) for match in LABEL.finditer(text)]
