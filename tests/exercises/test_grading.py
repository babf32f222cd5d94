"""`qclearn grade`: what students hand in gets what was planted, and nothing else is written.

`python tools/handins.py` grades four times as many."""

import csv
import os
import socket
from pathlib import Path

import pytest
from handins import NAMES, OTHERS, HandIns, plant, unexpected

import qclearn
from qclearn.cli import main
from qclearn.exercises import Limits, grade, grading, sitting

CHOSEN = (
    "cells-in-reverse",
    "exits",
    "tampers",
    "by-heart",
    "mistake-in-other-words",
    "endless-function",
    "right-but-child-left",
    "right-but-writes",
    "landmark-gradient-1",
)
SENTENCE = "Both equations change their sign,\nso the map stays."


def run(*words):
    main([str(word) for word in words])


def everything(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if "__pycache__" not in path.parts)


def children(word="86399"):
    """Processes that a hand-in has left running."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if word.encode() in file.read_bytes().split(b"\0"):
                yield int(file.parent.name)
        except OSError:
            pass


@pytest.fixture(scope="module")
def graded(tmp_path_factory):
    """(folder, what is expected, what was printed) of ten hand-ins that were graded."""
    folder = tmp_path_factory.mktemp("graded")
    (folder / "handed-in").mkdir()
    made = HandIns().all()
    chosen = {key: made[key] for key in CHOSEN}
    for cell in chosen["mistake-in-other-words"][0].cells:
        if "sentence" in cell.metadata.get("tags", []):
            cell.source = SENTENCE
    expected = plant(folder / "handed-in", chosen)
    library = Path(qclearn.__file__).parent
    before = everything(library)
    with pytest.MonkeyPatch.context() as patch:
        lines = []
        patch.setattr("qclearn.cli.grading.say", lines.append)
        run("grade", folder / "handed-in", "--out", folder / "grades.csv", "--seed", 2026, "--seconds", 3)
    assert everything(library) == before
    return folder, expected, lines


def test_ten_hand_ins_get_what_was_planted(graded):
    folder, expected, _ = graded
    assert len(expected) == 10 and list(unexpected(folder / "grades.csv", expected)) == []


def test_a_result_other_than_planted_is_told(graded):
    folder, expected, _ = graded
    wrong = {"alpha-signs": "words that nobody says"}
    assert len(list(unexpected(folder / "grades.csv", expected | {"tampers": wrong}))) == 1
    assert len(list(unexpected(folder / "grades.csv", expected | {"cells-in-reverse": wrong}))) == 1
    assert len(list(unexpected(folder / "grades.csv", expected | {"absent": {}}))) == 1


def test_csv_and_feedback_are_all_that_is_written(graded):
    folder, expected, _ = graded
    pages = [f"grades/{name}.md" for name in (*expected, "to-read")]
    handed_in = [f"handed-in/{name}.ipynb" for name in expected]
    assert everything(folder) == sorted(["grades", "grades.csv", "handed-in", *pages, *handed_in])


def test_points_are_added_up_and_a_page_tells_what_is_wrong(graded):
    folder, _, _ = graded
    with open(folder / "grades.csv", newline="", encoding="utf-8") as file:
        rows = {row["student"]: row for row in csv.DictReader(file)}
    assert list(rows["tampers"]) == ["student", "points", "of", *sorted(NAMES), "to read"]
    assert {row["of"] for row in rows.values()} == {rows["cells-in-reverse"]["points"]}
    lost = int(rows["tampers"]["of"]) - int(rows["tampers"]["points"])
    assert lost == grading.EXERCISES["alpha-signs"].points
    page = (folder / "grades" / "tampers.md").read_text()
    assert rows["tampers"]["alpha-signs"] in page and "Right." in page


def test_a_sentence_is_kept_for_the_teacher(graded):
    folder, _, printed = graded
    page = (folder / "grades" / "to-read.md").read_text()
    assert "**mistake-in-other-words**\n\n> Both equations change their sign,\n> so the map stays." in page
    assert "tampers" not in page and "to-read.md" in printed[-1]
    with open(folder / "grades.csv", newline="", encoding="utf-8") as file:
        to_read = {row["student"]: row["to read"] for row in csv.DictReader(file)}
    assert to_read.pop("mistake-in-other-words") == "alpha-signs" and set(to_read.values()) == {""}


def test_it_says_that_it_runs_the_students_code(graded):
    assert graded[2][0].startswith("running the students' code as you, with")
    assert graded[2][0].endswith("what you do not trust, grade in a container")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc tells which processes there are")
def test_nothing_is_left_running_where_processes_cannot_be_isolated_either(graded, tmp_path, monkeypatch):
    assert list(children()) == []
    key = "right-but-child-left"
    expected = plant(tmp_path, {key: HandIns().all()[key]})
    monkeypatch.setattr(grading, "is_isolated", lambda: False)
    found = grade(tmp_path, 5, Limits(20, 2))
    assert {each.student: set(each.said.values()) for each in found}[key] == {""} and key in expected
    assert list(children()) == []


@pytest.mark.skipif(not grading.is_isolated(), reason="this system lets no process give up its network")
def test_a_notebook_has_no_network(tmp_path):
    text = "import socket\ndef alphas(mu):\n    return socket.create_connection(('127.0.0.1', %d))"
    with socket.create_server(("127.0.0.1", 0)) as server:
        handed_in = HandIns().notebook(alpha_signs=text % server.getsockname()[1])
        plant(tmp_path, {"asks": (handed_in, {})})
        (found,) = (each for each in grade(tmp_path, 5, Limits(20, 2)) if each.student == "asks")
    assert "OSError" in found.said["alpha-signs"] or "unreachable" in found.said["alpha-signs"]


def test_a_cell_is_run_with_magics_and_its_error_told():
    space = {}
    assert sitting.run_cell("%matplotlib inline\n!ls\nx = 1", "<cell 1>", space) == "" and space["x"] == 1
    assert sitting.run_cell("s = '''\n%d\n''' % 3", "<cell 2>", space) == "" and space["s"] == "\n3\n"
    assert sitting.run_cell("y = 2\n1 / 0", "<cell 3>", space) == "ZeroDivisionError: division by zero"
    assert space["y"] == 2 and sitting.run_cell("def f(:", "<cell 4>", space).startswith("SyntaxError: ")
    assert sitting.run_cell(OTHERS["right-in-other-words"], "<cell 5>", space) == "" and callable(space["alphas"])


def test_a_spreadsheet_takes_no_name_for_a_formula(tmp_path):
    plant(tmp_path, {})
    os.rename(tmp_path / "no-notebook.ipynb", tmp_path / "=cmd().ipynb")
    assert grading.table(grade(tmp_path, 5, Limits()))[1][0] == "'=cmd()"


@pytest.mark.parametrize(
    "words, told",
    [
        (["{folder}/empty"], "no notebook (*.ipynb) in this folder"),
        (["{folder}/full", "--seed", "0"], "--seed 0: the students' own checks draw their inputs by 0"),
        (["{folder}/full", "--seconds", "0"], "--seconds, --gb and --jobs have to be positive numbers"),
        (["{folder}/full", "--out", "{folder}/grades"], "give a name that ends in .csv"),
        (["{folder}/full", "--out", "{folder}/nowhere/grades.csv"], "in a folder that exists"),
        (["{folder}/nowhere"], "does not exist"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, capsys, words, told):
    (tmp_path / "empty").mkdir()
    (tmp_path / "full").mkdir()
    plant(tmp_path / "full", {})
    before = everything(tmp_path)
    out = [] if "--out" in words else ["--out", tmp_path / "grades.csv"]
    with pytest.raises(SystemExit) as stop:
        run("grade", *(word.format(folder=tmp_path) for word in words), *out)
    lines = capsys.readouterr().err.splitlines()
    assert stop.value.code == 2 and len(lines) == 1 and told in lines[0]
    assert everything(tmp_path) == before
