"""Fill the templates of the pages and write them. All values are escaped by Jinja."""

import math
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..io.safe import sound_text, write_whole
from .finished import ReportError


def number(value, digits=2):
    """A number as text with a true minus; an en dash for None and NaN."""
    if value is None or math.isnan(value):
        return "–"
    return f"{value:z.{digits}f}".replace("-", "−")


def percent(share):
    """A share as a CSS length, from 0% to 100%."""
    return f"{100 * min(max(share, 0), 1):.0f}%"


TEMPLATES = Environment(
    loader=PackageLoader(__package__),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.filters.update(number=number, percent=percent)


def render(template, **values):
    """The page of a template as text."""
    return TEMPLATES.get_template(template).render(values)


def require_html(path):
    """The path of a page to write; ReportError unless its name ends in .html or .htm."""
    path = Path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise ReportError(f"{path}: give a name that ends in .html")
    return path


def write_text(path, text, encoding="utf-8"):
    """Write a text file, whole or not at all; what its encoding cannot hold is escaped."""
    data = sound_text(text).encode(encoding)
    write_whole(path, lambda place: place.write_bytes(data))
