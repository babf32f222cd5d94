"""The guide's commands, run by nbgrader on hand-ins of each kind: right, wrong, endless and broken."""

import csv
import io
import json
import os
import re
import warnings
from copy import deepcopy
from pathlib import Path

import nbformat
import pytest
from nbgrader.apps import NbGraderApp

from book.builder import course
from book.builder.graded import EXERCISES
from book.builder.references import markdown_of

EXERCISE, OTHER = EXERCISES["alpha-signs"], EXERCISES["accept-fold"]
MISTAKE = "sign of alpha_2"
WRONG = EXERCISE.solved.replace(*EXERCISE.module.MISTAKES[MISTAKE][0])
ENDLESS = "import time\ndef alphas(mu):\n    while True:\n        time.sleep(0.1)"
WARNS = "import sys\nprint('a warning', file=sys.stderr)\n"
BLOCKS = "".join(re.findall(r"^ *```sh\n(.*?)```", markdown_of("teaching"), re.MULTILINE | re.DOTALL))
GUIDE = re.findall(r"^ *(nbgrader .+?)(?: +#.*)?$", BLOCKS, re.MULTILINE)
LIMIT = 1  # seconds a cell from an endless answer on; others have what a busy machine needs


def nbgrader(folder, command):
    """Run a command of the guide in this process, without the environment's programs on PATH: exit code, output."""
    words, printed, code, endless = command.split()[1:], io.StringIO(), 0, []

    def seconds(cell):
        endless.append("while True" in cell.source)
        return LIMIT if any(endless) else 600

    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.chdir(folder)
        patch.setenv("PATH", os.defpath)
        patch.setattr("sys.stderr", printed)
        patch.setattr("sys.stdout", printed)
        app = NbGraderApp()
        app.config.Execute.timeout_func = seconds
        try:
            app.initialize(words)
            app.subapp.start()
        except SystemExit as stop:
            code = stop.code or 0
        type(app.subapp).clear_instance()
    return code, printed.getvalue()


def handed_in(release, *answers, lacks=()):
    """A student's notebook with these answers, without some cells."""
    notebook, left = deepcopy(release), list(answers)
    notebook.cells = [cell for cell in notebook.cells if cell.id not in lacks]
    for cell in notebook.cells:
        if "answer" in cell.metadata.get("tags", []):
            cell.source = left.pop(0)
    return notebook


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """(folder of the course, command -> what it printed), once the guide's commands have run."""
    folder = tmp_path_factory.mktemp("course")
    course.write([EXERCISE.name, OTHER.name], "week1", folder)
    printed = {}

    def run(command):
        code, printed[command.split()[1]] = nbgrader(folder, command)
        assert code == 0, printed

    wanted = ["generate_assignment", "zip_collect", "autograde", "generate_feedback", "export"]
    assert [command.split()[1] for command in GUIDE] == wanted
    run(GUIDE[0])
    release = nbformat.read(folder / "release" / "week1" / "week1.ipynb", as_version=4)
    bare = handed_in(release, EXERCISE.solved, OTHER.solved)
    for cell in bare.cells:
        cell.metadata.clear()
    right = f"%%time\n{OTHER.solved}\n{WARNS}files = !ls \\\n  -a"
    files = {
        "ada.ipynb": handed_in(release, WRONG, right, lacks=[f"{EXERCISE.name}-sentence"]),
        "cem.ipynb": handed_in(release, ENDLESS, "def no_function(mu:\n    return 1"),
        "no metadata.ipynb": bare,
        "renamed.ipynb.txt": release,
        "with,comma.ipynb": release,
        "list.ipynb": [],
    }
    archive = folder / "downloaded" / "week1" / "archive"
    for name, notebook in files.items():
        (archive / name).write_text(json.dumps(notebook), encoding="utf-8")
    (archive / "text.ipynb").write_text("def alphas(mu): ...")
    for command in GUIDE[1:]:
        run(command)
    return folder, printed


def feedback(folder, student):
    """The words of a student's feedback, in single spaces."""
    page = (folder / "feedback" / student / "week1" / "week1.html").read_text(encoding="utf-8")
    return " ".join(re.sub(r"<[^>]+>", "", page).split())


def test_right_and_wrong_answers_get_their_points(graded):
    with open(graded[0] / "grades.csv", newline="", encoding="utf-8") as file:
        rows = {row["student_id"]: (float(row["score"]), float(row["max_score"])) for row in csv.DictReader(file)}
    most = EXERCISE.points + OTHER.points
    assert rows == {"ada": (OTHER.points, most), "cem": (0, most)}


def test_the_feedback_names_the_mistake_and_says_nothing_of_what_is_right(graded):
    page = feedback(graded[0], "ada")
    assert f"AssertionError: {EXERCISE.sentences[MISTAKE][:60]}" in page
    assert page.count("AssertionError: ") == 1 and not any(words[:60] in page for words in OTHER.sentences.values())


def test_an_endless_loop_is_stopped_and_named_and_so_is_what_python_does_not_read(graded):
    page = feedback(graded[0], "cem")
    assert "does a loop in it, or in what it calls, never end?" in page and "SyntaxError" in page


def test_what_cannot_be_graded_is_refused_in_a_line_each(graded):
    lines = [line.partition("ERROR] ")[2] for line in graded[1]["zip_collect"].splitlines() if "ERROR] " in line]
    files = ["ada.ipynb", "list.ipynb", "no metadata.ipynb", "renamed.ipynb.txt", "text.ipynb", "with,comma.ipynb"]
    assert [line.split(": ")[0] for line in lines] == files
    missing, a_list, bare, renamed, text, comma = lines
    assert missing.endswith("0 points where cells are missing: alpha-signs-sentence")
    assert "not a notebook that nbgrader reads" in a_list and "does not appear to be JSON" in text
    assert "copy the answers into that notebook" in bare
    assert "rename the file" in renamed and "rename the file" in comma
    assert "Traceback" not in "".join(graded[1].values())


def test_a_release_that_students_have_handed_in_keeps_its_cells(graded):
    folder, _ = graded
    assert (folder / "nbgrader_config.py").read_text() == Path(course.SETTINGS).read_text()
    course.write([OTHER.name], "week1", folder)
    with pytest.raises(SystemExit, match="Cannot add or remove cells"):
        course.release("week1", folder)


BAD = {"--seed 0": "--seed 0: the students' own checks draw by 0", "--name a/b": "--name a/b: letters, digits"}


@pytest.mark.parametrize("words, reason", [*BAD.items(), ("no-such", "no such exercise: no-such")])
def test_bad_words_for_a_sheet_are_refused(monkeypatch, words, reason):
    monkeypatch.setattr("sys.argv", ["course", *words.split()])
    with pytest.raises(SystemExit, match=reason):
        course.main()
