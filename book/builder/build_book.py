"""Execute notebooks of book/ and build the site from the result: build/book -> _build/html.

Those are executed whose source, library or helpers changed since their last run.

Sphinx builds the site from the executed copies with warnings as errors, and then the pages as
notebooks (notebooks.py), which the site offers for download.
"""

import argparse
import shutil
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import nbformat

from . import core, decks, export_live
from .execute_pages import ROOT, SOURCE, execute_outdated, notebooks, run
from .notebooks import for_any_viewer
from .references import chapters

SITE = ROOT / "_build"


def sphinx(*builder):
    """Run Sphinx on build/book; without the name of a builder it makes the site."""
    core.write_thumbs(SOURCE)
    command = [Path(sys.executable).with_name("jupyter-book"), "build", SOURCE, "--config", ROOT / "_config.yml"]
    command += ["--path-output", ROOT, *builder, "-W", "-n", "--keep-going", "--quiet"]
    if subprocess.run(command, check=False).returncode:
        sys.exit("build_book: Sphinx found something to complain about; warnings count as errors")


def build_notebooks():
    """page -> notebook, in the order of the contents. Sphinx reads only what changed since it ran
    last."""
    shutil.rmtree(SITE / "notebook", ignore_errors=True)
    sphinx("--builder", "custom", "--custom-builder", "notebook")
    return {page: nbformat.read(SITE / "notebook" / f"{page}.ipynb", as_version=4) for page in chapters()}


def offer(pages):
    """The site's 'download .ipynb' gives these notebooks."""
    for path in sorted((SITE / "html" / "_sources").glob("*.ipynb")):
        nbformat.write(for_any_viewer(pages[path.stem]), path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    words = "execute these, whether they changed or not, and no others, as in: --pages lbs,fourier"
    parser.add_argument("--pages", default="", help=words)
    parser.add_argument("--no-site", action="store_true", help="execute the pages and leave the site as it is")
    parser.add_argument("--lab", action="store_true", help="also write the copies for JupyterLab, build/lab")
    arguments = parser.parse_args()
    pages = [name.strip().removesuffix(".ipynb") for name in arguments.pages.split(",") if name.strip()]
    if pages:
        run(pages, arguments.jobs)
    else:
        execute_outdated(notebooks() + notebooks("decks"), arguments.jobs)
    if not arguments.no_site:
        export_live.export()
        for name in ("html", ".doctrees"):
            shutil.rmtree(SITE / name, ignore_errors=True)
        sphinx()
        pages = build_notebooks()
        decks.write(SITE / "html" / "decks", "../_static", r" \1(../\2.html)")
        if arguments.lab:
            from .lab_copies import write_lab  # as a program of its own it asks this one for the pages

            write_lab(deepcopy(pages))
        offer(pages)


if __name__ == "__main__":
    main()
