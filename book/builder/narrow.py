"""What a narrow window needs: code in tables may break at its signs, a short code and an option stay
whole in the text, and a short formula keeps the brackets and stops that touch it. The rest is in
`_assets/book.css`."""

import re

from docutils import nodes

SHORT_CODE = 24  # letters
SHORT = 40  # letters of a formula's source; a longer one may have to be broken
BEFORE, AFTER = re.compile(r"[(\[]+\Z"), re.compile(r"[,.;:!?)\]]+")
SIGNS = re.compile(r"(?<=[/_:=,@])(?=\w)|(?<=\w)(?=\.\w)|(?<=\w-)(?=\w)")


def pieces(text):
    """The words of a code, with an invisible place to break at each sign."""
    first, *others = SIGNS.split(text)
    yield nodes.Text(first)
    for other in others:
        yield nodes.raw("", "<wbr>", format="html")
        yield nodes.Text(other)


def hold_together(formula):
    """Put a formula into one unbroken piece with the signs that touch it."""
    row = formula.parent
    place = row.index(formula)
    before, after = (row[k] if 0 <= k < len(row) else None for k in (place - 1, place + 1))
    parts = [formula.deepcopy()]
    if isinstance(after, nodes.Text) and (signs := AFTER.match(after)):
        parts.append(nodes.Text(signs[0]))
        row[place + 1] = nodes.Text(after[signs.end() :])
    if isinstance(before, nodes.Text) and (signs := BEFORE.search(before)):
        parts.insert(0, nodes.Text(signs[0]))
        row[place - 1] = nodes.Text(before[: signs.start()])
    if len(parts) > 1:
        formula.replace_self(nodes.inline("", "", *parts, classes=["unbroken"]))


def fit(app, doctree, page):
    """Let code in tables break at its signs, hold options and short formulas together."""
    if app.builder.format != "html":
        return
    for code in [code for cell in doctree.findall(nodes.entry) for code in cell.findall(nodes.literal)]:
        words = list(pieces(code.astext()))
        code.clear()
        code += words
    for formula in list(doctree.findall(nodes.math)):
        if len(formula.astext()) <= SHORT:
            hold_together(formula)
    for code in doctree.findall(nodes.literal):
        if len(code.astext()) <= SHORT_CODE:
            code["classes"].append("unbroken")


def setup(app):
    app.connect("doctree-resolved", fit)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
