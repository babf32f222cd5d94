"""What every page of the book does with its results: numbers for the prose, and tables."""

from IPython.display import Markdown
from myst_nb import glue


def keep(**numbers):
    """Glue plain numbers and words under their names: the text of the page quotes them."""
    for name, value in numbers.items():
        # A NumPy number would be stored as text that no format of {glue:text} understands.
        glue(name, getattr(value, "tolist", lambda value=value: value)(), display=False)


def table(head, rows):
    """A Markdown table of strings; its cell needs the metadata `mystnb: {markdown_format: myst}`."""
    lines = [head, ["---"] * len(head), *rows]
    return Markdown("\n".join("| " + " | ".join(line) + " |" for line in lines))
