"""Copies of the executed pages for reading: build/lab for JupyterLab, build/notebooks for any other
viewer.

The pages are executed first where build/book has no run of them that is as new. With SOLUTIONS=1 in
the environment the copies hold the solutions of exercises. A copy that a reader changed is never
overwritten: where its page is new, it is kept beside the new one, and a line says so.
"""

import argparse
import hashlib
import json
import shutil
import sys

import nbformat
from nbformat.sign import NotebookNotary

from .build_book import build_notebooks
from .execute_pages import BUILD, SOURCE, execute_outdated, notebooks
from .notebooks import for_any_viewer
from .references import BOOK

LAB, PLAIN = BUILD / "lab", BUILD / "notebooks"
RECORD = ".copies.json"  # page -> digest of its cells as written
NUMBERED = "---\nnumbering:\n  equation: false\n---\n\n"  # else JupyterLab numbers the equations once more


def digest(notebook):
    """Of the cells without outputs: JupyterLab saves a page that was only opened or run, and nobody
    changed that."""
    cells = [(cell.cell_type, cell.source) for cell in notebook.cells]
    return hashlib.sha256(json.dumps(cells).encode()).hexdigest()


def changed(path, record):
    """Whether a reader changed a copy that is there: then its cells are not those that were written."""
    try:
        return path.exists() and digest(nbformat.read(path, as_version=4)) != record
    except (nbformat.reader.NotJSONError, AttributeError):
        return True  # no notebook any more


def write_copies(folder, pages):
    """Write page -> notebook into a folder, and what the pages show beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / RECORD
    record = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for page, notebook in pages.items():
        path, new = folder / f"{page}.ipynb", digest(notebook)
        if changed(path, record.get(page)):
            if record.get(page) == new:
                continue  # the reader's own, of the page as it still is
            number, aside = 1, path.with_stem(f"{page}-mine")
            while aside.exists():
                number += 1
                aside = path.with_stem(f"{page}-mine-{number}")
            path.rename(aside)
            print(f"lab_copies: you changed {path.name}; it is {aside} now, and {path.name} is new", file=sys.stderr)
        nbformat.write(notebook, path)
        record[page] = new
        file.write_text(json.dumps(record, indent=1), encoding="utf-8")
    print(f"lab_copies: {len(pages)} pages are in {folder}")
    shutil.copy(BOOK / "paper.toml", folder)
    not_shown = shutil.ignore_patterns("vendor", "live", "*.js", "*.css")
    built = SOURCE / "_assets"  # has the thumbnails, too
    assets = built if built.is_dir() else BOOK / "_assets"
    shutil.copytree(assets, folder / "_assets", dirs_exist_ok=True, ignore=not_shown)


def write_lab(pages):
    """The copies for JupyterLab of page -> notebook, which are changed in place."""
    for notebook in pages.values():
        notebook.cells[0].source = NUMBERED + notebook.cells[0].source
    write_signed(LAB, pages)


def write_signed(folder, pages):
    """Copies that this machine made: JupyterLab may show their 3-D scenes."""
    write_copies(folder, pages)
    for notebook in pages.values():
        NotebookNotary().sign(notebook)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plain", action="store_true", help="build/notebooks, what the site offers for download")
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    arguments = parser.parse_args()
    execute_outdated(notebooks(), arguments.jobs)
    pages = build_notebooks()
    if arguments.plain:
        write_signed(PLAIN, {page: for_any_viewer(notebook) for page, notebook in pages.items()})
    else:
        write_lab(pages)


if __name__ == "__main__":
    main()
