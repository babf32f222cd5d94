"""The script of all trainings: what it lists, what it says is left, what it writes of the logs,
what it refuses."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from threading import Barrier

import pytest

from qclearn.nets import build

TOOL = Path(__file__).parents[2] / "book" / "studies" / "training.py"


@pytest.fixture
def tool(tmp_path, monkeypatch):
    """The script as a module, its runs in a folder of the test."""
    spec = importlib.util.spec_from_file_location("training", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "FOLDER", tmp_path)
    return module


def begun(folder, steps):
    folder.mkdir()
    (folder / "config.json").write_text(json.dumps({"network": {"loss": "maps"}, "training": {"steps": 1100}}))
    lines = [f"{step},0.5,{0.7 - step / 1e5},60.0" for step in steps]
    (folder / "log.csv").write_text("\n".join(["step,loss,validation_comes,seconds", *lines]) + "\n")


def test_every_run_names_a_network_that_can_be_built(tool):
    for name, run in tool.runs().items():
        config = run.config | ({} if run.gamma is None else {"gamma": run.gamma})
        if run.network != "dbsnet" or "small" in name:  # those of the whole square take a second each
            assert build(run.network, config).config.preset == run.config["preset"]
        assert name.startswith(f"{run.network}-") and tool.steps_of(run) > 0


def test_what_is_left_and_the_logs(tool, tmp_path, capsys):
    begun(tmp_path / "dbsnet-paper-maps-1100", (275, 550))
    tool.show_left({name: run for name, run in tool.runs().items() if name.startswith("dbsnet-paper-maps")})
    first, second, _ = capsys.readouterr().out.splitlines()
    assert "550 of   1100 steps" in first and "about 1 min left" in first and "not begun" in second
    tool.write_curves(tmp_path / "training.json")
    curves = json.loads((tmp_path / "training.json").read_text())
    assert list(curves) == ["dbsnet-paper-maps-1100"] and curves["dbsnet-paper-maps-1100"]["commit"] is None
    assert curves["dbsnet-paper-maps-1100"]["log"]["validation_comes"] == [0.69725, 0.6945]


def test_a_tree_with_changes_trains_nothing(tool, monkeypatch):
    monkeypatch.setattr(tool, "commit", lambda: "1234+changes")
    monkeypatch.setattr(sys, "argv", ["training.py"])
    with pytest.raises(SystemExit, match="not committed"):
        tool.main()


def test_runs_go_side_by_side_and_one_that_fails_does_not_stop_the_others(tool, monkeypatch, capsys):
    both = Barrier(2)

    def call(command):
        if command[-1] in "ab":
            both.wait(60)  # until the other one runs, too
        return 1 if command[-1] == "b" else 0

    monkeypatch.setattr(subprocess, "call", call)
    tool.train_side_by_side(["a", "b", "c"], 2)
    said = capsys.readouterr().out
    assert "a: done" in said and "b: failed (1)" in said and "c: done" in said
