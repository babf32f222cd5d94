"""Execute notebooks of book/ as copies in build/book, and hold them to what a page has to keep to.

The notebooks in book/ stay without outputs. nbmake executes the copies, which makes the execution a
test of each page and of the solutions of its exercises.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import nbformat

from . import expressions, graded, guards, solutions, subjects, teaching
from .packages import installed_copy

ROOT = Path(__file__).resolve().parents[2]
# Not below _build: nbmake passes over everything there.
BUILD = ROOT / "build"
SOURCE = BUILD / "book"
PROGRAMS = ("qcbook", "builder", "studies")  # of book/: no pages
SECONDS_PER_CELL = 120  # one that takes longer is a failure
PACKAGES = "qclearn", "data_synth", "book/qcbook"
# The programs that prepare and finish a run, beside this one.
HELPERS = expressions, graded, guards, solutions
PASSED_OVER = {"__pycache__", "browser"}
REPORT = BUILD / "executed.xml"  # of pytest on the last run
FAILED = "build_book: a notebook failed; the cell and its error are above"
STAMPS = SOURCE / ".stamps.json"  # page -> what its last good run was a run of


def notebooks(folder="."):
    """The names of all pages that are executed; notebooks("decks"): of the lectures, decks/NAME."""
    book = ROOT / "book"
    return sorted(path.relative_to(book).with_suffix("").as_posix() for path in (book / folder).glob("*.ipynb"))


def copy_book():
    """Copy what book/ holds besides notebooks; of build/book, only runs of pages that book/ still
    has stay."""
    names = {f"{name}.ipynb" for name in notebooks()} | {STAMPS.name}
    for path in set(SOURCE.glob("*")) - {SOURCE / "decks"}:
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name not in names:
            path.unlink()
    passed_over = shutil.ignore_patterns(".ipynb_checkpoints", "_build", "__pycache__", *PROGRAMS, "*.ipynb")
    shutil.copytree(ROOT / "book", SOURCE, ignore=passed_over, dirs_exist_ok=True)
    for path in SOURCE.glob("*.md"):
        path.write_text(teaching.put(path.read_text(encoding="utf-8")), encoding="utf-8")


def copy_pages(pages):
    """Copies of the named notebooks, to be executed."""
    unknown = [f"{name}.ipynb" for name in pages if name not in notebooks() + notebooks("decks")]
    if unknown:
        sys.exit(f"build_book: no such page in book/: {', '.join(unknown)}")
    return [Path(shutil.copy(ROOT / "book" / f"{name}.ipynb", SOURCE / f"{name}.ipynb")) for name in pages]


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


def prose(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "markdown"]


def prepare(notebook):
    try:
        for cell in prose(notebook):
            cell.source = graded.put(cell.source, with_solutions=True)
    except KeyError as error:
        return [error.args[0]]
    wrong = list(guards.figures(notebook))
    expressions.ask(notebook)
    solutions.append(notebook)
    return wrong


def finish(notebook):
    wrong = solutions.remove(notebook) + expressions.store(notebook)
    if not solutions.SHOWN:
        for cell in prose(notebook):
            cell.source = solutions.without(cell.source, graded.labels())
    return wrong + errors_in(notebook) + list(guards.pictures_without_a_name(notebook))


def execute(paths, jobs):
    """Run copies of pages in place: the names of those that fail, a set."""
    # An empty pytest configuration: the tests' own settings (warnings as errors) are about the
    # library, not about Jupyter.
    settings = BUILD / "nbmake.ini"
    settings.write_text("[pytest]\n")
    # A page runs where nothing of the repository lies, beside the package as it is installed from
    # its wheel.
    installed = installed_copy(BUILD / "wheel")
    environment = os.environ | {
        "PYVISTA_OFF_SCREEN": "true",
        "JUPYTER_PREFER_ENV_PATH": "1",
        "PYTHONPATH": str(installed),
        "NUMBA_CACHE_DIR": str(BUILD / "numba"),  # not beside the code, which each build unpacks anew
        "QCLEARN_SUBJECTS": str(subjects.folder()),
        "QCLEARN_PAGES": "static",  # explorables as elements for the site's script, not as widgets
    }
    asked = [sys.executable, "-c", "import qcbook, qclearn; print(qcbook.__file__, qclearn.__file__)"]
    found = subprocess.run(asked, env=environment, cwd=BUILD, capture_output=True, text=True, check=True).stdout
    assert found.count(str(installed)) == 2, f"the pages would run with {found}"
    command = [sys.executable, "-m", "pytest", "-q", "-c", settings, "--rootdir", BUILD, "-p", "no:cacheprovider"]
    command += ["--nbmake", "--overwrite", f"--nbmake-timeout={SECONDS_PER_CELL}", "-n", str(min(jobs, len(paths)))]
    command += ["--durations=0", f"--junitxml={REPORT}", *paths]
    REPORT.unlink(missing_ok=True)
    ended = subprocess.run(command, env=environment, check=False).returncode
    if ended > 1:  # pytest itself: no page is known to be good
        sys.exit(FAILED)
    cases = ElementTree.parse(REPORT).iter("testcase")
    # A class is named book.PAGE.ipynb or book.decks.NAME.ipynb.
    return {"/".join(case.get("classname").split(".")[1:-1]) for case in cases if len(case)}


def library_digest():
    """Of all that a page computes with: the packages with weights and measured files, the versions
    of others, the book's tables, and the programs that prepare and finish a run. What runs in
    browsers alone is left out."""
    programs = [Path(__file__), *(Path(helper.__file__) for helper in HELPERS)]
    files = [ROOT / "constraints.txt", *(ROOT / "book").glob("*.toml"), *programs]
    for package in PACKAGES:
        files += [file for file in (ROOT / package).rglob("*") if file.is_file() and not PASSED_OVER & {*file.parts}]
    found = hashlib.sha256(str(solutions.SHOWN).encode())
    for file in sorted(files):
        found.update(file.read_bytes())
    return found.hexdigest()


def stamp(page):
    """Changes when a run of the page is out of date: the page or the library changed."""
    source = next(file for file in (ROOT / "book" / f"{page}{kind}" for kind in (".ipynb", ".md")) if file.exists())
    return hashlib.sha256(source.read_bytes()).hexdigest() + library_digest()


def run(pages, jobs):
    """Execute the named pages into build/book; stops at what is wrong, behind the last page."""
    SOURCE.mkdir(parents=True, exist_ok=True)
    copy_book()  # pages read its files
    stamps = json.loads(STAMPS.read_text()) if STAMPS.exists() else {}
    paths = copy_pages(pages)
    new = {page: stamp(page) for page in pages}  # a change during the run makes it out of date
    # The copies have no outputs yet: were this run stopped, no stamp may say that they have.
    stamps = {page: value for page, value in stamps.items() if page not in pages}
    STAMPS.write_text(json.dumps(stamps, indent=1))
    stop_at(each_page(paths, prepare))
    failed = execute(paths, jobs)
    ran = {page: path for page, path in zip(pages, paths) if page not in failed}
    wrong = {page: list(each_page([path], finish)) for page, path in ran.items()}
    # Good pages have their stamps, so that the next build executes the others alone.
    bad = failed | {page for page, lines in wrong.items() if lines}
    STAMPS.write_text(json.dumps(stamps | {page: new[page] for page in pages if page not in bad}, indent=1))
    if failed:
        sys.exit(FAILED)
    stop_at(chain.from_iterable(wrong.values()))


def execute_outdated(pages, jobs):
    """Execute those of the pages of which build/book has no run, or one of an older page or
    library."""
    stamps = json.loads(STAMPS.read_text()) if STAMPS.exists() else {}
    outdated = [page for page in pages if stamps.get(page) != stamp(page)]
    if outdated:
        print(f"build_book: executing {', '.join(outdated)}", flush=True)
        run(outdated, jobs)
    else:
        copy_book()


def errors_in(notebook):
    """Error outputs of a notebook, also those that a widget callback wrote into an Output widget."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    for state in notebook.metadata.get("widgets", {}).values():
        outputs += [output for model in state.get("state", {}).values() for output in model["state"].get("outputs", [])]
    return [f"{output['ename']}: {output['evalue']}" for output in outputs if output["output_type"] == "error"]
