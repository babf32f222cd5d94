"""Weights files: what is written comes back, whatever is not whole, ours or of this version is refused by name."""

import json
import math
import sys
from dataclasses import asdict, dataclass

import pytest
import torch
from safetensors.torch import save_file
from torch import nn

from qclearn.nets import weights
from qclearn.nets.networks import NETWORKS, Network
from qclearn.nets.weights import FOLDER, FORMAT, WeightsError, load, load_file, read_weights, save_weights, stem
from qclearn.surfaces.surface import Surface

HEADER = {"network": "toy", "training": {}, "data": {}, "steps": 3, "commit": "", "figures": {}}


@dataclass(frozen=True)
class ToyConfig:
    preset: str = "best"
    sizes: tuple = (2, 3)


class Toy(nn.Module):
    def __init__(self, config):
        super().__init__()
        self.config = config
        self.layer = nn.Linear(*config.sizes)


@pytest.fixture(autouse=True)
def toy(monkeypatch):
    """The network "toy" beside the real ones."""
    monkeypatch.setitem(sys.modules, "toy", type("module", (), {"PRESETS": {"best": (Toy, ToyConfig())}}))
    monkeypatch.setitem(NETWORKS, "toy", Network("toy", "solve", "toy:data"))


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "toy-best.safetensors"
    save_weights(path, Toy(ToyConfig(sizes=(4, 5))), HEADER)
    return path


def test_what_is_written_comes_back_and_an_incomplete_header_is_not_written(file):
    back, (header, state) = load_file(file, "toy"), read_weights(file)
    assert back.config == ToyConfig(sizes=(4, 5)) and not back.training
    assert torch.equal(back.layer.weight, state["layer.weight"]) and not back.layer.weight.requires_grad
    assert back.header == header and header["steps"] == 3 and header["format"] == FORMAT
    with pytest.raises(WeightsError, match="lacks steps"):
        save_weights(file.parent / "a", Toy(ToyConfig()), {k: v for k, v in HEADER.items() if k != "steps"})
    assert [path.name for path in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize("change, words", [
    ({"format": FORMAT + 1}, f"format {FORMAT + 1}, this version reads {FORMAT}"),
    ({"network": "other"}, "no network is called 'other'"), ({"network": "dbsnet"}, "weights of dbsnet, not of toy"),
    ({"config": {"preset": "worst"}}, "no preset 'worst'"),
    ({"config": {"preset": "best", "sizes": [4, 6]}}, "does not fit toy"),
    *((size, "not a whole safetensors file") for size in (0, 7, 100, -10)),
    (None, "no qclearn header"), ("none", "cannot be read"), (".", "cannot be read"),
])  # fmt: skip
def test_what_is_no_sound_file_of_this_network_is_refused(file, change, words):
    header, state = read_weights(file)
    if isinstance(change, int):
        file.write_bytes(file.read_bytes()[:change])
    elif isinstance(change, str):
        file = file.parent / change
    else:
        save_file(state, file, change and {"qclearn": json.dumps(header | change)})
    with pytest.raises(WeightsError, match=words):
        load_file(file, "toy" if "not of toy" in words else None)


@pytest.mark.parametrize("arguments, words", [
    (("unet",), "no weights are shipped for 'unet'"), (("dbsnet", "worst"), "preset 'worst'"),
    (("cpnet", "paper"), "one weights file for each gamma"), (("cpnet", "paper", 3e4), "got 30000"),
])  # fmt: skip
def test_what_is_not_shipped_is_refused(arguments, words):
    with pytest.raises(WeightsError, match=words):
        load(*arguments)


@pytest.mark.parametrize("name, preset", [(name, preset) for name, row in NETWORKS.items() for preset in row.presets])
def test_every_call_runs_on_one_thread_and_puts_the_number_back(name, preset):
    """A probe in the place of a network and of its input notes the threads when it is first looked at."""
    threads, before = [], torch.get_num_threads()

    def look(*_, **__):
        threads.append(torch.get_num_threads())
        raise LookupError

    probe = object.__new__(type("Probe", (Surface,), dict.fromkeys(["__getattr__", "__array__", "__len__"], look)))
    call = "heat" if (name, preset) == ("ldnet", "best") else NETWORKS[name].call  # the part of its `detect` in torch
    torch.set_num_threads(3)
    try:
        with pytest.raises(LookupError):
            getattr(NETWORKS[name].presets[preset][0], call)(*[probe] * (5 if call == "predict" else 4))
        assert threads[0] == 1 and torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


SHIPPED = sorted(FOLDER.glob("*.safetensors"))


def test_the_shipped_weights_are_small():
    sizes = [path.stat().st_size for path in SHIPPED]
    assert max(sizes, default=0) <= 6e6 and sum(sizes) <= 30e6


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_weights_load_and_say_where_they_come_from(path):
    model = load_file(path)
    header = model.header
    assert path.stem == stem(header["network"], header["config"]["preset"], header["config"].get("gamma"))
    config = json.loads(json.dumps(asdict(model.config)))  # may have gained settings of the use, not of the training
    config |= weights.GONE
    assert {name: config[name] for name in header["config"]} == header["config"]
    assert not header["commit"].endswith("+changes"), "train it by book/studies/training.py, on a committed tree"
    assert header["steps"] == header["training"]["steps"] > 0 and header["commit"] and header["data"]["items"] > 0
    assert not header["data"]["quick"] and math.isfinite(header["figures"]["validation_loss"])
