"""Execute every notebook of book/ once and build the site from the result: build/book -> _build/html.

The notebooks in book/ stay without outputs; nbmake executes copies, which makes the execution a test of each page, and
Sphinx builds the site from the executed copies with warnings as errors.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import expressions  # beside this file
import nbformat

ROOT = Path(__file__).resolve().parent.parent
# Not below _build: nbmake passes over everything there.
BUILD = ROOT / "build"
SOURCE = BUILD / "book"
SITE = ROOT / "_build"


def copy_book():
    shutil.rmtree(SOURCE, ignore_errors=True)
    shutil.copytree(ROOT / "book", SOURCE, ignore=shutil.ignore_patterns(".ipynb_checkpoints", "_build"))


def each_page(change):
    for path in sorted(SOURCE.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        wrong = change(notebook) or []
        nbformat.write(notebook, path)
        yield from (f"{path.name}: {line}" for line in wrong)


def execute(jobs, seconds_per_cell):
    # An empty pytest configuration: the tests' own settings (warnings as errors) are about the library, not about Jupyter.
    settings = BUILD / "nbmake.ini"
    settings.write_text("[pytest]\n")
    environment = os.environ | {"PYVISTA_OFF_SCREEN": "true", "JUPYTER_PREFER_ENV_PATH": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-c", settings, "--rootdir", BUILD, "-p", "no:cacheprovider",
               "--nbmake", "--overwrite", f"--nbmake-timeout={seconds_per_cell}", "-n", str(jobs), "--durations=0",
               SOURCE]
    if subprocess.run(command, env=environment, check=False).returncode:
        sys.exit("build_book: a notebook failed; the cell and its error are above")


def errors_in(notebook):
    """Error outputs of a notebook, also those that a widget callback wrote into an Output widget."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    for state in notebook.metadata.get("widgets", {}).values():
        outputs += [output for model in state.get("state", {}).values() for output in model["state"].get("outputs", [])]
    return [f"{output['ename']}: {output['evalue']}" for output in outputs if output["output_type"] == "error"]


def store_expressions():
    if found := list(each_page(expressions.store)):
        sys.exit("build_book: numbers of the prose\n" + "\n".join(found))


def require_clean_outputs():
    found = [f"{path.name}: {error}" for path in sorted(SOURCE.glob("*.ipynb"))
             for error in errors_in(nbformat.read(path, as_version=4))]
    if found:
        sys.exit("build_book: errors in the executed pages\n" + "\n".join(found))


def build_site():
    shutil.rmtree(SITE / "html", ignore_errors=True)
    shutil.rmtree(SITE / ".doctrees", ignore_errors=True)
    command = [Path(sys.executable).with_name("jupyter-book"), "build", SOURCE, "--config", ROOT / "_config.yml",
               "--path-output", ROOT, "-W", "-n", "--keep-going", "--quiet"]
    if subprocess.run(command, check=False).returncode:
        sys.exit("build_book: Sphinx found something to complain about; warnings count as errors")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks executed side by side")
    parser.add_argument("--seconds-per-cell", type=int, default=120, help="a cell that takes longer is a failure")
    arguments = parser.parse_args()
    BUILD.mkdir(exist_ok=True)
    copy_book()
    list(each_page(expressions.ask))
    execute(arguments.jobs, arguments.seconds_per_cell)
    store_expressions()
    require_clean_outputs()
    build_site()


if __name__ == "__main__":
    main()
