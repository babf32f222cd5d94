"""Slides made of tagged cells of the pages, by nbconvert: the book's own pictures, formulas and
explorables.

A cell tagged `slide-NAME` begins a slide of the deck NAME, one tagged `more-NAME` goes on with the
last one. Of a cell's text, `slide-` takes what stands below its first heading and `more-` what
stands above it. A slide has the formulas, lists, tables and statements of that text, the first
sentence of each other paragraph, and all of it as the speaker's notes. `make decks` writes
build/decks, and `make book` the same slides beside the site.
"""

import argparse
import json
import re
import shutil

import yaml
from nbconvert import SlidesExporter
from nbformat.v4 import new_markdown_cell, new_notebook

from qcbook.sphinxpages import EXPLORABLE

from . import build_book, export_live
from .execute_pages import BUILD, ROOT, SOURCE, execute_outdated, notebooks
from .references import CODE

TITLES = {
    "opening": "Registering cortical surfaces",
    "lbs": "The Linear Beltrami Solver, and its errata",
    "networks": "Do networks pay?",
}
DECKS = BUILD / "decks"
TAG = re.compile(r"(slide|more)-(\w+)")
HEADING = re.compile(r"^#+[ \t]+(.+)$", re.MULTILINE)
LINK = re.compile(r"(?<!!)\[([^\[\]]*)\]\([\w./#-]+\)")
PROOF = re.compile(r"^Proof\..*?^∎$", re.DOTALL | re.MULTILINE)
STATEMENT = re.compile(r"\*\*(?!Box|After)[^*]+\*\*( \(.+\))?$")  # the title of a theorem or of an erratum
# How a block begins that is shown whole; of another one the first sentence is.
WHOLE = re.compile(r"\$\$|\*\*|[-*|] |\d+\. |```")
SENTENCE = re.compile(r"\$[^$]+\$|`[^`]+`|(?P<end>[.!?])(?=\s|$)")
ASSETS = ("live", "vendor/mathjax", "vendor/reveal", "vendor/licenses", "decks.js", "decks.css", "favicon.svg")
TEMPLATE = """{% extends 'reveal/index.html.j2' %}
{% block header %}<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ resources.title }}</title>
{%- set static = resources.static %}
<link rel="icon" href="{{ static }}/favicon.svg"><link rel="stylesheet" href="{{ static }}/vendor/reveal/reveal.css">
<link rel="stylesheet" href="{{ static }}/live/live.css"><link rel="stylesheet" href="{{ static }}/decks.css">
<script>window.MathJax = {{ resources.mathjax }};</script>
<script defer src="{{ static }}/vendor/mathjax/startup.js"></script>
<script type="module" async src="{{ static }}/live/page.js" data-explorables="{{ resources.live }}" data-carried="">
</script>
</head>
{% endblock header %}
{% block footer %}
<script src="{{ resources.static }}/vendor/reveal/reveal.js"></script>
<script src="{{ resources.static }}/decks.js"></script>
</html>
{% endblock footer %}
"""


def part(text, kind):
    """(heading or "", text) of what a tag takes: what stands above the first heading, or below it
    up to the next."""
    above, *rest = HEADING.split(text)
    return ("", above) if kind == "more" or not rest else (rest[0], rest[1])


def shortened(text):
    """Formulas, lists, tables, statements whole, of other paragraphs the first sentence, and no
    proof."""
    shown = []
    for stretch in PROOF.split(text):
        stated = False
        for block in filter(None, map(str.strip, re.split(r"\n[ \t]*\n", stretch))):
            stated = stated or STATEMENT.match(block)
            ends = (match.end() for match in SENTENCE.finditer(block) if match["end"])
            shown.append(block if stated or WHOLE.match(block) else block[: next(ends, None)])
    return "\n\n".join(shown)


def markdown(text, kind="-"):
    return new_markdown_cell(LINK.sub(r"\1", text), metadata={"slideshow": {"slide_type": kind}})


def with_outputs(cell):
    """A cell's figures, tables and explorables, without what it prints and without scenes."""
    shown = 'class="page-figure"', 'class="qc-live"'
    cell.outputs = [
        output
        for output in cell.outputs
        if (data := output.get("data", {}))
        and ("text/markdown" in data or any(each in data.get("text/html", "") for each in shown))
    ]
    for data in (output.data for output in cell.outputs if "text/markdown" in output.data):
        data["text/markdown"] = LINK.sub(r"\1", data["text/markdown"])
    cell.metadata["slideshow"] = {"slide_type": "-"}
    return cell


def tagged(cell):
    """(kind, deck) of a cell's tags; `more` comes first, for it stands above the heading."""
    return sorted(match.groups() for match in map(TAG.fullmatch, cell.metadata.get("tags", [])) if match)


def deck(name, pages):
    """The notebook of a deck, of page -> notebook."""
    cells, heading = [], ""
    for page, cell in ((page, cell) for page, notebook in pages.items() for cell in notebook.cells):
        prose = cell.cell_type == "markdown"
        for kind, own in tagged(cell):
            if own not in TITLES:
                raise SystemExit(f"decks: {page}: a cell is tagged {kind}-{own}; decks are {', '.join(TITLES)}")
            if own != name:
                continue
            title, text = part(cell.source, kind) if prose else ("", "")
            if kind == "slide":
                cells.append(markdown(f"## {title or heading}", "slide"))
            if not cells:
                raise SystemExit(f"decks: {page}: a cell is tagged more-{name} before any is tagged slide-{name}")
            if prose and text.strip():
                cells += [markdown(shortened(text)), markdown(text, "notes")]
            elif not prose:
                cells.append(with_outputs(cell))
        heading = ([heading] + (HEADING.findall(CODE.sub("", cell.source)) if prose else []))[-1]
    return new_notebook(cells=cells)


def write(pages, folder, static):
    """Write a page for each deck, of page -> notebook; it takes scripts and styles from `static`."""
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    # The site's settings of MathJax, and the signs that formulas stand between.
    tex = {"inlineMath": [["$", "$"]], "displayMath": [["$$", "$$"]], "tags": "none"}
    mathjax = json.dumps(settings["sphinx"]["config"]["mathjax3_config"] | {"tex": tex})
    exporter = SlidesExporter(
        raw_template=TEMPLATE, exclude_input=True, exclude_output_prompt=True, exclude_anchor_links=True
    )
    folder.mkdir(parents=True, exist_ok=True)
    for name, title in TITLES.items():
        notebook = deck(name, pages)
        live = " ".join(EXPLORABLE.findall(json.dumps(notebook).replace('\\"', '"')))
        notebook.cells.insert(0, markdown(f"# {title}\n\n{settings['title']}", "slide"))
        shown = {"title": title, "static": static, "mathjax": mathjax, "live": live}
        (folder / f"{name}.html").write_text(exporter.from_notebook_node(notebook, shown)[0], encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    execute_outdated(notebooks(), parser.parse_args().jobs)
    export_live.export()
    write(build_book.build_notebooks(), DECKS, "_static")
    for name in ASSETS:
        source, place = SOURCE / "_assets" / name, DECKS / "_static" / name
        shutil.copytree(source, place, dirs_exist_ok=True) if source.is_dir() else shutil.copy(source, place)


if __name__ == "__main__":
    main()
