"""`qclearn grade`: what students hand in gets what was planted, and nothing else is written.

`python -m book.builder.handins` grades four times as many."""

import csv
import json
import os
import socket
import sys
from pathlib import Path

import numpy as np
import pytest
from nbformat.v4 import new_markdown_cell, new_notebook

import qclearn
from book.builder.handins import NAMES, OTHERS, HandIns, plant, unexpected
from qcbook.exercises import UNANSWERED, Limits, grade, grading, handedin, sitting
from qclearn.cli import main

CHOSEN = (
    "cells-in-reverse",
    "exits",
    "tampers",
    "by-heart",
    "mistake-in-other-words",
    "endless-function",
    "right-but-child-left",
    "right-but-writes",
    os.fsdecode(b"J\xfcrgen"),
)
SENTENCE = "Both equations change their sign,\nso the map stays."


def run(*words):
    main([str(word) for word in words])


def everything(folder):
    paths = [path.relative_to(folder) for path in folder.rglob("*") if "__pycache__" not in path.parts]
    return sorted(os.fsencode(path).decode(errors="replace") for path in paths)


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
    assert list(rows["tampers"]) == ["student", "points", "of", *sorted(NAMES), "to read", "look at"]
    assert {name: row["look at"] for name, row in rows.items() if row["look at"]} == {
        "tampers": "EXERCISES, sys.modules"
    }
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
    wrote = [student for student, names in to_read.items() if names == "alpha-signs"]
    assert wrote == ["J\ufffdrgen", "mistake-in-other-words"] and set(to_read.values()) == {"", "alpha-signs"}
    assert "> Half a character, \ufffd, and \ufffd[31mred." in page and "(10), E1, not" in page


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
    assert sitting.run_cell("x = 1\nx = = 2", "<cell 6>", space) == "SyntaxError: invalid syntax, in `x = = 2`"


def test_a_spreadsheet_takes_no_name_for_a_formula(tmp_path):
    plant(tmp_path, {})
    os.rename(tmp_path / "no-notebook.ipynb", tmp_path / "=cmd().ipynb")
    assert grading.table(grade(tmp_path, 5, Limits()))[1][0] == "'=cmd()"


def handed_in(folder, *cells):
    """What is read of a notebook with these cells below the question of alpha-signs: pairs (text, metadata)."""
    question = (f"## {grading.EXERCISES['alpha-signs'].title}\n\n2 points ...", {})
    made = [new_markdown_cell(text, metadata=metadata) for text, metadata in (question, *cells)]
    (folder / "ada.ipynb").write_text(json.dumps(new_notebook(cells=made)), encoding="utf-8")
    return handedin.read(folder / "ada.ipynb")


SENTENCES = {"tags": ["sentence"], "exercise": "alpha-signs"}


@pytest.mark.parametrize(
    "cells, written",
    [
        ([(f"{UNANSWERED}\n\nBelow.", SENTENCES)], "Below."),
        ([("First.", SENTENCES), (UNANSWERED, SENTENCES)], "First."),
        ([(UNANSWERED, SENTENCES), ("My own cell.", {}), ("Another.", {})], "My own cell.\n\nAnother."),
        ([(UNANSWERED, {}), ("All metadata is lost.", {})], "All metadata is lost."),
        ([("For the next.", {"tags": ["question"], "exercise": "accept-fold"}), ("Not read.", {})], None),
        ([(UNANSWERED, SENTENCES)], None),
        ([("YOUR ANSWER HERE", SENTENCES)], None),
    ],
)
def test_a_sentence_counts_wherever_it_was_written(tmp_path, cells, written):
    assert handed_in(tmp_path, *cells).written.get("alpha-signs") == written


def test_pictures_lost_metadata_and_an_old_format_are_told(tmp_path):
    notebook = handed_in(tmp_path, ("See.", {}))
    assert notebook.names == ["alpha-signs"] and notebook.look_at == "the cells have lost their metadata"
    cells = [{"cell_type": "markdown", "source": ["x"], "metadata": SENTENCES, "attachments": {"a.png": {}}}]
    (tmp_path / "ada.ipynb").write_text(json.dumps({"cells": cells}))
    assert "(has 1 picture: open the notebook)" in handedin.read(tmp_path / "ada.ipynb").written["alpha-signs"]
    (tmp_path / "ada.ipynb").write_text(json.dumps({"worksheets": [], "nbformat": 3}))
    assert "save it anew" in handedin.read(tmp_path / "ada.ipynb").unread


def test_the_students_own_checks_are_not_run_and_nothing_else_is_dropped():
    cell = handedin.Cell(
        "code", "def f(): ...\ncheck('a-b', f)  # mine\ncheck(f); g = 1\nif f:\n    check(\"a\", f)", *"   "
    )
    (code,) = handedin.HandedIn("ada", (cell,)).code
    assert code == "def f(): ...\npass\ncheck(f); g = 1\nif f:\n    pass"


def test_the_last_value_of_the_right_kind_is_asked():
    exercise, space, had = grading.EXERCISES["alpha-signs"], {"np": np}, []
    reused = exercise.solved + "alphas = alphas(0.5j)"
    assert sitting.run_cell(reused, "", space, lambda: had.append(space["alphas"])) == ""
    assert not callable(had[-1]) and sitting.words_on(exercise, had, [], 5) == ""


def test_what_a_notebook_changed_is_restored():
    kept, largest = sitting.kept(), np.max
    space = {"qc": qclearn}
    assert (
        sitting.run_cell(
            "import numpy as np\nnp.max = qc.transfer = len\nimport sys\nsys.modules['math'] = None", "", space
        )
        == ""
    )
    sitting.restore(kept)
    assert np.max is largest and qclearn.transfer is not len and sys.modules["math"] is not None


def test_one_notebook_that_cannot_be_graded_stops_no_other(tmp_path, monkeypatch):
    plant(tmp_path, {})
    (tmp_path / "ada.ipynb").write_text(json.dumps({"cells": []}))
    monkeypatch.setattr(grading, "_said", lambda notebook, *_: {}["ada"] if not notebook.unread else {"x": ""})
    told = {each.student: each.said for each in grade(tmp_path, 5, Limits())}
    assert told["no-notebook"] == {"x": ""} and set(told["ada"].values()) == {"could not be graded: KeyError: 'ada'"}


def test_pages_do_not_collide_none_is_stale_and_the_rest_is_passed_over_aloud(tmp_path, monkeypatch):
    folder, lines = tmp_path / "all", []
    (folder / "below").mkdir(parents=True)
    handed_in(folder, ("My sentence.", {})), handed_in(folder / "below")
    os.rename(folder / "ada.ipynb", folder / "to-read.ipynb")
    (folder / "BOB.IPYNB").touch()
    monkeypatch.setattr("qclearn.cli.grading.say", lines.append)
    run("grade", folder, "--out", tmp_path / "grades.csv")
    assert everything(tmp_path / "grades") == ["to-read-.md", "to-read.md"]
    assert lines[1].endswith(f"{folder / 'BOB.IPYNB'}, {folder / 'below' / 'ada.ipynb'}") and lines[2].startswith(
        "1 notebook,"
    )
    (folder / "to-read.ipynb").write_text("")
    run("grade", folder, "--out", tmp_path / "grades.csv", "--sheet", folder / "below" / "ada.ipynb")
    assert "to-read.md" not in everything(tmp_path / "grades")
    assert (tmp_path / "grades.csv").read_text().splitlines()[0] == "student,points,of,alpha-signs,to read,look at"


@pytest.mark.parametrize(
    "words, told",
    [
        (["{folder}/empty"], "no notebook (*.ipynb) in this folder"),
        (["{folder}/full", "--seed", "0"], "--seed 0: the students' own checks draw their inputs by 0"),
        (["{folder}/full", "--seconds", "0"], "--seconds, --gb and --jobs have to be positive numbers"),
        (["{folder}/full", "--out", "{folder}/grades"], "give a name that ends in .csv"),
        (["{folder}/full", "--out", "{folder}/nowhere/grades.csv"], "in a folder that exists"),
        (["{folder}/full", "--out", "{folder}/full.csv"], "the feedback would go among what was handed in"),
        (["{folder}/full", "--sheet", "{folder}/full/no-notebook.ipynb"], "names no exercise"),
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
