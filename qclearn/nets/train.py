"""One training loop for the three networks: seeded, resumable, in one process or in many.

Everything random in step k is drawn from generators seeded by (seed, k), and the order of the items
by (seed, epoch): a run that was killed goes on from its checkpoint to the same losses, bit for bit
on the same machine.
"""

import csv
import json
import os
import time
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from math import cos, inf, pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import distributed, nn
from torch.nn.parallel import DistributedDataParallel
from tqdm import tqdm

from ..io.checkpoint import Checkpoint
from ..io.safe import write_whole

# Of training between two checkpoints at most; one takes a tenth of a second.
CHECKPOINT_SECONDS = 10


class TrainingError(ValueError):
    """A training run that cannot start or go on: says why and what to do."""


@dataclass(frozen=True)
class TrainConfig:
    """AdamW, its rate warmed up over `warmup` steps, then lowered to 0 along a cosine.

    batch: items a step, over all processes; bfloat16: convolutions and matrix products in that
    precision; clip: largest norm of the gradient; validate_every: steps between two rows of the
    log, each with a checkpoint (and one every CHECKPOINT_SECONDS, so that little of a slow or short
    run is lost).
    """

    steps: int
    batch: int
    rate: float
    seed: int = 0
    weight_decay: float = 0.0
    warmup: int = 100
    bfloat16: bool = False
    clip: float = 1.0
    validate_every: int = 500


class Process(NamedTuple):
    """One of the processes that train together: number, how many, and the tensors' device."""

    rank: int = 0
    world: int = 1
    device: torch.device = torch.device("cpu")


class Objective(nn.Module):
    """The loss as a forward pass, which is what the data-parallel wrapper can see."""

    def __init__(self, model):
        super().__init__()
        self.model = model

    def forward(self, batch, generator):
        return self.model.loss(batch, generator)


def train(model, training, validation, config, folder, progress=True):
    """Train a network in place; the last row of its log as a dict.

    model: offers `loss(batch, generator) -> (loss, figures)`; training, validation: TensorDatasets
    whose items are what it expects. folder: gets `config.json`, `log.csv` (a row every
    `validate_every` steps) and `checkpoint.safetensors`; a run of the same configuration in it is
    resumed. Under `torchrun` the batch is shared among the processes. TrainingError for an
    impossible configuration, a folder of another run, or a loss that is not finite.
    """
    folder = Path(folder)
    with process_group() as process:
        rank, world, device = process
        check_config(config, training, world)
        if rank == 0:
            settings = {"network": asdict(model.config), "training": asdict(config)}
            Checkpoint(folder, settings, TrainingError, record="config.json", shared=True)
        model.to(device).train()
        for layer in model.modules():
            if isinstance(layer, (torch.nn.Conv2d, torch.nn.ConvTranspose2d)):
                layer.to(memory_format=torch.channels_last)  # what convolutions are fast in
        optimiser = torch.optim.AdamW(
            model.parameters(), config.rate, weight_decay=config.weight_decay
        )
        step, seconds, sums = read_checkpoint(folder, model, optimiser, device)
        log = Log(folder, step, seconds, sums)
        objective = Objective(model)
        objective = DistributedDataParallel(objective) if world > 1 else objective
        count = {"total": config.steps, "initial": step}
        bar = tqdm(desc="training", disable=not progress or rank > 0 or None, **count)
        saved = time.perf_counter()
        while step < config.steps:
            loss, figures = take_step(objective, optimiser, training, config, step, process)
            step += 1
            log.add(loss, figures)
            bar.update()
            if step % config.validate_every == 0 or step == config.steps:
                row = log.row(step, validate(model, validation, config, device), write=rank == 0)
                bar.set_postfix(
                    loss=f"{row['loss']:.4g}", validation=f"{row['validation_loss']:.4g}"
                )
                saved = -inf
            if rank == 0 and time.perf_counter() - saved > CHECKPOINT_SECONDS:
                write_checkpoint(folder, model, optimiser, step, log)
                saved = time.perf_counter()
        bar.close()
    model.eval()
    return {name: float(value) for name, value in log.rows[-1].items()}


def take_step(objective, optimiser, training, config, step, process):
    """One step: (loss, figures) of a `Process`'s share of the batch."""
    rank, world, device = process
    items = batch_items(len(training), step, config)[rank::world]
    batch = tuple(tensor[items].to(device) for tensor in training.tensors)
    seed = np.random.SeedSequence((config.seed, step, rank)).generate_state(1, np.uint64)[0]
    generator = torch.Generator().manual_seed(int(seed >> 1))
    for group in optimiser.param_groups:
        group["lr"] = config.rate * rate_at(step, config)
    optimiser.zero_grad()
    with torch.autocast(device.type, torch.bfloat16, enabled=config.bfloat16):
        loss, figures = objective(batch, generator)
    if not torch.isfinite(loss):
        raise TrainingError(
            f"the loss is {loss.item()} at step {step}; lower the rate (now {config.rate:g}) and "
            "start in another folder"
        )
    loss.backward()
    nn.utils.clip_grad_norm_(objective.parameters(), config.clip)
    optimiser.step()
    return loss.item(), figures


def batch_items(count, step, config):
    """The items (batch,) of a step: every epoch is a permutation of its own, joined end to end."""
    places = np.arange(step * config.batch, (step + 1) * config.batch)
    orders = {}
    for epoch in set(places // count):
        orders[epoch] = np.random.default_rng([config.seed, epoch]).permutation(count)
    return torch.tensor([orders[k // count][k % count] for k in places])


def rate_at(step, config):
    """Share of the rate: linear to 1 over the warm-up, then half a cosine down to 0."""
    if step < config.warmup:
        return (step + 1) / config.warmup
    return 0.5 * (1 + cos(pi * (step - config.warmup) / max(1, config.steps - config.warmup)))


@torch.no_grad()
def validate(model, validation, config, device):
    """Mean loss and figures over the validation set, without augmentation, as `validation_...`."""
    model.eval()
    rows, counts = [], []
    for first in range(0, len(validation), config.batch):
        items = slice(first, first + config.batch)
        batch = tuple(tensor[items].to(device) for tensor in validation.tensors)
        with torch.autocast(device.type, torch.bfloat16, enabled=config.bfloat16):
            loss, figures = model.loss(batch, None)
        rows.append({"loss": loss.item(), **figures})
        counts.append(len(batch[0]))
    model.train()
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    means = {name: np.average(column, weights=counts) for name, column in columns.items()}
    return {f"validation_{name}": float(mean) for name, mean in means.items()}


class Log:
    """`log.csv`: means over the steps since the last row, validation figures, seconds."""

    def __init__(self, folder, step, seconds, sums):
        self.path = folder / "log.csv"
        self.start = time.perf_counter() - seconds
        self.sums = sums
        path = self.path if self.path.exists() else os.devnull
        with open(path, newline="", encoding="utf-8-sig") as file:
            self.rows = [row for row in csv.DictReader(file) if int(row["step"]) <= step]

    def add(self, loss, figures):
        self.sums.append({"loss": loss, **figures})

    def row(self, step, validation, write):
        means = {name: float(np.mean([row[name] for row in self.sums])) for name in self.sums[0]}
        row = {"step": step, **means, **validation, "seconds": self.seconds()}
        self.rows.append(row)
        self.sums = []
        if write:
            write_whole(self.path, self._write)
        return row

    def seconds(self):
        return round(time.perf_counter() - self.start, 1)

    def _write(self, place):
        with place.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(self.rows[-1]))
            writer.writeheader()
            writer.writerows(self.rows)


@contextmanager
def process_group():
    """A `Process`: what torchrun has set, or one alone."""
    present = torch.accelerator.is_available()
    accelerator = torch.accelerator.current_accelerator() if present else None
    if "RANK" not in os.environ:
        yield Process(device=accelerator or torch.device("cpu"))
        return
    distributed.init_process_group()
    try:
        local = int(os.environ["LOCAL_RANK"])
        device = torch.device(accelerator.type, local) if accelerator else torch.device("cpu")
        yield Process(distributed.get_rank(), distributed.get_world_size(), device)
    finally:
        distributed.destroy_process_group()


def check_config(config, training, world):
    """TrainingError for a configuration that cannot run."""
    for name in ("steps", "batch", "validate_every"):
        if getattr(config, name) < 1:
            raise TrainingError(f"{name} is {getattr(config, name)}; give at least 1")
    if not config.rate > 0:
        raise TrainingError(f"the rate is {config.rate}; give a positive number")
    if config.batch % world:
        raise TrainingError(
            f"a batch of {config.batch} cannot be shared by {world} processes; make it a multiple"
        )
    if len(training) == 0:
        raise TrainingError("the training set is empty")


def write_checkpoint(folder, model, optimiser, step, log):
    """Write parameters, optimiser, step and the log's sums as one file, whole or not at all."""
    tensors = {f"model.{name}": tensor for name, tensor in model.state_dict().items()}
    for number, state in optimiser.state_dict()["state"].items():
        tensors |= {f"optimiser.{number}.{key}": value for key, value in state.items()}
    tensors = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in tensors.items()}
    header = {"step": str(step), "seconds": str(log.seconds()), "sums": json.dumps(log.sums)}
    write_whole(folder / "checkpoint.safetensors", lambda place: save_file(tensors, place, header))


def read_checkpoint(folder, model, optimiser, device):
    """Load the checkpoint: (step, seconds, the log's sums), (0, 0, []) where there is none."""
    path = folder / "checkpoint.safetensors"
    if not path.exists():
        return 0, 0.0, []
    try:
        with safe_open(path, framework="pt") as file:
            header, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except SafetensorError as error:
        raise TrainingError(f"{path} is damaged ({error}); remove it to start again") from None
    parameters, state = {}, {}
    for name, value in tensors.items():
        part, name = name.split(".", 1)
        if part == "model":
            parameters[name] = value
        else:
            number, key = name.split(".")
            state.setdefault(int(number), {})[key] = value if key == "step" else value.to(device)
    model.load_state_dict(parameters)
    optimiser.load_state_dict({**optimiser.state_dict(), "state": state})
    return int(header["step"]), float(header["seconds"]), json.loads(header.get("sums", "[]"))
