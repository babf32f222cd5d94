"""Slides made of tagged cells of the pages: reveal.js with the book's own pictures, formulas and
explorables.

A cell tagged `slide-NAME` begins a slide of the deck NAME, one tagged `more-NAME` goes on with the
last one. Of a cell's text, `slide-` takes what stands below its first heading and `more-` what
stands above it. A slide has the formulas, lists, tables and statements of that text, the first
sentence of each other paragraph, and all of it as the speaker's notes. `make decks` writes
build/decks, and `make book` the same slides beside the site.
"""

import argparse
import html
import json
import re
import shutil
from functools import cache

import nbformat
import yaml
from nbconvert.filters.markdown_mistune import markdown2html_mistune

from qcbook.sphinxpages import EXPLORABLE

from . import export_live, lab_copies
from .execute_pages import BUILD, ROOT, SOURCE, execute_outdated
from .plain import for_plain_viewers
from .readable import Readable
from .references import BOOK, CODE, chapters

TITLES = {
    "opening": "Registering cortical surfaces",
    "lbs": "The Linear Beltrami Solver, and its errata",
    "networks": "Do networks pay?",
}
DECKS = BUILD / "decks"
TAG = re.compile(r"(slide|more)-(\w+)")
HEADING = re.compile(r"^#+[ \t]+(.+)$", re.MULTILINE)
LINK = re.compile(r"\[([^\]]*)\]\([\w./#-]+\)")
# What no slide shows: proofs, what is folded, and what a chapter promises.
LEFT_OUT = re.compile(
    r"^(:{3,}|`{3,})\{(?:prf:proof\}|admonition\} (?:After|Think|Answers|Box)|solution\}|exercise\}).*?^\1[ \t]*$",
    re.DOTALL | re.MULTILINE,
)
STATEMENT = re.compile(
    r"^(:{3,}|`{3,})\{(?:prf:\w+|admonition)\}.*?^\1[ \t]*$", re.DOTALL | re.MULTILINE
)
STATED = "\N{WORD JOINER}"  # before each paragraph of a statement
PARAGRAPH = re.compile(r"(?<=\n\n)(?=[^\s:$`|*-])")
# How a block begins that is shown whole.
WHOLE = re.compile(rf"\$\$|\*\*|[-|*] |\d+\. |```|<|{STATED}")
SENTENCE = re.compile(r"\$[^$]+\$|`[^`]+`|(?P<end>[.!?])(?=\s|$)")
KEPT = (
    "live",
    "vendor/mathjax",
    "vendor/reveal",
    "vendor/licenses",
)  # of the site's assets, beside single files
PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<link rel="icon" href="{static}/favicon.svg"><link rel="stylesheet" href="{static}/vendor/reveal/reveal.css">
<link rel="stylesheet" href="{static}/live/live.css"><link rel="stylesheet" href="{static}/decks.css">
<script>window.MathJax = {mathjax};</script>
<script defer src="{static}/vendor/mathjax/startup.js"></script>
<script type="module" async src="{static}/live/page.js" data-explorables="{explorables}" data-carried=""></script>
</head>
<body>
<div class="reveal"><div class="slides">
<section><h1>{title}</h1><p>{book}</p></section>
{slides}
</div></div>
<script src="{static}/vendor/reveal/reveal.js"></script><script src="{static}/decks.js"></script>
</body>
</html>
"""


@cache
def settings():
    return yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))


def mathjax():
    """The site's settings of MathJax, and the signs that the slides' formulas stand between."""
    tex = {"inlineMath": [["$", "$"]], "displayMath": [["$$", "$$"]], "tags": "none"}
    return settings()["sphinx"]["config"]["mathjax3_config"] | {"tex": tex}


def tagged(cell):
    """deck -> "slide" or "more", of a cell."""
    return [
        match.groups()[::-1] for match in map(TAG.fullmatch, cell.metadata.get("tags", [])) if match
    ]


def pages():
    """The pages that have slides, in the order of the contents."""
    names = [page for page in chapters() if (BOOK / f"{page}.ipynb").exists()]
    return [
        page
        for page in names
        if any(map(tagged, nbformat.read(BOOK / f"{page}.ipynb", as_version=4).cells))
    ]


def plain(page, copies):
    """An executed page as plain Markdown, without what no slide shows."""
    notebook = copies.executed(page)
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            cell.source = STATEMENT.sub(
                lambda found: PARAGRAPH.sub(STATED, found[0]), LEFT_OUT.sub("", cell.source)
            )
    readable = Readable(page, copies.targets, copies.literature, plain=True)
    return for_plain_viewers(notebook, readable, copies.chapters[page])


def part(text, kind):
    """(heading or "", text) of what a tag takes: what stands above the first heading, or below it
    up to the next."""
    above, *rest = HEADING.split(text)
    if kind == "more" or not rest:
        return "", above
    return rest[0], rest[1]


def first_sentence(paragraph):
    ends = (match.end() for match in SENTENCE.finditer(paragraph) if match["end"])
    return paragraph[: next(ends, len(paragraph))]


def shortened(text):
    """The blocks of a text: formulas, lists, tables, statements whole, of other paragraphs the
    first sentence."""
    blocks = [block.strip() for block in re.split(r"\n[ \t]*\n", text) if block.strip()]
    return "\n\n".join(block if WHOLE.match(block) else first_sentence(block) for block in blocks)


def as_html(text):
    return markdown2html_mistune(LINK.sub(r"\1", text.replace(STATED, "")))


def outputs(cell):
    """(words, pictures) of what a cell shows, lists of HTML."""
    words, shown = [], []
    for data, metadata in ((o.data, o.metadata) for o in cell.get("outputs", []) if "data" in o):
        if "image/png" in data:
            alt = html.escape(metadata.get("alt", ""))
            shown.append(
                f'<img src="data:image/png;base64,{"".join(data["image/png"].split())}" alt="{alt}">'
            )
        elif "text/markdown" in data:
            words.append(as_html(data["text/markdown"]))
        elif 'class="qc-live"' in data.get("text/html", ""):
            shown.append(data["text/html"])
    return words, shown


class Slide:
    """A slide that grows cell by cell."""

    def __init__(self, title):
        self.title, self.words, self.shown, self.notes = title, [], [], []

    def add(self, cell, kind):
        if cell.cell_type == "markdown":
            text = part(cell.source, kind)[1]
            self.words.append(as_html(shortened(text)))
            self.notes.append(as_html(text))
        else:
            words, shown = outputs(cell)
            self.words += words
            self.shown += shown
        return self

    def html(self):
        live = any('class="qc-live"' in each for each in self.shown)
        look = "live" if live else "beside" if self.shown and any(self.words) else "alone"
        words, shown = ("".join(f"{each}\n" for each in many) for many in (self.words, self.shown))
        notes = "".join(self.notes)
        return (
            f'<section class="{look}"><h2>{as_html(self.title).removeprefix("<p>").strip().removesuffix("</p>")}</h2>\n'
            f'<div class="body"><div class="words">{words}</div><div class="shown">{shown}</div></div>\n'
            f'<aside class="notes">{notes}</aside></section>'
        )


def slides(page, notebook):
    """deck -> list of slides, of a page; a `more` that no slide precedes is an error."""
    found, title = {}, ""
    for cell in notebook.cells:
        text = CODE.sub("", cell.source) if cell.cell_type == "markdown" else ""
        for deck, kind in sorted(tagged(cell)):  # `more` comes first: it stands above the heading
            if deck not in TITLES:
                raise SystemExit(
                    f"decks: {page}: a cell is tagged {kind}-{deck}; decks are {', '.join(TITLES)}"
                )
            if kind == "slide":
                own = part(text, kind)[0] or title
                found.setdefault(deck, []).append(Slide(own))
            if not found.get(deck):
                raise SystemExit(
                    f"decks: {page}: a cell is tagged more-{deck} before any is tagged slide-{deck}"
                )
            found[deck][-1].add(cell, kind)
        title = (HEADING.findall(text) or [title])[-1]
    return found


def write(folder, static):
    """Write a page for each deck, which takes scripts and styles from `static`; returns the paths."""
    copies, decks = lab_copies.Copies(), {name: [] for name in TITLES}
    for page in pages():
        for name, own in slides(page, plain(page, copies)).items():
            decks[name] += own
    folder.mkdir(parents=True, exist_ok=True)
    return [
        write_deck(folder / f"{name}.html", static, TITLES[name], own)
        for name, own in decks.items()
    ]


def write_deck(path, static, title, own):
    shown = "\n".join(slide.html() for slide in own)
    said = {
        "title": title,
        "book": settings()["title"],
        "static": static,
        "mathjax": json.dumps(mathjax()),
    }
    path.write_text(
        PAGE.format(**said, explorables=" ".join(EXPLORABLE.findall(shown)), slides=shown), "utf-8"
    )
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    execute_outdated(pages(), parser.parse_args().jobs)
    export_live.export()
    for path in write(DECKS, "_static"):
        print(f"decks: {path.relative_to(ROOT)}")
    for name in KEPT:
        shutil.copytree(SOURCE / "_assets" / name, DECKS / "_static" / name, dirs_exist_ok=True)
    for name in ("decks.js", "decks.css", "favicon.svg"):
        shutil.copy(SOURCE / "_assets" / name, DECKS / "_static")


if __name__ == "__main__":
    main()
