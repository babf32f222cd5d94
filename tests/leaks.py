"""What may not happen to files that students get: lines of solutions, and questions other than the page's."""

import html
import json
import re

import nbformat

from book.builder.graded import EXERCISES, call
from book.builder.references import BOOK
from book.builder.solutions import solutions_in, without

LONG = 20  # characters: a shorter line may stand anywhere
TAG = re.compile(r"<[^>]+>")


def lines_of(text):
    return {line.strip() for line in text.splitlines() if len(line.strip()) > LONG}


def graded_lines():
    """exercise -> the lines of its solution that the question does not have."""
    return {
        name: {line for line in lines_of(exercise.solved) if line not in exercise.blank + exercise.words}
        for name, exercise in EXERCISES.items()
    }


def page_lines():
    """page -> the lines of code in the solutions of its exercises that it does not have elsewhere."""
    found = {}
    for path in sorted(BOOK.glob("*.ipynb")):
        cells = nbformat.read(path, as_version=4).cells
        code = "\n".join(code for cell in cells for _, code, _ in solutions_in(cell.source))
        shown = "\n".join(without(cell.source) for cell in cells)
        found[path.stem] = {line for line in lines_of(code) if line not in shown}
    return found


def strings(value):
    """Every text in what a JSON file holds."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, (list, dict)):
        for each in (*value, *value.values()) if isinstance(value, dict) else value:
            yield from strings(each)


def text_of(path):
    """What can be read in a file: all of it, and once more without tags, which stand in lines of highlighted code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix in (".ipynb", ".json"):
        text = "\n".join(strings(json.loads(text)))
    return html.unescape(text).replace('\\"', '"') + "\n" + html.unescape(TAG.sub("", text))


def leaks(paths, lines):
    """file -> the lines of solutions in it, of the files that have any; lines: name -> lines."""
    every = sorted(set().union(*lines.values()))
    found = {path: [line for line in every if line in text] for path in paths if (text := text_of(path))}
    return {str(path): there for path, there in found.items() if there}


def of(notebook, part):
    return [cell for cell in notebook.cells if part in cell.metadata.get("tags", [])]


def squeezed(text):
    """Words alone: no links, emphasis or typographic quotes, as they differ between a page and a notebook."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("*", "")
    return " ".join(text.translate(str.maketrans("‘’“”", "''\"\"")).split())


def drift(page, student):
    """The exercises of a student's notebook whose words or blank a plain copy of their page does not have."""
    text = squeezed("\n".join(cell.source for cell in page.cells if cell.cell_type == "markdown"))
    for question, answer in zip(of(student, "question"), of(student, "answer")):
        name, words = question.metadata["exercise"], question.source.split("\n\n", 2)[2]
        asked_here = call(EXERCISES[name]) in text
        # What a question says in words of an equation, in italics, the page says by its number.
        parts = (re.escape(squeezed(part)) for part in re.split(r"\*[^*]+\*", words))
        same = re.search(r".{1,90}?".join(parts), text)
        if asked_here and not (same and squeezed(answer.source) in text):
            yield name
