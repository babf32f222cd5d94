"""The script of all trainings: what it lists, what it says is left, what it writes of the logs, what it refuses."""

import json
import subprocess
import sys

import pytest

from book.studies import training as tool
from qclearn.nets import build


def test_every_run_names_a_network_that_can_be_built():
    for name, run in tool.runs().items():
        config = run.config | ({} if run.gamma is None else {"gamma": run.gamma})
        if run.network != "dbsnet" or "small" in name:  # those of the whole square take a second each
            assert build(run.network, config).config.preset == run.config["preset"]
        assert name.startswith(f"{run.network}-") and tool.steps_of(run) > 0


def test_what_is_left_and_the_logs(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tool, "FOLDER", tmp_path)
    folder = tmp_path / "dbsnet-paper-maps-1100"
    folder.mkdir()
    (folder / "config.json").write_text('{"network": {"loss": "maps"}, "training": {"steps": 1100}}')
    (folder / "log.csv").write_text("step,loss,validation_comes,seconds\n275,0.5,0.69,60.0\n550,0.5,0.68,60.0\n")
    tool.show_left({name: run for name, run in tool.runs().items() if name.startswith("dbsnet-paper-maps")})
    first, second, _ = capsys.readouterr().out.splitlines()
    assert "550 of   1100 steps" in first and "about 1 min left" in first and "not begun" in second
    tool.write_curves(tmp_path / "training.json")
    (curves,) = json.loads((tmp_path / "training.json").read_text()).items()
    assert curves[0] == folder.name and curves[1]["commit"] is None
    assert curves[1]["log"]["validation_comes"] == [0.69, 0.68]


def test_a_tree_with_changes_trains_nothing(monkeypatch):
    monkeypatch.setattr(tool, "commit", lambda: "1234+changes")
    monkeypatch.setattr(sys, "argv", ["training.py"])
    with pytest.raises(SystemExit, match="not committed"):
        tool.main()


def test_a_run_that_fails_does_not_stop_the_others(monkeypatch, capsys):
    monkeypatch.setattr(subprocess, "call", lambda command: int(command[-1] == "b"))
    tool.train_side_by_side(["a", "b", "c"], 2)
    said = capsys.readouterr().out
    assert "a: done" in said and "b: failed (1)" in said and "c: done" in said
