"""`qclearn train`: every recipe runs and is resumed, and its weights file loads and says its origin."""

import json
import sys
from importlib import import_module

import pytest
import torch

from qclearn.cli import main
from qclearn.nets import TrainingError, load_file
from qclearn.nets.run import run_training
from qclearn.nets.train import take_step
from subjects import stand_in

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = {"quick": True, "batch": 2}  # a few items, two at a step
COARSE = {"rings": 12, "spokes": 36, "modes": 300, "finer": 16, "finest": 20}
NARROW = {  # fewer channels than what is shipped, and coarser meshes
    "ldnet": {"preset": "best", "widths": (8, 8, 8, 8)},
    "cpnet": {"preset": "best", "channels": (4, 8), "looks": 1, "stiff_looks": 1, **COARSE},
    "dbsnet": {"preset": "best", "channels": (4, 8, 8), "blocks": 1, "rings": 16, "spokes": 48},
}

RECIPES = [(name, "best", None) for name in NARROW]
RECIPES += [("ldnet", "paper", None), ("cpnet", "paper", 1e4), ("dbsnet", "paper", None)]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The tiny training sets, drawn once, of two subjects."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("data_synth.cohort"), "make_cortex", stand_in)
        yield tmp_path_factory.mktemp("data")


@pytest.mark.parametrize("network, preset, gamma", RECIPES)
def test_every_recipe_runs_and_its_weights_load(tmp_path, data, network, preset, gamma):
    size = NARROW[network] if preset == "best" else preset
    path, row = run_training(network, size, gamma, tmp_path / "run", data, steps=2, **TINY)
    model = load_file(path, network)
    header = model.header
    assert row["step"] == header["steps"] == 2 and model.config.preset == preset
    assert json.loads((tmp_path / "run" / "config.json").read_text())["training"]["steps"] == 2
    assert header["data"]["recipe"] == f"data_synth.training.{network}" and header["data"]["quick"]
    assert header["figures"]["validation_loss"] == row["validation_loss"] < float("inf")  # one is a logarithm
    if gamma:
        assert model.config.gamma == gamma and path.name == "cpnet-paper-g1e4.safetensors"


PAPERS = [{"preset": "paper", "size": 16, "frequencies": 4, "loss": loss} for loss in ("printed", "maps")]


@pytest.mark.parametrize("preset", [NARROW["dbsnet"], *PAPERS], ids=["best", "printed", "maps"])
def test_a_run_that_stopped_goes_on_to_the_same_weights(tmp_path, data, preset, monkeypatch):
    """Stopped in its second step: it goes on from the checkpoint after the first."""
    own = data / str(preset.get("size", ""))  # squares of another size are another set
    options = {"data": own, "steps": 2, "validate_every": 1, **TINY}
    whole, row = run_training("dbsnet", preset, out=tmp_path / "whole", **options)

    def stopped(*arguments):
        if arguments[4] == 1:
            raise KeyboardInterrupt
        return take_step(*arguments)

    part = tmp_path / "part"
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(sys.modules["qclearn.nets.train"], "take_step", stopped)
        run_training("dbsnet", preset, out=part, **options)
    assert (part / "checkpoint.safetensors").exists() and not list(part.glob("dbsnet*"))
    resumed, again = run_training("dbsnet", preset, out=part, **options)
    model, other = load_file(whole), load_file(resumed).state_dict()
    assert all(torch.equal(tensor, other[name]) for name, tensor in model.state_dict().items())
    assert row | {"seconds": 0} == again | {"seconds": 0}
    if preset in PAPERS:
        assert model.header["config"]["loss"] == preset["loss"]
        assert row["validation_comes"] > 0 and row["validation_mobius"] > 0


WRONG = [("cpnet", "paper", None), ("cpnet", "best", 1e4), ("dbsnet", "best", 1e4), ("cpnet", "paper", 3e4)]


@pytest.mark.parametrize("network, preset, gamma", WRONG)
def test_gamma_belongs_to_the_papers_cpnet_alone(tmp_path, network, preset, gamma):
    with pytest.raises(TrainingError, match="needs one of 10000, 100000, 200000"):
        run_training(network, preset, gamma, tmp_path)


def test_bad_input_is_one_line(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as stop:
        main(["train", "dbsnet", "--out", str(tmp_path / "file"), "--data", str(tmp_path), "--quick", "--steps", "1"])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and "give another folder" in error.splitlines()[-1]
