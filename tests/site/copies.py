"""The copies for JupyterLab as files: which kinds of elements each holds, a few pages that hold all
kinds between them, and what is wrong with a copy. What is planted into a small page shows that each
fault is noticed."""

import html
import json
import re
import struct
from base64 import b64decode
from functools import cache

import nbformat
import yaml
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from places import COPIES, SITE

from book.builder import references
from book.builder.readable import Readable, for_jupyterlab, stored_values

NUMBER = re.compile(r'<span class="computed">(.*?)</span>', re.DOTALL)
CAPTION = re.compile(r'<span class="caption-number">(?:Fig\.|Figure)\s*([\d.]*\d)')
# What a Markdown cell may hold: kind -> what it looks like, outside code; a group names the kind
# more closely.
MARKS = {
    "directive": r"^[ \t]*(?::{3,}|`{3,})\{([\w:-]+)\}",
    "option": r"^:(class|nonumber|width|align): ",
    "role": r"\{([\w:-]+)\}`",
    "formula": r"\$\$",
    "formula in a line": r"(?<!\$)\$(?!\$)",
    "table": r"^\|",
    "heading": r"^(#+) ",
    "list": r"^[ \t]*([-*]|1\.) ",
    "definition": r"^: ",
    "picture": r"!\[",
    "link to a page": r"\]\([\w-]+\.(ipynb)\)",
    "link within the page": r"(?<!!)\]\(#",
    "link to the outside": r"\]\(https?:",
    "label": r"^\([\w:-]+\)=$",
    "front matter": r"\A---$",
}
CODE_FENCE = re.compile(r"^`{3,}(\w+)[ \t]*$", re.MULTILINE)
ROLE = re.compile(r"\{([\w:-]+)\}`([^`]+)`")
CLASS = re.compile(r'<(\w+)[^>]* class="([\w -]+)"')
FIGURE = re.compile(r'<img[^>]*class="page-figure"[^>]*>')
SOURCE = re.compile(r'src="data:image/png;base64,([^"]*)"')
DIV = re.compile(r"<div\b[^>]*>|</div>")
SOLUTION_BOX = re.compile(r'<div class="[^"]*\bsolution\b[^"]*"')
SCENE = re.compile(r'<iframe class="scene"[^>]*>')


def without_solutions(article):
    """The HTML of a page without the boxes of its solutions, which copies do not have."""
    kept, begin, depth = [], 0, 0
    for tag in DIV.finditer(article):
        if not depth and SOLUTION_BOX.match(tag[0]):
            kept.append(article[begin : tag.start()])
            depth = 1
        elif depth:
            depth += -1 if tag[0] == "</div>" else 1
            begin = tag.end()
    return "".join([*kept, article[begin:]])


def squeezed(text):
    return " ".join(text.split())


def in_the_book(page):
    """(numbers of the captions, numbers of the text, number of 3-D scenes) of a page of the site."""
    article = (
        (SITE / f"{page}.html")
        .read_text(encoding="utf-8")
        .split("<article", 1)[1]
        .split("</article>", 1)[0]
    )
    article = without_solutions(article)
    numbers = [squeezed(html.unescape(number)) for number in NUMBER.findall(article)]
    return CAPTION.findall(article), numbers, article.count('<iframe class="scene"')


def prose(notebook):
    """The Markdown cells."""
    return [cell for cell in notebook.cells if cell.cell_type == "markdown"]


def outputs(notebook):
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def shown_as(notebook, kind):
    """What outputs show in a kind of data, as texts."""
    return [output["data"][kind] for output in outputs(notebook) if kind in output.get("data", {})]


# Kinds of elements


def kinds(notebook):
    """The kinds of elements that a copy holds."""
    found = set()
    for cell in notebook.cells:
        found |= {f"tag {tag}" for tag in cell.metadata.get("tags", [])}
        found |= (
            {"input that is hidden"}
            if cell.metadata.get("jupyter", {}).get("source_hidden")
            else set()
        )
    for cell in prose(notebook):
        text = references.CODE.sub("", cell.source)
        found |= {f"code {language}" for language in CODE_FENCE.findall(cell.source)}
        for kind, mark in MARKS.items():
            found |= {
                f"{kind} {match[1] if match.re.groups else ''}"
                for match in re.finditer(mark, text, re.MULTILINE)
            }
    for output in outputs(notebook):
        found |= {
            f"output {output['output_type']}",
            *(f"data {kind}" for kind in output.get("data", {})),
        }
        found |= {
            f"element {'.'.join(match)}"
            for match in CLASS.findall(output.get("data", {}).get("text/html", ""))
        }
    return found


@cache
def copy_of(page):
    return nbformat.read(COPIES / f"{page}.ipynb", as_version=4)


def fewest(held):
    """A few names that hold all kinds between them, given name -> kinds: each next one holds most
    that is new."""
    wanted, chosen = set().union(*held.values()), []
    while wanted:
        chosen.append(max(held, key=lambda name: len(held[name] & wanted)))
        wanted -= held[chosen[-1]]
    return chosen


@cache
def all_kinds():
    """page -> the kinds of elements that its copy holds."""
    return {page: kinds(copy_of(page)) for page in references.chapters()}


# What is wrong with a copy


def numbers_of(notebook):
    """What stands in the text where it quotes an expression, None where no run has answered."""
    for cell in prose(notebook):
        values = dict(stored_values(cell))
        for name, expression in ROLE.findall(references.CODE.sub("", cell.source)):
            if name == "eval":
                yield values.get(squeezed(expression))


def unresolved(text):
    """Labels and pages that a copy points to and that are not there, and citations."""
    labels = {label for label, _ in references.numbered(text, "", None)}
    text = references.CODE.sub("", text)
    pointed = [(name, target.rsplit("<", 1)[-1].rstrip(">")) for name, target in ROLE.findall(text)]
    pointed += [("link", target) for target in re.findall(r"\]\(#([\w:-]+)\)", text)]
    for name, label in pointed:
        if name.startswith("cite") or (name not in ("eval", "term") and label not in labels):
            yield f"unresolved: {label}"
    yield from (
        f"no such page: {name}"
        for name in re.findall(r"\]\((\w+)\.ipynb\)", text)
        if not there(name)
    )
    yield from (
        f"no picture: {name}"
        for name in re.findall(r"!\[[^\]]*\]\((\w[^)]*)\)", text)
        if not there(name, "")
    )


def there(name, ending=".ipynb"):
    return (COPIES / f"{name}{ending}").exists()


def misnumbered(text, chapter):
    """What JupyterLab would count otherwise than the book does."""
    front = re.match(r"---\n(.*?)\n---\n", text, re.DOTALL)
    told = yaml.safe_load(front[1])["numbering"] if front else {}
    for _, target in references.numbered(text, "", chapter):
        kind = (
            target.kind
            if target.kind in ("figure", "table", "equation", "exercise")
            else f"proof:{target.kind}"
        )
        if (
            chapter
            and target.kind != "section"
            and told.get(kind, {}).get("enumerator") != f"{chapter}.%s"
        ):
            yield f"not numbered as in the book: {target.text}"
    for directive, option in (("prf:proof", ":nonumber: true"), ("figure", ":class: not-prose")):
        for match in re.finditer(
            rf"^(?::{{3,}}|`{{3,}})\{{{directive}\}}.*\n(.*)$", text, re.MULTILINE
        ):
            if match[1] != option:
                yield f"{directive} without {option}"


def width_of(picture):
    """The width of an <img> whose PNG stands in the page; 0 without one."""
    data = SOURCE.search(picture)
    return struct.unpack(">I", b64decode(data[1])[16:20])[0] if data else 0


def faults_of_outputs(notebook, figures, scenes):
    """What is wrong with what the cells of a copy show."""
    for output in outputs(notebook):
        if output["output_type"] == "error" or output.get("name") == "stderr":
            yield f"error: {output.get('evalue', output.get('text'))}"
    html_shown = shown_as(notebook, "text/html")
    pictures = [picture for text in html_shown for picture in FIGURE.findall(text)]
    if len(pictures) != len(figures):
        yield f"{len(pictures)} figures below cells; in the book {len(figures)}"
    for picture in pictures:
        described = re.search(r'alt="([^"]+)"', picture)
        if not described or described[1] == "Image" or width_of(picture) < 50:
            yield f"figure without a description or a picture: {picture[:80]}, {width_of(picture)} px"
    found = [scene for text in html_shown for scene in SCENE.findall(text)]
    if len(found) != scenes:
        yield f"{len(found)} scenes; in the book {scenes}"
    yield from (f"a narrow scene: {scene[:80]}" for scene in found if 'width="100%"' not in scene)


def faults_of_file(notebook, chapter, figures, numbers, scenes=0):
    """What is wrong with the copy of a page, in words. figures, numbers, scenes: as `in_the_book`
    gives them."""
    text = "\n\n".join(cell.source for cell in prose(notebook))
    yield from unresolved(text)
    yield from misnumbered(text, chapter)
    yield from faults_of_outputs(notebook, figures, scenes)
    counted = [
        target.text
        for _, target in references.numbered(text, "", chapter)
        if target.kind == "figure"
    ]
    if [caption.split()[-1] for caption in counted] != figures:
        yield f"captions: {counted}; in the book {figures}"
    quoted = list(numbers_of(notebook))
    if len(quoted) != len(numbers):
        yield f"{len(quoted)} numbers; in the book {len(numbers)}"
    for position, (here, book) in enumerate(zip(quoted, numbers, strict=False), 1):
        if here is None or squeezed(here) != book:
            yield f"number {position} is {here}; in the book {book}"


# One small page that is right, and the same with a fault.
PNG = (
    "iVBORw0KGgoAAAANSUhEUgAAAEAAAABACAIAAAAlC+aJAAAAQklEQVR4nO3PQQkAMAwEwVOe/FxXxFEYWDBwk3Y+LXNAAAEEEEAAAQQQQAABBB"
    "BAAAEEEEAAAQQQQAABBBBAAAEEENgDFIBQwq0AAAAASUVORK5CYII="
)
VALUE = {"status": "ok", "data": {"text/plain": "'0.25'"}, "metadata": {}}
TEXT = "# A page\n\nAs {cite:t}`guo2023automatic` say, {eval}`n`. See {numref}`fig-a`.\n\n:::{prf:proof}\nIt is.\n:::\n"
DRAWN = f'<img class="page-figure" alt="A square." src="data:image/png;base64,{PNG}">'
TURNED = '<iframe class="scene" width="100%" srcdoc="a scene"></iframe>'
# What is planted: name -> (what stands there, what takes its place, what JupyterLab shows, what the
# file tells).
FAULTS = {
    "a glue role": ("{eval}`n`", "{glue:text}`n`", "number 1 is n", "0 numbers; in the book 1"),
    "a glue figure": (
        ":::{figure}",
        ":::{glue:figure} n",
        "glue:figure - Unknown Directive",
        "captions: []",
    ),
    "a missing caption": (":::{figure}", ":::{note}", "captions: []", "captions: []"),
    "a missing description": ('alt="A square."', 'alt=""', *["figure without a description"] * 2),
    "a stale number": (
        "'0.25'",
        "'0.26'",
        "number 1 is 0.26",
        "number 1 is 0.26; in the book 0.25",
    ),
    "an unanswered number": ("user_expressions", "nothing", "0 numbers", "number 1 is None"),
    "an unresolved citation": (
        "As ",
        "As {cite:p}`lui2013texture` and ",
        *["unresolved: lui2013texture"] * 2,
    ),
    "an unresolved reference": ("See ", "See {eq}`eq-there` and ", *["unresolved: eq-there"] * 2),
    "a numbered proof": (
        ":nonumber: true",
        ":class: x",
        "numbered: Proof 1",
        "prf:proof without :nonumber: true",
    ),
    "a small caption": (
        ":class: not-prose",
        ":class: x",
        "small caption: Figure",
        "figure without :class: not-prose",
    ),
    "a scene that is not shown": ("<iframe", "<ifrome", *["0 scenes; in the book 1"] * 2),
    "a narrow scene": ('width="100%"', 'width="300"', "a scene fills", "a narrow scene"),
    "an unknown directive": (
        "# A page",
        ":::{gallery}\nA\n:::",
        "gallery - Unknown Directive",
        "directive gallery",
    ),
}


def planted(before="", after=""):
    """A small page as a copy for JupyterLab, with `after` in place of `before`."""
    caption = ":::{figure}\n:name: fig-a\n\nA caption.\n\n:::\n"
    notebook = new_notebook(
        metadata={"kernelspec": {"name": "python3", "display_name": "Python 3"}},
        cells=[
            new_markdown_cell(
                TEXT, id="a", metadata={"user_expressions": [{"expression": "n", "result": VALUE}]}
            ),
            new_code_cell(
                "1",
                id="b",
                outputs=[new_output("display_data", data={"text/html": DRAWN + TURNED})],
            ),
            new_markdown_cell(caption, id="c"),
        ],
    )
    targets = {"fig-a": references.Target("a", "figure", "Fig. 4.1")}
    text = nbformat.writes(
        for_jupyterlab(notebook, Readable("a", targets, references.Literature()), 4)
    )
    before, after = (json.dumps(part)[1:-1] for part in (before, after))
    assert before in text
    return text.replace(before, after, 1)
