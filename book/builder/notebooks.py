"""Sphinx's builder `notebook`: each executed page as a notebook that any viewer reads, cell by
cell.

sphinx-markdown-builder writes the prose, with the numbers, references and citations of the site.
What it does not know is here: where a cell begins, theorems and exercises, numbers of equations and
figures. Code cells and their outputs stay as they were executed.
"""

import re
from functools import partial

import nbformat
from docutils import nodes
from nbformat.v4 import new_markdown_cell, new_notebook
from sphinx_markdown_builder import contexts
from sphinx_markdown_builder.builder import MarkdownBuilder
from sphinx_markdown_builder.contexts import SubContext, SubContextParams, WrappedContext
from sphinx_markdown_builder.translator import MarkdownTranslator, pushing_context

from . import solutions

contexts.tabulate = partial(contexts.tabulate, disable_numparse=True)  # 0.30 in a table stays 0.30
CELL = re.compile(r"\s*<<cell (\d+)>>\s*")
LINES = 10_000  # MyST-NB numbers line n of cell k, the first one 0, as LINES * (k + 1) + n
# The form of an output that Sphinx reads: tables may refer to other pages.
FORMS = [("notebook", form, priority) for priority, form in enumerate(["text/markdown", "text/plain"])]
KERNEL = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}


class NotebookTranslator(MarkdownTranslator):
    """Markdown without MyST, with a mark where each cell of the page begins."""

    cell = -1

    def dispatch_visit(self, node):
        in_section = isinstance(node.parent, (nodes.document, nodes.section)) and not isinstance(node, nodes.section)
        if in_section and (node.line or 0) // LINES - 1 > self.cell:
            self.cell = node.line // LINES - 1
            self.add(f"<<cell {self.cell}>>", prefix_eol=2, suffix_eol=2)
        super().dispatch_visit(node)

    def visit_container(self, node):
        if node.get("nb_element") == "cell_code_source":
            raise nodes.SkipNode

    def visit_literal_block(self, node):
        if isinstance(node.parent, nodes.figure) or node.parent.get("nb_element") == "cell_code_output":
            raise nodes.SkipNode  # the output itself stays
        super().visit_literal_block(node)

    def number(self, kind, node):
        """The number of a theorem, a figure, ... as the site has it, or ""."""
        numbers = self.builder.env.toc_fignumbers.get(self.builder.current_doc_name, {}).get(kind, {})
        return ".".join(map(str, next((numbers[name] for name in node["ids"] if name in numbers), ())))

    def visit_Admonition(self, node):
        """Theorems, exercises, solutions and boxes: a bold title, and what they hold."""
        if node.tagname == "solution_node" and not solutions.SHOWN:
            raise nodes.SkipNode
        self.ensure_eol(2)

    def depart_proof_node(self, node):
        self.add("∎", prefix_eol=2, suffix_eol=2)

    def depart_table(self, node):
        self._pop_context()
        self.ensure_eol(2)

    def _push_box(self, title):
        self.add(f"**{title.capitalize()}**", prefix_eol=2, suffix_eol=2)
        self._push_context(SubContext(SubContextParams(1, 2)))

    @pushing_context
    def visit_title(self, node):
        box = node.parent
        kind = box.get("countertype") or box.tagname.removesuffix("_enumerable_node")
        if isinstance(box, (nodes.section, nodes.table)):
            super().visit_title(node)
        elif number := self.number(kind, box):
            self.add(f"**{kind.capitalize()} {number}**", prefix_eol=2)
            self._push_context(SubContext(SubContextParams(0, 2)))
        else:
            self._push_context(WrappedContext("**", params=SubContextParams(2, 2)))

    def visit_caption(self, node):
        self.add(f"**Fig. {self.number('figure', node.parent)}.** ", prefix_eol=2)

    def depart_caption(self, node):
        self.ensure_eol(2)

    def visit_math_block(self, node):
        number = self.number("displaymath", node)
        tag = f"\n\\tag{{{number}}}" if number else ""
        self.add(f"$$\n{node.astext().strip()}{tag}\n$$", prefix_eol=2, suffix_eol=2)
        raise nodes.SkipNode

    @pushing_context
    def visit_reference(self, node):
        """A link to another notebook or to the outside; within the page the words alone."""
        page = node.get("refuri", "").partition("#")[0] if node.get("internal") else node.get("refuri", "")
        here = page in ("", self.builder.get_target_uri(self.builder.current_doc_name))
        self._push_context(SubContext() if here else WrappedContext("[", f"]({page})"))

    def visit_target(self, node):
        """No anchors: JupyterLab takes them away."""

    visit_citation = visit_target

    def visit_label(self, node):
        raise nodes.SkipNode

    visit_raw = visit_label


def notebook_of(page, text):
    """A page with this text in its cells; without the cells that hold no text any more."""
    if page is None:
        return new_notebook(cells=[new_markdown_cell(text, id="page")], metadata=KERNEL)
    before, *parts = CELL.split(text)
    cells = [page.cells[int(cell)] for cell in parts[::2]]
    code = [cell for cell in page.cells if cell.cell_type == "code"]
    assert not before.strip() and [cell for cell in cells if cell.cell_type == "code"] == code, "cells are lost"
    for cell, words in zip(cells, parts[1::2]):
        if cell.cell_type == "markdown":
            cell.source = words
            cell.metadata.pop("user_expressions", None)
            continue
        if "hide-input" in cell.metadata.get("tags", []):
            cell.metadata["jupyter"] = {**cell.metadata.get("jupyter", {}), "source_hidden": True}
        tables = [output for output in cell.outputs if "text/markdown" in output.get("data", {})]
        assert len(tables) == bool(words), f"{len(tables)} tables in one cell: {words}"
        if tables:
            tables[0].data["text/markdown"] = words
    page.cells = [cell for cell in cells if cell.cell_type == "code" or cell.source]
    return page


def for_any_viewer(notebook):
    """Change a notebook in place: a figure as its PNG alone, for not every viewer shows pictures
    within HTML."""
    for output in (output for cell in notebook.cells for output in cell.get("outputs", [])):
        if "image/png" in output.get("data", {}):
            output.data.pop("text/html", None)
    return notebook


class NotebookBuilder(MarkdownBuilder):
    name = "notebook"
    default_translator_class = NotebookTranslator

    def init(self):
        super().init()
        self.out_suffix = ".ipynb"

    def get_target_uri(self, docname, typ=None):
        return f"{docname}.ipynb"

    def write_doc(self, docname, doctree):
        super().write_doc(docname, doctree)
        source = self.env.doc2path(docname)
        page = nbformat.read(source, as_version=4) if source.endswith(".ipynb") else None
        nbformat.write(notebook_of(page, self.writer.output), self.outdir / f"{docname}.ipynb")


def setup(app):
    app.setup_extension("sphinx_markdown_builder")
    app.add_builder(NotebookBuilder)
    app.config.nb_mime_priority_overrides = FORMS
    return {"parallel_read_safe": True, "parallel_write_safe": True}
