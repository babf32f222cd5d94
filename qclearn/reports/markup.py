"""Pieces of a page: its frame with style and scripts inside, tables, and texts that no file's content breaks."""

import html
import json
from importlib.resources import files
from pathlib import Path
from string import Template

from ..io.safe import write_whole
from .finished import ReportError


def escape(text):
    """Text for a page, with no markup of its own."""
    return html.escape(str(text))


def number(value, digits=2):
    """A number as text, with a true minus, an en dash where there is none."""
    return "–" if value is None or value != value else f"{value:z.{digits}f}".replace("-", "−")


def table(head, rows, caption):
    """A table; head: column titles; rows: lists of texts, the first of each its title; caption: what it shows."""
    titles = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    body = "".join(
        f'<tr><th scope="row">{escape(first)}</th>{"".join(f"<td>{escape(text)}</td>" for text in others)}</tr>'
        for first, *others in rows
    )
    return f"<table><caption>{escape(caption)}</caption><thead><tr>{titles}</tr></thead><tbody>{body}</tbody></table>"


def items(texts):
    """Texts as a list."""
    return f"<ul>{''.join(f'<li>{escape(text)}</li>' for text in texts)}</ul>"


def flip(name, pictures):
    """Pictures that take each other's place, the first two by a button; pictures: label -> pairs (address, words)."""
    choices = "".join(
        f'<input type="radio" name="{name}" id="{name}-{k}"{" checked" * (k == 1)}>'
        f'<label for="{name}-{k}">{escape(label)}</label>'
        for k, label in enumerate(pictures)
    )
    images = [[f'<img src="{address}" alt="{escape(words)}">' for address, words in row] for row in pictures.values()]
    shown = "".join(f"<div>{''.join(row)}</div>" for row in images)
    button = '<button type="button" class="flip">Flip before and after</button>'
    return f'<div class="views">{choices}{button}<div class="stack">{shown}</div></div>'


def asset(name):
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def page(body, title, shown, /, **pieces):
    """A whole page: the file `body` filled with pieces of markup, in the frame; shown: what `Shown.scene` gave."""
    data = json.dumps(shown).replace("<", "\\u003c")
    body = Template(asset(body)).substitute(pieces)
    parts = {"title": escape(title), "style": asset("page.css"), "body": body, "data": data}
    return Template(asset("page.html")).substitute(parts, flip=asset("flip.js"), scene=asset("scene.js"))


def require_html(path):
    """The path of a page to write; ReportError unless its name says HTML."""
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise ReportError(f"{path}: give a name that ends in .html")
    return path


def write_text(path, text):
    """Write a text file, whole or not at all."""
    data = text.encode()
    write_whole(path, lambda place: place.write_bytes(data), len(data))
