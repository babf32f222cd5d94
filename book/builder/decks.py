"""The notebooks of book/decks as slides, by nbconvert with the vendored reveal and MathJax.

Each is written by hand, in nbconvert's own way: a cell's `slideshow` metadata say where a slide
begins, which cells are skipped, and which are the speaker's notes. `make decks` writes build/decks,
and `make book` the same slides beside the site.
"""

import argparse
import json
import re
import shutil

import nbformat
import yaml
from nbconvert import SlidesExporter

from qcbook.sphinxpages import EXPLORABLE, value

from . import export_live
from .execute_pages import BUILD, ROOT, SOURCE, execute_outdated, notebooks
from .expressions import EVAL

DECKS = BUILD / "decks"
PAGE = re.compile(r" (\[[^\]]+\])\(\.\./(\w+)\.ipynb\)")  # of the book, at the end of a slide's words
ASSETS = ("live", "vendor/mathjax", "vendor/reveal", "vendor/licenses", "decks.js", "decks.css", "favicon.svg")
# On a telephone, without reveal, the slides stand below each other.
TEMPLATE = """{% extends 'reveal/index.html.j2' %}
{% block header %}<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ nb.metadata.title }}</title>
{%- set static = resources.static %}{%- set reveal = resources.reveal.url_prefix %}
<link rel="icon" href="{{ static }}/favicon.svg">
<link rel="stylesheet" href="{{ reveal }}/reveal.css" media="(min-width: 40rem)">
<link rel="stylesheet" href="{{ static }}/live/live.css"><link rel="stylesheet" href="{{ static }}/decks.css">
<script>window.MathJax = {{ resources.mathjax }};</script>
<script defer src="{{ static }}/vendor/mathjax/startup.js"></script>
<script type="module" async src="{{ static }}/live/page.js" data-explorables="{{ resources.live }}" data-carried="">
</script>
</head>
{% endblock header %}
{% block footer %}
<script src="{{ resources.reveal.url_prefix }}/reveal.js"></script>
<script src="{{ resources.static }}/decks.js"></script>
</html>
{% endblock footer %}
"""


def executed(name):
    """The executed notebook of a deck, with the numbers in its words."""
    notebook = nbformat.read(SOURCE / f"{name}.ipynb", as_version=4)
    for cell in notebook.cells:
        answers = iter(cell.metadata.get("user_expressions", []))
        cell.source = EVAL.sub(lambda _, answers=answers: value(next(answers)["result"]), cell.source)
    return notebook


def write(folder, static, page=""):
    """Write a page for each deck; it takes scripts and styles from `static`, and `page` is what a slide's
    link to the book becomes."""
    settings = yaml.safe_load((ROOT / "_config.yml").read_text(encoding="utf-8"))
    # The site's settings of MathJax, and the signs that formulas stand between.
    tex = {"inlineMath": [["$", "$"]], "displayMath": [["$$", "$$"]], "tags": "none"}
    mathjax = json.dumps(settings["sphinx"]["config"]["mathjax3_config"] | {"tex": tex})
    options = {"exclude_input": True, "exclude_output_prompt": True, "exclude_anchor_links": True}
    exporter = SlidesExporter(raw_template=TEMPLATE, reveal_url_prefix=f"{static}/vendor/reveal", **options)
    for name in notebooks("decks"):
        notebook = executed(name)
        live = " ".join(EXPLORABLE.findall(json.dumps(notebook).replace('\\"', '"')))
        for cell in notebook.cells:
            cell.source = PAGE.sub(page, cell.source)
        text, _ = exporter.from_notebook_node(notebook, {"static": static, "mathjax": mathjax, "live": live})
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name.removeprefix('decks/')}.html").write_text(text, encoding="utf-8")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    execute_outdated(notebooks("decks"), parser.parse_args().jobs)
    export_live.export()
    write(DECKS, "_static")
    for name in ASSETS:
        source, place = SOURCE / "_assets" / name, DECKS / "_static" / name
        shutil.copytree(source, place, dirs_exist_ok=True) if source.is_dir() else shutil.copy(source, place)


if __name__ == "__main__":
    main()
