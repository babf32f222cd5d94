"""What a narrow window needs: code in tables may break behind its signs, and a wide figure gets a box in
which it scrolls. The rest is in `_assets/book.css`."""

import re

from docutils import nodes

WIDE = 600  # pixels; a wider figure would have letters of 4 to 8 pixels on a telephone
PIXELS = re.compile(r"([\d.]+)(?:px)?")
SIGNS = re.compile(r"(?<=[/._:=,@])(?=\w)|(?<=\w-)(?=\w)")


def pieces(text):
    """The words of a code, with an invisible place to break behind each sign."""
    first, *others = SIGNS.split(text)
    yield nodes.Text(first)
    for other in others:
        yield nodes.raw("", "<wbr>", format="html")
        yield nodes.Text(other)


def fit(app, doctree, page):
    """Let code in tables break at its signs, and put wide figures into boxes."""
    if app.builder.format != "html":
        return
    for code in [code for cell in doctree.findall(nodes.entry) for code in cell.findall(nodes.literal)]:
        words = list(pieces(code.astext()))
        code.clear()
        code += words
    for picture in list(doctree.findall(nodes.image)):
        pixels = PIXELS.fullmatch(picture.get("width", ""))
        if isinstance(picture.parent, nodes.figure) and pixels and float(pixels[1]) > WIDE:
            box = nodes.container(classes=["wide-picture"])
            picture.replace_self(box)
            box += picture


def setup(app):
    app.connect("doctree-resolved", fit)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
