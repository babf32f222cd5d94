"""The folder that a command writes: whole or absent, whenever its process is killed."""

import os
import subprocess
import sys

import pytest

from qclearn.cli.output import output_folder

# Runs that are killed: in the block, before the folder takes its place, and while files replace
# those of an older run
KILLED = """
import os, signal, sys
from qclearn.cli import output

def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)

def run(place, moment):
    if moment != "block":
        one_by_one, count = os.replace, []
        output.os.rename = die
        output.os.replace = lambda *ways: die() if len(count) == 2 else count.append(one_by_one(*ways))
    with output.output_folder(place) as folder:
        for name in ("figure.png", "registration.npz", "report.json"):
            (folder / name).write_text("new")
        if moment == "block":
            die()

for moment in ("block", "new", "older"):
    process = os.fork()
    if not process:
        run(f"{sys.argv[1]}/{moment}/out", moment)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == -signal.SIGKILL, moment
"""


def write(place, *names, **options):
    with output_folder(place, **options) as folder:
        for name in names:
            (folder / name).write_text("old")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="no SIGKILL")
def test_a_killed_run_leaves_no_folder_that_looks_whole(tmp_path):
    for moment in ("block", "new"):
        (tmp_path / moment).mkdir()
    write(tmp_path / "older" / "out", "notes.txt", "registration.npz", "report.json")
    subprocess.run([sys.executable, "-c", KILLED, tmp_path], check=True)
    for moment in ("block", "new"):
        (leftover,) = names(tmp_path / moment)
        assert leftover.startswith(".qclearn-")
        write(tmp_path / moment / "out", "report.json")  # which sweeps it up
        assert names(tmp_path / moment) == ["out"]
    assert "report.json" not in names(tmp_path / "older" / "out")
    write(tmp_path / "older" / "out", "registration.npz", "report.json")
    assert names(tmp_path / "older" / "out") == ["figure.png", "notes.txt", "registration.npz", "report.json"]


def test_a_folder_that_is_there_keeps_what_is_not_of_the_run(tmp_path):
    write(tmp_path / "out", "report.json", "report.html", "notes.txt")
    write(tmp_path / "out", "report.json", instead=["report.html"])
    assert names(tmp_path / "out") == ["notes.txt", "report.json"]


def test_a_new_folder_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "usual").mkdir()
    write(tmp_path / "deep" / "out", "report.json")
    assert (tmp_path / "deep" / "out").stat().st_mode == (tmp_path / "usual").stat().st_mode
