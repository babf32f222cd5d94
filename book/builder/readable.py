"""Executed pages as copies to read: what points to other pages or to the literature becomes text
with a link.

JupyterLab (jupyterlab_myst) renders a page's own figures, theorems, equations and numbers, one page
at a time; plain.py makes plain Markdown of these, too.
"""

import ast
import re

import yaml
from nbformat.v4 import new_markdown_cell, new_notebook

from .references import CODE

ROLE = re.compile(r"\{(eq|numref|ref|prf:ref|term|cite:p|cite:t|cite|eval)\}(`+)(.+?)\2", re.DOTALL)
TITLED = re.compile(r"^(.*?)\s*<([^<>]+)>$", re.DOTALL)  # words <label>
TO_LABEL = re.compile(r"\[([^\]]*)\]\(#([\w:-]+)\)")
TO_PAGE = re.compile(r"\]\((\w+)\.md\)")
BIBLIOGRAPHY = re.compile(r"^(:{3,}|`{3,})\{bibliography\}.*?^\1[ \t]*$", re.DOTALL | re.MULTILINE)
GENERATED = re.compile(r"^```\{eval-rst\}\n(.*?)^```[ \t]*$", re.DOTALL | re.MULTILINE)
# What JupyterLab has to be told: it counts each proof that does not ask it not to, and shows
# captions small and pale.
TOLD = {"prf:proof": ":nonumber: true", "figure": ":class: not-prose"}
OPENING = re.compile(r"^(?::{3,}|`{3,})\{(prf:proof|figure)\}.*$", re.MULTILINE)


def outside_code(change, text):
    """change() applied to what is not fenced code."""
    parts, end = [], 0
    for match in CODE.finditer(text):
        parts += [change(text[end : match.start()]), match[0]]
        end = match.end()
    return "".join([*parts, change(text[end:])])


class Readable:
    """Rewrites the text of one page. `plain`: references within the page become text, too."""

    def __init__(self, page, targets, literature, plain=False):
        self.page, self.targets, self.literature, self.plain = page, targets, literature, plain
        self.cited = set(literature.entries.entries)

    def text(self, source, values=()):
        values = dict(values)

        def change(part):
            part = ROLE.sub(lambda match: self.role(match, values), part)
            part = TO_LABEL.sub(lambda match: self.reference(match[1], match[2], match[0]), part)
            part = BIBLIOGRAPHY.sub(lambda match: self.literature.listed(self.cited), part)
            return TO_PAGE.sub(r"](\1.ipynb)", part)

        return outside_code(change, source)

    def role(self, match, values):
        name, content = match[1], " ".join(match[3].split())
        if name.startswith("cite"):
            return self.citation(content, in_sentence=name == "cite:t")
        if name == "eval":
            return values[match[3].strip().replace("\n", " ")] if self.plain else match[0]
        titled = TITLED.match(content)
        words, label = titled.groups() if titled else ("", content)
        if name == "term":
            return self.term(words or label, match[0])
        return self.reference(words, label, match[0])

    def term(self, words, as_it_is):
        if self.page == "glossary":
            return words if self.plain else as_it_is
        return f"[{words}](glossary.ipynb)"

    def reference(self, words, label, as_it_is):
        """A reference to another page: words and a link to it. One within the page stays as it is,
        for JupyterLab."""
        target = self.targets.get(label)
        if target is None:
            raise KeyError(f"nothing in the book has the label {label!r}")
        if target.page == self.page and not self.plain:
            return as_it_is
        number = target.text.split()[-1]
        words = words.replace("{number}", number).replace("%s", number) or target.text
        return words if target.page == self.page else f"[{words}]({target.page}.ipynb)"

    def citation(self, keys, in_sentence):
        links = [
            f"[{self.literature.cited(key.strip(), in_sentence)}](bibliography.ipynb)"
            for key in keys.split(",")
        ]
        return ", ".join(links) if in_sentence else f"\\[{', '.join(links)}\\]"


def stored_values(cell):
    """expression -> text, of the numbers that an executed Markdown cell quotes."""
    for entry in cell.metadata.get("user_expressions", []):
        text = entry["result"]["data"]["text/plain"]
        yield entry["expression"], ast.literal_eval(text) if text[:1] in "'\"" else text


def as_notebook(text):
    """A Markdown page as a notebook of one cell; where Sphinx would write a reference stand the
    names that it has."""

    def names(match):
        listed = re.findall(r"^\.\. (?!currentmodule)\w+:: ([\w.]+)", match[1], re.MULTILINE)
        names = ", ".join(f"`{name}`" for name in listed)
        return f"{names}: the site has the text. `help(...)` shows it here, `qclearn COMMAND --help` in a terminal."

    text = GENERATED.sub(names, text)
    return new_notebook(
        cells=[new_markdown_cell(text, id="page")],
        metadata={
            "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}
        },
    )


def rewrite_tables(notebook, readable):
    """Rewrite the references in tables that cells made, as those of the text."""
    for output in (output for cell in notebook.cells for output in cell.get("outputs", [])):
        if "text/markdown" in output.get("data", {}):
            output.data["text/markdown"] = readable.text(output.data["text/markdown"])


def numbering(text, chapter):
    """The front matter that makes JupyterLab count as the book does: Figure 6.1, (6.1), Theorem
    6.1."""
    kinds = {"figure", "table", "equation", "exercise"} | {
        f"proof:{kind}" for kind in re.findall(r"\{prf:(\w+)\}", text)
    }
    if not chapter:
        return ""
    settings = {
        kind: {"enumerator": f"{chapter}.%s"} for kind in kinds - {"proof:ref", "proof:proof"}
    }
    return "---\n" + yaml.safe_dump({"numbering": settings}) + "---\n\n"


def told(text):
    """Opening lines with the option that `TOLD` has for them below."""
    return OPENING.sub(lambda match: f"{match[0]}\n{TOLD[match[1]]}", text)


def fold_hidden(notebook):
    """Fold the code that only draws or keeps."""
    for cell in notebook.cells:
        if "hide-input" in cell.metadata.get("tags", []):
            cell.metadata["jupyter"] = {**cell.metadata.get("jupyter", {}), "source_hidden": True}


def for_jupyterlab(notebook, readable, chapter):
    """Change an executed page in place into its copy for JupyterLab."""
    prose = [cell for cell in notebook.cells if cell.cell_type == "markdown"]
    for cell in prose:
        cell.source = outside_code(told, readable.text(cell.source))
    rewrite_tables(notebook, readable)
    fold_hidden(notebook)
    prose[0].source = numbering("\n".join(cell.source for cell in prose), chapter) + prose[0].source
    return notebook
