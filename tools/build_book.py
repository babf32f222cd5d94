"""Execute every notebook of book/ once and build the site from the result: build/book -> _build/html.

The notebooks in book/ stay without outputs; nbmake executes copies, which makes the execution a test of each page and of
the solutions of its exercises, and Sphinx builds the site from the executed copies with warnings as errors.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import expressions  # beside this file
import nbformat
import solutions  # beside this file

ROOT = Path(__file__).resolve().parent.parent
# Not below _build: nbmake passes over everything there.
BUILD = ROOT / "build"
SOURCE = BUILD / "book"
SITE = ROOT / "_build"


def copy_book(pages):
    """Copies of the named pages, of all where none is named; returns the notebooks among them."""
    if not pages:
        shutil.rmtree(SOURCE, ignore_errors=True)
    unknown = [name for name in pages if not (ROOT / "book" / f"{name}.ipynb").exists()]
    if unknown:
        sys.exit(f"build_book: no such page in book/: {', '.join(f'{name}.ipynb' for name in unknown)}")
    passed_over = shutil.ignore_patterns(".ipynb_checkpoints", "_build", *(["*.ipynb"] if pages else []))
    shutil.copytree(ROOT / "book", SOURCE, ignore=passed_over, dirs_exist_ok=True)
    for name in pages:
        shutil.copy(ROOT / "book" / f"{name}.ipynb", SOURCE)
    return [SOURCE / f"{name}.ipynb" for name in pages] or sorted(SOURCE.glob("*.ipynb"))


def each_page(paths, change):
    """Change notebooks in place; what change() found wrong, as lines that name the page."""
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        wrong = change(notebook)
        nbformat.write(notebook, path)
        yield from (f"{path.name}, {line}" for line in wrong)


def stop_at(found):
    if found := list(found):
        sys.exit("build_book: the pages are wrong\n" + "\n".join(found))


def prepare(notebook):
    expressions.ask(notebook)
    solutions.append(notebook)
    return []


def finish(notebook):
    wrong = solutions.remove(notebook)
    return wrong + expressions.store(notebook) + errors_in(notebook)


def execute(paths, jobs, seconds_per_cell):
    # An empty pytest configuration: the tests' own settings (warnings as errors) are about the library, not about Jupyter.
    settings = BUILD / "nbmake.ini"
    settings.write_text("[pytest]\n")
    environment = os.environ | {"PYVISTA_OFF_SCREEN": "true", "JUPYTER_PREFER_ENV_PATH": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-c", settings, "--rootdir", BUILD, "-p", "no:cacheprovider",
               "--nbmake", "--overwrite", f"--nbmake-timeout={seconds_per_cell}", "-n", str(min(jobs, len(paths))),
               "--durations=0", *paths]
    if subprocess.run(command, env=environment, check=False).returncode:
        sys.exit("build_book: a notebook failed; the cell and its error are above")


def errors_in(notebook):
    """Error outputs of a notebook, also those that a widget callback wrote into an Output widget."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    for state in notebook.metadata.get("widgets", {}).values():
        outputs += [output for model in state.get("state", {}).values() for output in model["state"].get("outputs", [])]
    return [f"{output['ename']}: {output['evalue']}" for output in outputs if output["output_type"] == "error"]


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
    parser.add_argument("--pages", default="", help="execute only these, as in: --pages lbs,fourier")
    parser.add_argument("--no-site", action="store_true", help="execute the pages and leave the site as it is")
    arguments = parser.parse_args()
    BUILD.mkdir(exist_ok=True)
    paths = copy_book([name.strip().removesuffix(".ipynb") for name in arguments.pages.split(",") if name.strip()])
    stop_at(each_page(paths, prepare))
    execute(paths, arguments.jobs, arguments.seconds_per_cell)
    stop_at(each_page(paths, finish))
    if not arguments.no_site:
        build_site()


if __name__ == "__main__":
    main()
