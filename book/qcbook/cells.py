"""A page's results: numbers for the prose, figures and tables.

The prose quotes numbers as {eval}`num.count` or {eval}`f"{num.error:.2f}"`. JupyterLab asks the
kernel for them; book/builder/build_book.py stores the answers in the executed page, for Sphinx
(book/qcbook/sphinxpages.py).
"""

import base64
import io
import re
from types import SimpleNamespace

from IPython import get_ipython
from IPython.display import HTML, Markdown, display

from qcbook.figures import picture_html

POWER = re.compile(r"(?<![\w.])(\d(?:\.\d+)?)e([+-])0*(\d+)\b")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
SHOWN = {"True": "yes", "False": "no"}  # in tables
num = SimpleNamespace()  # the numbers of this page
# Name -> execution counts of the cells that kept it: the build refuses two, a reader may run cells
# again.
kept_by = {}


def keep(**numbers):
    """Set num.name = value: the text of the page quotes them. NumPy numbers become plain ones."""
    for name, value in numbers.items():
        setattr(num, name, getattr(value, "tolist", lambda value=value: value)())
        kept_by.setdefault(name, set()).add(getattr(get_ipython(), "execution_count", 0))


def show_figure(picture, name, alt):
    """Show a Matplotlib figure or an Image below the cell. The next Markdown cell opens with its
    caption:

    :::{figure}
    :name: <name>

    Caption.

    :::
    """
    if not alt.strip():
        raise ValueError(f"the figure {name!r} has no description: say in `alt` what is to be seen")
    png, width = drawn(picture)
    # The HTML is for notebooks: JupyterLab 4.6 takes no alternative text from an image's metadata.
    image = picture_html(png, alt, f' class="page-figure" width="{width}"')
    display(
        {"text/html": image, "image/png": base64.b64encode(png).decode(), "text/plain": f"[{name}] {alt}"},
        raw=True,
        metadata={"scrapbook": {"name": name, "mime_prefix": ""}, "alt": alt, "image/png": {"width": width}},
    )


def slide(picture, alt):
    """Show a Matplotlib figure or an Image as large as its slide, in a notebook of book/decks."""
    return HTML(picture_html(drawn(picture)[0], alt))


def drawn(picture, sharpness=2):
    """The PNG of a picture, on white, and its shown width in pixels (of a Matplotlib figure: over
    `sharpness`)."""
    if not hasattr(picture, "savefig"):
        return picture.data, picture.width or png_width(picture.data)
    import matplotlib.pyplot as plt

    picture.patch.set_alpha(1)  # white also on a dark page
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=sharpness * picture.dpi, bbox_inches="tight", facecolor="white")
    plt.close(picture)
    return buffer.getvalue(), round(png_width(buffer.getvalue()) / sharpness)


def png_width(png):
    return int.from_bytes(png[16:20], "big")


def in_powers(text):
    """3e-05 as a reader writes it: 3 × 10⁻⁵; 1e-03 is 10⁻³, and 0e+00 is 0."""

    def power(match):
        digits, sign, exponent = match.groups()
        if float(digits) == 0:
            return "0"
        if exponent == "0":
            return digits
        raised = "10" + (sign.strip("+") + exponent).translate(RAISED)
        return raised if digits == "1" else f"{digits}\u00a0×\u00a0{raised}"

    return POWER.sub(power, text)


def table(head, rows, folded=""):
    """A Markdown table of strings; its cell needs the metadata `mystnb: {markdown_format: myst}`. With
    words `folded` only these are seen until a reader clicks them."""
    rows = [[in_powers(SHOWN.get(cell, cell)) for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *rows]
    text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return Markdown(f"<details><summary>{folded}</summary>\n\n{text}\n\n</details>" if folded else text)
