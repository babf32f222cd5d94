"""The folder that a command writes: whole or absent, whenever its process is killed."""

import io
import os
import subprocess
import sys
import warnings
from pathlib import Path

import click
import pytest
from tqdm import tqdm

from qclearn.cli.output import expanded, fail, file_to_write, output_folder, say, unfailing_streams, warn

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


# Messages


def full_disk():
    return open("/dev/full", "w")


def gone_reader():
    reader, writer = os.pipe()
    os.close(reader)
    return open(writer, "w")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full disk")
@pytest.mark.parametrize("end", [full_disk, gone_reader])
def test_the_exit_code_does_not_depend_on_who_listens(monkeypatch, end):
    with end() as out, end() as err:
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", err)
        with pytest.raises(SystemExit) as stop, unfailing_streams():
            for number in tqdm(range(2), mininterval=0):
                say(f"written {number}" * 9999)
            fail("suspect", 3)
        assert stop.value.code == 3
        out.flush()  # as Python does at its end


@pytest.mark.parametrize("encoding", ["cp932", "gbk", "cp1251", "ascii"])
def test_letters_that_an_encoding_lacks_are_escaped(monkeypatch, encoding):
    data = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(data, encoding))
    with unfailing_streams():
        say("M\xf6bius \u2212 \udcfc")
    assert data.getvalue().startswith(rb"M\xf6bius")


def test_streams_that_are_not_there_are_none(monkeypatch):
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    with unfailing_streams():
        say("to nobody")
        warn("to nobody")
    assert sys.stdout is None


def test_a_warning_is_one_line(capsys):
    with unfailing_streams():
        warnings.simplefilter("always")
        warnings.warn("left\nout", stacklevel=1)
    assert capsys.readouterr().err == "qclearn: left out\n"


# Places


def test_the_home_folder_is_filled_in_where_shells_leave_it(monkeypatch):
    monkeypatch.setenv("HOME", "/elsewhere/ada")
    monkeypatch.setenv("USERPROFILE", "/elsewhere/ada")
    assert expanded("--out=~/reg") == f"--out={Path.home() / 'reg'}"
    assert expanded("~/lh.pial") == str(Path.home() / "lh.pial")
    for name in ("~", "~lh.pial", "a~/b", "--method=harmonic", "x=~/y", "fsaverage5:left"):
        assert expanded(name) == name
    with pytest.raises(click.UsageError, match="--out=~nobody.at.all/x: ~ is no known folder"):
        expanded("--out=~nobody.at.all/x")


def test_a_file_is_refused_before_the_work(tmp_path, monkeypatch):
    assert file_to_write(tmp_path / "a.npz") == tmp_path / "a.npz"
    for path, fault in ((tmp_path, "is a folder"), (tmp_path / "none" / "a.npz", "its folder does not exist")):
        with pytest.raises(OSError, match=f"{path}: cannot be written: {fault}"):
            file_to_write(path)
    monkeypatch.setattr(os, "access", lambda place, how: False)
    with pytest.raises(OSError, match="or is not writable"):
        file_to_write(tmp_path / "a.npz")
