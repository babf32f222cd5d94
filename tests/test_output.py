"""Folders that a command writes, whole or absent; its messages; where it may write."""

import os
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import click
import pytest

from commands import everything
from qclearn import cli
from qclearn.cli.output import expanded, file_to_write, output_folder

# A run that is ended in the block, by a signal that it may answer.
ENDED = """
import os, signal
from qclearn.cli import cli, main
from qclearn.cli.output import output_folder

@cli.command()
def wait():
    with output_folder("out") as folder:
        (folder / "report.json").write_text("new")
        os.kill(os.getpid(), signal.SIGTERM)

main()
"""


def write(place, *names, **options):
    with output_folder(place, **options) as folder:
        for name in names:
            (folder / name).write_text("old")


@pytest.mark.skipif(os.name != "posix", reason="no SIGTERM")
def test_a_run_that_is_ended_leaves_nothing(tmp_path):
    ended = subprocess.run([sys.executable, "-c", ENDED, "wait"], cwd=tmp_path, check=False)
    assert ended.returncode == 128 + signal.SIGTERM and not list(tmp_path.iterdir())


def test_a_folder_that_is_there_keeps_what_is_not_of_the_run(tmp_path):
    write(tmp_path / "out", "report.json", "report.html", "notes.txt")
    write(tmp_path / "out", "report.json", instead=["report.html"])
    assert everything(tmp_path / "out") == ["notes.txt", "report.json"]


def test_a_new_folder_has_the_permissions_of_any_other(tmp_path):
    (tmp_path / "usual").mkdir()
    write(tmp_path / "deep" / "out", "report.json")
    assert (tmp_path / "deep" / "out").stat().st_mode == (tmp_path / "usual").stat().st_mode


# Messages


def test_a_warning_is_one_line(monkeypatch, capsys):
    def warned(*_, **__):
        warnings.simplefilter("always")
        warnings.warn("left\nout", stacklevel=1)

    monkeypatch.setattr(cli.cli, "main", warned)
    cli.main([])
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
