"""Execute notebooks of book/ and build the site from the result: build/book -> _build/html.

Those are executed whose source, library or helpers changed since their last run.

Sphinx builds the site from the executed copies with warnings as errors. What the site offers for
download are the plain copies, which read in any viewer.
"""

import argparse
import shutil
import subprocess
import sys
from pathlib import Path

import nbformat

from . import decks, export_live, lab_copies
from .execute_pages import ROOT, SOURCE, execute_outdated, notebooks, run
from .plain import for_plain_viewers

SITE = ROOT / "_build"


def build_site(meanwhile):
    """Run Sphinx; what `meanwhile()` returns, called while the one process of Sphinx works."""
    shutil.rmtree(SITE / "html", ignore_errors=True)
    shutil.rmtree(SITE / ".doctrees", ignore_errors=True)
    command = [
        Path(sys.executable).with_name("jupyter-book"),
        "build",
        SOURCE,
        "--config",
        ROOT / "_config.yml",
        "--path-output",
        ROOT,
        "-W",
        "-n",
        "--keep-going",
        "--quiet",
    ]
    with subprocess.Popen(command) as sphinx:
        made = meanwhile()
    if sphinx.returncode:
        sys.exit("build_book: Sphinx found something to complain about; warnings count as errors")
    return made


def downloads():
    """The plain copies of the executed pages, page -> notebook."""
    copies = lab_copies.Copies()
    return {
        path.stem: copies.make(path.stem, for_plain_viewers)
        for path in sorted(SOURCE.glob("*.ipynb"))
    }


def offer(notebooks):
    """The site's 'download .ipynb' gives these."""
    for path in sorted((SITE / "html" / "_sources").glob("*.ipynb")):
        nbformat.write(notebooks[path.stem], path)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    parser.add_argument(
        "--pages",
        default="",
        help="execute these, whether they changed or not, and no others, as in: --pages lbs,fourier",
    )
    parser.add_argument(
        "--no-site", action="store_true", help="execute the pages and leave the site as it is"
    )
    arguments = parser.parse_args()
    pages = [
        name.strip().removesuffix(".ipynb") for name in arguments.pages.split(",") if name.strip()
    ]
    if pages:
        run(pages, arguments.jobs)
    else:
        execute_outdated(notebooks(), arguments.jobs)
    if not arguments.no_site:
        export_live.export()
        offer(build_site(meanwhile=downloads))
        decks.write(SITE / "html" / "decks", "../_static")


if __name__ == "__main__":
    main()
