"""`qclearn train`: every recipe runs, is resumed and shared by two processes,
and its weights file loads and says its origin."""

import json
import os
import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from qclearn.cli import main
from qclearn.nets import TrainingError, dbsnet, load_file
from qclearn.nets.dbsnet_paper import LOSSES
from qclearn.nets.run import run_training
from qclearn.nets.train import take_step
from qclearn.nets.weights import WeightsError

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = {"quick": True, "batch": 2}  # a few items, two at a step
NARROW = {  # fewer channels than what is shipped
    "ldnet": {"preset": "best", "widths": (8, 8, 8, 8)},
    "cpnet": {"preset": "best", "channels": (4, 8, 8), "finest": 32, "looks": 1, "stiff_looks": 1},
    "dbsnet": {"preset": "best", "channels": (4, 8, 8, 8), "blocks": 1},
}

RECIPES = [
    ("ldnet", "best", None),
    ("ldnet", "paper", None),
    ("cpnet", "best", None),
    ("cpnet", "paper", 1e4),
    ("dbsnet", "best", None),
    ("dbsnet", "paper", None),
]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The tiny training sets, drawn once."""
    return tmp_path_factory.mktemp("data")


@pytest.mark.parametrize("network, preset, gamma", RECIPES)
def test_every_recipe_runs_and_its_weights_load(tmp_path, data, network, preset, gamma):
    size = NARROW[network] if preset == "best" else preset
    path, row = run_training(network, size, gamma, tmp_path / "run", data, steps=2, **TINY)
    model = load_file(path, network)
    header = model.header
    assert row["step"] == header["steps"] == 2 and model.config.preset == preset
    assert header["data"]["recipe"] == f"data_synth.training.{network}" and header["data"]["quick"]
    assert header["figures"]["validation_loss"] == row["validation_loss"] < float("inf")  # one is a logarithm
    if gamma:
        assert model.config.gamma == gamma and path.name == "cpnet-paper-g1e4.safetensors"


def test_a_run_that_stopped_goes_on_to_the_same_weights(tmp_path, data, monkeypatch):
    monkeypatch.setitem(dbsnet.TRAINING, "best", replace(dbsnet.TRAINING["best"], validate_every=1))
    options = {"data": data, "steps": 2, **TINY}
    whole, _ = run_training("dbsnet", NARROW["dbsnet"], out=tmp_path / "whole", **options)
    part = tmp_path / "part"
    command = [sys.executable, "-c", KILLED % NARROW["dbsnet"], str(part), str(data)]
    assert subprocess.run(command, check=False, capture_output=True, timeout=600).returncode == 9
    assert (part / "checkpoint.safetensors").exists() and not list(part.glob("dbsnet*"))
    resumed, _ = run_training("dbsnet", NARROW["dbsnet"], out=part, **options)
    a, b = load_file(whole).state_dict(), load_file(resumed).state_dict()
    assert all(torch.equal(a[name], b[name]) for name in a)


KILLED = """
import os, sys
from dataclasses import replace
from pathlib import Path
import torch
from qclearn.nets import dbsnet
from qclearn.nets.run import run_training

torch.set_num_threads(1)
dbsnet.TRAINING["best"] = replace(dbsnet.TRAINING["best"], validate_every=1)
loop = sys.modules["qclearn.nets.train"]
step = loop.take_step
loop.take_step = lambda *arguments: os._exit(9) if arguments[4] == 1 else step(*arguments)
run_training("dbsnet", %s, out=Path(sys.argv[1]), data=sys.argv[2], steps=2, quick=True, batch=2)
"""


@pytest.mark.parametrize("loss", LOSSES)
def test_each_loss_of_the_papers_dbsnet_goes_on_to_the_same_weights(tmp_path, loss, monkeypatch):
    """Stopped before the fourth step: it goes on from the checkpoint after the second."""
    preset = {"preset": "paper", "size": 16, "frequencies": 4, "loss": loss}
    options = {"data": tmp_path, "quick": True, "steps": 4, "validate_every": 2}
    whole, row = run_training("dbsnet", preset, out=tmp_path / "whole", **options)
    loop = sys.modules["qclearn.nets.train"]

    def stopped(*arguments):
        if arguments[4] == 3:
            raise KeyboardInterrupt
        return take_step(*arguments)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(loop, "take_step", stopped)
        run_training("dbsnet", preset, out=tmp_path / "part", **options)
    resumed, again = run_training("dbsnet", preset, out=tmp_path / "part", **options)
    models = [load_file(path) for path in (whole, resumed)]
    a, b = (model.state_dict() for model in models)
    assert all(torch.equal(a[name], b[name]) for name in a) and models[0].header["config"]["loss"] == loss
    assert {name: row[name] for name in row if name != "seconds"} == {
        name: again[name] for name in again if name != "seconds"
    }
    assert row["validation_comes"] > 0 and row["validation_mobius"] > 0


@pytest.mark.slow
def test_two_processes_train_together(tmp_path, data):
    run_training("dbsnet", out=tmp_path / "draw", data=data, steps=1, quick=True)  # the set is there for both
    command = [
        sys.executable,
        "-m",
        "torch.distributed.run",
        "--standalone",
        "--nproc-per-node",
        "2",
        "-m",
        "qclearn",
        "train",
        "dbsnet",
        "--out",
        tmp_path / "run",
        "--data",
        data,
        "--steps",
        "2",
        "--quick",
        "--threads",
        "1",
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=180, env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("validation loss") == 1  # the first process alone writes and speaks
    assert load_file(tmp_path / "run" / "dbsnet-best.safetensors", "dbsnet").header["steps"] == 2


@pytest.mark.parametrize(
    "network, preset, gamma",
    [("cpnet", "paper", None), ("cpnet", "best", 1e4), ("dbsnet", "best", 1e4), ("cpnet", "paper", 3e4)],
)
def test_gamma_belongs_to_the_papers_cpnet_alone(tmp_path, network, preset, gamma):
    with pytest.raises(TrainingError, match="needs one of 10000, 100000, 200000"):
        run_training(network, preset, gamma, tmp_path)


def test_bad_input_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as stop:
        main(["train", "dbsnet", "--out", str(tmp_path / "file"), "--data", str(tmp_path), "--quick", "--steps", "1"])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and "give another folder" in error.splitlines()[-1]


def test_the_weights_of_another_network_are_refused(tmp_path, data):
    path, _ = run_training("dbsnet", NARROW["dbsnet"], out=tmp_path, data=data, steps=1, **TINY)
    with pytest.raises(WeightsError, match="weights of dbsnet, not of ldnet"):
        load_file(path, "ldnet")
    assert json.loads((tmp_path / "config.json").read_text())["training"]["steps"] == 1
