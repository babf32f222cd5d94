"""What the source of a page has to keep to, found without running it. Each check gives lines that
name the cell."""

import ast
import re

from IPython.core.inputtransformer2 import TransformerManager

from .expressions import place

# A figure without a file: the caption of what show_figure() displays in the cell above.
CAPTION = re.compile(r"^:{3,}\{figure\}[ \t]*\n(?:[ \t]*\n)*((?::[\w-]+:.*\n)*)", re.MULTILINE)
NAME = re.compile(r"^:name:[ \t]*(\S+)", re.MULTILINE)


def shown_in(cell):
    """Names of the figures that a code cell shows, and what is wrong with the way it shows them."""
    tree = ast.parse(TransformerManager().transform_cell(cell.source))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    calls = [call for call in calls if getattr(call.func, "id", "") == "show_figure"]
    if not calls:
        return [], None
    names = [call.args[1].value for call in calls if len(call.args) > 1 and isinstance(call.args[1], ast.Constant)]
    last = tree.body[-1]
    if len(calls) > 1:
        return names, "it shows two figures; one cell, one figure, then its caption"
    if not names:
        words = 'show_figure(picture, "fig-...", "description")'
        return names, f"the name of a figure has to stand there in quotes: {words}"
    if not (isinstance(last, ast.Expr) and last.value is calls[0]):
        return (names, "show_figure(...) has to be its last statement, so that figure and caption stand together")
    return names, None


def figures(notebook):
    """Each figure is followed by its caption, each caption stands below its figure."""
    waiting = None  # the figure whose caption has to open this cell
    for number, cell in enumerate(notebook.cells, 1):
        here = place(number, cell)
        options = CAPTION.findall(cell.source) if cell.cell_type == "markdown" else []
        captions = [match and match[1] for match in map(NAME.search, options)]  # None for one without a name
        if waiting:
            if captions[:1] != [waiting] or not CAPTION.match(cell.source):
                yield (
                    f"{here}: it has to open with the caption of the figure {waiting!r} above it:\n"
                    f":::{{figure}}\n:name: {waiting}\n\nCaption.\n\n:::"
                )
            captions = captions[1:]
        for name in captions:
            yield f"{here}: the caption {name!r} does not stand below its figure, or the figure is missing"
        shown, problem = shown_in(cell) if cell.cell_type == "code" else ([], None)
        if problem:
            yield f"{here}: {problem}"
        waiting = shown[0] if shown else None
    if waiting:
        yield f"the end of the page: the figure {waiting!r} has no caption"


def pictures_without_a_name(notebook):
    """After execution: pictures that did not come from show_figure have neither caption nor
    description."""
    for number, cell in enumerate(notebook.cells, 1):
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}) and "scrapbook" not in output.metadata:
                yield f"{place(number, cell)}: a picture without a caption; end the cell with show_figure(...)"
