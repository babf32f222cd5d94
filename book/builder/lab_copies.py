"""Copies of the executed pages for reading: build/lab for JupyterLab, build/notebooks for any other
viewer.

A copy is made anew when its page, the library behind it, the contents or the literature changed,
and only then; the pages are executed for it where build/book has no run of them that is as new.
With SOLUTIONS=1 in the environment the copies hold the solutions of exercises. A copy that a reader
changed is never overwritten: it is kept beside the new one, and a line says so.
"""

import argparse
import hashlib
import json
import shutil
import sys
from pathlib import Path

import nbformat
from nbformat.sign import NotebookNotary

from . import execute_pages, expressions, references, solutions, teaching
from .plain import for_plain_viewers
from .readable import Readable, as_notebook, for_jupyterlab

LAB, PLAIN = execute_pages.BUILD / "lab", execute_pages.BUILD / "notebooks"
RECORD = ".copies.json"  # page -> what it was made from, and the digest of its cells as written


def cells_digest(path):
    """Of a notebook's cells without outputs: JupyterLab saves a page that was only opened or run,
    and nobody changed that."""
    try:
        cells = [(cell.cell_type, cell.source) for cell in nbformat.read(path, as_version=4).cells]
    except (nbformat.reader.NotJSONError, AttributeError):
        return None  # no notebook any more
    return hashlib.sha256(json.dumps(cells).encode()).hexdigest()


def book_digest():
    """Of everything that a copy depends on besides its own page: references to other pages, and
    these programs."""
    book = references.BOOK
    labels = "".join(f"{label}{target}" for label, target in sorted(references.labels().items()))
    found = hashlib.sha256(f"{labels}{solutions.SHOWN}".encode())
    for file in (
        book / "_toc.yml",
        book / "references.bib",
        *sorted(Path(__file__).parent.glob("*.py")),
    ):
        found.update(file.read_bytes())
    return found.hexdigest()


def put_aside(path):
    """Rename a copy that a reader changed, to a name that is free."""
    number, aside = 1, path.with_stem(f"{path.stem}-mine")
    while aside.exists():
        number += 1
        aside = path.with_stem(f"{path.stem}-mine-{number}")
    path.rename(aside)
    print(
        f"lab_copies: you changed {path.name}; it is {aside} now, and {path.name} is new",
        file=sys.stderr,
    )


def write_copies(folder, stamps, make):
    """Write make(page) for each page whose stamp differs from the one recorded; returns the pages
    written."""
    folder.mkdir(parents=True, exist_ok=True)
    file, written = folder / RECORD, []
    record = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for page, stamp in stamps.items():
        path, old = folder / f"{page}.ipynb", record.get(page, {})
        if path.exists() and old.get("made_from") == stamp:
            continue
        if path.exists() and old.get("written") != cells_digest(path):
            put_aside(path)
        nbformat.write(make(page), path)
        record[page] = {"made_from": stamp, "written": cells_digest(path)}
        written.append(page)
        file.write_text(json.dumps(record, indent=1), encoding="utf-8")
    shutil.copy(references.BOOK / "paper.toml", folder)
    shutil.copytree(
        references.BOOK / "_assets",
        folder / "_assets",
        dirs_exist_ok=True,
        ignore=shutil.ignore_patterns("vendor", "*.js", "*.css"),
    )
    return written


def without_solutions(notebook):
    """Change a page in place: no solution, no cell that held nothing else, no value that only a
    solution quotes."""
    for cell in execute_pages.prose(notebook):
        if (source := solutions.without(cell.source)) != cell.source:
            asked = cell.metadata.get("user_expressions", [])
            cell.source = source
            cell.metadata["user_expressions"] = [
                entry
                for entry in asked
                if entry["expression"] in expressions.expressions_in(source)
            ]
    notebook.cells = [
        cell for cell in notebook.cells if cell.source or cell.cell_type != "markdown"
    ]
    return notebook


class Copies:
    """Makes copies of pages, by `for_jupyterlab` or `for_plain_viewers`."""

    def __init__(self):
        self.chapters, self.targets = references.chapters(), references.labels()
        self.literature = references.Literature()

    def executed(self, page):
        path = execute_pages.SOURCE / f"{page}.ipynb"
        if path.exists():
            notebook = nbformat.read(path, as_version=4)
            return notebook if solutions.SHOWN else without_solutions(notebook)
        return as_notebook(teaching.put(references.markdown_of(page)))

    def make(self, page, change):
        readable = Readable(page, self.targets, self.literature, plain=change is for_plain_viewers)
        try:
            return change(self.executed(page), readable, self.chapters[page])
        except KeyError as error:
            sys.exit(f"lab_copies: {page}: {error.args[0]}")

    def signed(self, page):
        notebook = self.make(page, for_jupyterlab)
        NotebookNotary().sign(
            notebook
        )  # the reader's own machine made it: JupyterLab may show its 3-D scenes
        return notebook


def build(folder, make, jobs):
    """Copies of all pages in a folder, executing what is out of date."""
    pages = list(references.chapters())
    execute_pages.execute_outdated(
        [page for page in pages if (references.BOOK / f"{page}.ipynb").exists()], jobs
    )
    common = book_digest()
    stamps = {page: common + execute_pages.stamp(page) for page in pages}
    written = write_copies(folder, stamps, make)
    print(
        f"lab_copies: {folder.relative_to(execute_pages.ROOT)}: {len(written)} of {len(pages)} "
        "pages are new"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--plain", action="store_true", help="build/notebooks, what the site offers for download"
    )
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    arguments = parser.parse_args()
    copies = Copies()
    if arguments.plain:
        build(PLAIN, lambda page: copies.make(page, for_plain_viewers), arguments.jobs)
    else:
        build(LAB, copies.signed, arguments.jobs)


if __name__ == "__main__":
    main()
