"""The training loop: it learns, goes on after a kill to the same losses, shares a batch, refuses what cannot run."""

import csv
import json
import os
import socket
import subprocess
import sys
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial

import pytest
import torch
from safetensors import safe_open
from torch import nn
from torch.utils.data import TensorDataset

from qclearn.nets.train import TrainConfig, TrainingError, batch_items, rate_at, train

pytestmark = pytest.mark.usefixtures("one_thread")

CONFIG = TrainConfig(steps=60, batch=8, rate=0.2, warmup=5, validate_every=20)
SHORT = replace(CONFIG, steps=20)


@dataclass(frozen=True)
class LineConfig:
    preset: str = "best"


class Line(nn.Module):
    """y = a x + b, with noise of the generator in training."""

    def __init__(self, noise=0.0):
        super().__init__()
        self.config, self.noise = LineConfig(), noise
        self.layer = nn.Linear(1, 1)
        nn.init.zeros_(self.layer.weight)
        nn.init.zeros_(self.layer.bias)

    def loss(self, batch, generator):
        x, y = batch
        if generator is not None:
            y = y + self.noise * torch.randn(y.shape, generator=generator)
        return ((self.layer(x) - y) ** 2).mean(), {"slope": self.layer.weight.item()}


def line_data(count):
    x = torch.linspace(-1, 1, count)[:, None]
    return TensorDataset(x, 3 * x - 1)


def run(folder, model=None, config=CONFIG, count=30):
    model = model or Line()
    return model, train(model, line_data(count), line_data(7), config, folder, progress=False)


def test_it_learns_and_logs(tmp_path):
    model, last = run(tmp_path)
    assert [model.layer.weight.item(), model.layer.bias.item()] == pytest.approx([3, -1], abs=0.3)
    assert not model.training
    with (tmp_path / "log.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == [20, 40, 60]
    assert set(rows[0]) == {"step", "loss", "slope", "validation_loss", "validation_slope", "seconds"}
    assert float(rows[-1]["validation_loss"]) == last["validation_loss"] < 0.01  # from 4 at the start
    assert json.loads((tmp_path / "config.json").read_text())["training"]["rate"] == 0.2


class Fragile(Line):
    """Dies in its 50th training step, as if killed."""

    calls = 0

    def loss(self, batch, generator):
        self.calls += generator is not None
        if self.calls == 50:
            raise KeyboardInterrupt
        return super().loss(batch, generator)


@pytest.mark.parametrize("seconds, kept", [(1e9, "40"), (0, "49")], ids=["by the log", "by time"])
def test_a_killed_run_goes_on_to_the_same_numbers(tmp_path, monkeypatch, seconds, kept):
    """From the last row of its log, or from a checkpoint since, where the last was so many seconds ago."""
    monkeypatch.setattr(sys.modules["qclearn.nets.train"], "CHECKPOINT_SECONDS", seconds)
    whole, expected = run(tmp_path / "whole", Line(noise=0.5))
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "killed", Fragile(noise=0.5))
    with safe_open(tmp_path / "killed" / "checkpoint.safetensors", framework="pt") as file:
        assert file.metadata()["step"] == kept
    resumed, found = run(tmp_path / "killed", Line(noise=0.5))
    assert torch.equal(resumed.layer.weight, whole.layer.weight) and torch.equal(resumed.layer.bias, whole.layer.bias)
    assert found | {"seconds": 0} == expected | {"seconds": 0}
    assert run(tmp_path / "killed", Line(noise=0.5))[1] == found  # finished: not trained again
    with (tmp_path / "killed" / "log.csv").open(newline="") as file:
        assert [int(row["step"]) for row in csv.DictReader(file)] == [20, 40, 60]


def test_every_epoch_takes_every_item_once():
    config = replace(CONFIG, batch=7)
    taken, again = (torch.cat([batch_items(14, step, config) for step in range(6)]).reshape(3, 14) for _ in range(2))
    assert all(sorted(epoch) == list(range(14)) for epoch in taken.tolist()) and torch.equal(taken, again)
    assert not torch.equal(taken[0], taken[1])
    assert len(batch_items(3, 5, config)) == 7  # a batch larger than the set goes round


def test_the_rate_warms_up_and_falls_to_zero():
    assert rate_at(0, CONFIG) == pytest.approx(1 / 5) and rate_at(5, CONFIG) == 1
    assert rate_at(32, CONFIG) == pytest.approx(0.5, abs=0.02) and rate_at(59, CONFIG) < 0.01


BAD = [({"steps": 0}, "steps is 0"), ({"batch": 0}, "batch is 0"), ({"rate": 0.0}, "rate is 0.0"), ({}, "empty")]


@pytest.mark.parametrize("change, words", [*BAD, ({"rate": 1e30, "clip": 1e30}, "loss is .* at step")])
def test_what_cannot_run_is_refused(tmp_path, change, words):
    with pytest.raises(TrainingError, match=words):
        run(tmp_path, config=replace(CONFIG, **change), count=30 if change else 0)


def test_the_folder_of_another_run_is_refused_and_kept_and_a_damaged_one_too(tmp_path):
    run(tmp_path)
    files = {path: path.read_bytes() for path in (tmp_path / "checkpoint.safetensors", tmp_path / "config.json")}
    with pytest.raises(TrainingError, match="other settings .training.rate differ."):
        run(tmp_path, config=replace(CONFIG, rate=0.01))
    for path, before in files.items():
        assert path.read_bytes() == before
        path.write_bytes(before[:20])
        with pytest.raises(TrainingError, match="is damaged|cannot be used"):
            run(tmp_path)
        path.write_bytes(before)


SECOND = """
import sys
sys.path.insert(0, sys.argv[1])
import torch
from test_train import SHORT, run
torch.set_num_threads(1)
layer = run(sys.argv[2], config=SHORT)[0].layer
print(layer.weight.item(), layer.bias.item())
"""


def test_two_processes_share_the_batch_and_agree_with_one(tmp_path, monkeypatch):
    """The first of the two is this one."""
    alone = run(tmp_path / "one", config=SHORT)[0].layer
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    place = {"WORLD_SIZE": "2", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port}
    command = [sys.executable, "-c", SECOND, os.path.dirname(__file__), tmp_path / "two"]
    environment = os.environ | place | {"RANK": "1", "LOCAL_RANK": "1"}
    meet = partial(torch.distributed.init_process_group, timeout=timedelta(seconds=300))
    monkeypatch.setattr(torch.distributed, "init_process_group", meet)
    for name, value in (place | {"RANK": "0", "LOCAL_RANK": "0"}).items():
        monkeypatch.setenv(name, value)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as other:
        first = run(tmp_path / "two", config=SHORT)[0].layer
        second = [float(word) for word in other.communicate(timeout=300)[0].split()]
    assert second == [first.weight.item(), first.bias.item()]
    assert second == pytest.approx([alone.weight.item(), alone.bias.item()], abs=1e-5)
