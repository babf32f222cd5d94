"""What the pages of the book refer to: chapters, labels with their numbers, and the literature.

The numbers are counted here as Sphinx and JupyterLab count them: labelled equations, figures,
exercises, and each kind of theorem by itself, from 1 on each page, with the chapter's number in
front.
"""

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import nbformat
import yaml
from pybtex.database import parse_file
from pybtex.plugin import find_plugin

from . import graded

BOOK = Path(__file__).resolve().parents[2] / "book"
CODE = re.compile(r"^(?P<fence>`{3,})\w*[ \t]*\n.*?^(?P=fence)[ \t]*$", re.DOTALL | re.MULTILINE)
COUNTED = re.compile(
    r"\$\$(?s:(?!\$\$).)*\$\$(?:[ \t]*\((?P<equation>[\w:-]+)\))?"
    r"|^(?::{3,}|`{3,})\{(?P<directive>[\w:-]+)\}(?P<title>.*)\n(?P<options>(?:[ \t]*\n)*(?::[\w-]+:.*\n)*)"
    r"|^\((?P<section>[\w:-]+)\)=[ \t]*\n+(?:#+[ \t]+(?P<heading>.*))?",
    re.MULTILINE,
)
OPTION = re.compile(r"^:(label|name|nonumber):[ \t]*(\S*)", re.MULTILINE)


@dataclass(frozen=True)
class Target:
    page: str
    kind: str  # equation, figure, theorem, ..., section
    # What a reference without words of its own says: (3.1), Fig. 3.1, Theorem 3.1, the heading.
    text: str


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


def shown(kind, number):
    return (
        f"({number})"
        if kind == "equation"
        else f"Fig. {number}"
        if kind == "figure"
        else f"{kind.capitalize()} {number}"
    )


def numbered(text, page, chapter):
    """(label or None, Target) of everything on a page that has a number or a label, in order."""
    counts, front = Counter(), f"{chapter}." if chapter else ""
    for match in COUNTED.finditer(CODE.sub("", text)):
        if match["section"]:
            yield (
                match["section"],
                Target(page, "section", (match["heading"] or match["section"]).strip()),
            )
            continue
        options = dict(OPTION.findall(match["options"] or ""))
        label = match["equation"] or options.get("label") or options.get("name")
        kind = (match["directive"] or "equation").removeprefix("prf:")
        kind = "equation" if kind == "math" else kind
        if kind == "proof" or "nonumber" in options or (kind == "equation" and not label):
            continue
        if kind in ("equation", "figure", "table", "exercise") or (
            match["directive"] or ""
        ).startswith("prf:"):
            counts[kind] += 1
            yield label, Target(page, kind, shown(kind, f"{front}{counts[kind]}"))
        elif label:
            yield label, Target(page, "section", match["title"].strip() or label)


def labels(book=BOOK):
    """label -> Target, of the whole book."""
    return {
        label: target
        for page, chapter in chapters(book).items()
        for label, target in numbered(markdown_of(page, book), page, chapter)
        if label
    }


class Literature:
    """The entries of references.bib: as a citation in the text and as a list."""

    def __init__(self, path=BOOK / "references.bib"):
        self.entries = parse_file(str(path))

    def authors(self, key):
        people = self.entries.entries[key].persons
        names = [
            "".join(part.render_as("text") for part in person.rich_last_names)
            for person in people.get("author") or people["editor"]
        ]
        return " and ".join(names) if len(names) < 3 else f"{names[0]} *et al.*"

    def cited(self, key, in_sentence):
        """Guo et al. [2023] in a sentence, Guo et al., 2023 in brackets."""
        if key not in self.entries.entries:
            raise KeyError(f"references.bib has no entry {key!r}")
        year = self.entries.entries[key].fields["year"]
        return (
            f"{self.authors(key)} \\[{year}\\]" if in_sentence else f"{self.authors(key)}, {year}"
        )

    def listed(self, keys):
        """A Markdown list of the entries named, by author."""
        style, backend = (
            find_plugin("pybtex.style.formatting", "plain")(),
            find_plugin("pybtex.backends", "markdown")(),
        )
        formatted = style.format_bibliography(self.entries, sorted(keys))
        return "\n".join(f"- {' '.join(entry.text.render(backend).split())}" for entry in formatted)
