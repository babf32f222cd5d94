"""`qclearn train`: a recipe's training set, the loop, and a weights file with its origin."""

import hashlib
import os
import platform
from dataclasses import asdict, replace
from datetime import date
from importlib.metadata import version
from pathlib import Path

import torch
from platformdirs import user_cache_path

from ..io.checkpoint import require_home
from ..io.provenance import commit
from . import TrainingError, build, save_weights, train
from .networks import gamma_fault
from .networks import network as row_of
from .weights import stem


def run_training(
    network, preset="best", gamma=None, out=Path("run"), data=None, quick=False, **changes
):
    """Train `network` by its recipe: (path of its weights, last row of the log), or (None, row).

    The recipe is the network's row in `nets.networks`: `TRAINING[preset]` of its module and the
    function of its data; changes replace fields of its `TrainConfig`, as in steps=100. preset: its
    name, or as `build` a dict with fields of the network's configuration beside it. TrainingError
    as `train`.
    """
    given = {"preset": preset} if isinstance(preset, str) else dict(preset)
    row, preset = row_of(network), given["preset"]
    if fault := gamma_fault(network, preset, gamma):
        raise TrainingError(fault)
    recipe = replace(row.training[preset], **changes)
    torch.manual_seed(recipe.seed)  # of the parameters' first values
    model = build(network, given | ({} if gamma is None else {"gamma": gamma}))
    folder = Path(data) if data else require_home(user_cache_path("qclearn") / "training")
    training, validation = row.draw(model.config, folder, quick)
    last = train(model, training, validation, recipe, out)
    if os.environ.get("RANK", "0") != "0":
        return None, last
    path = out / f"{stem(network, preset, gamma)}.safetensors"
    save_weights(path, model, header(network, recipe, training, quick, last))
    return path, last


def header(network, recipe, training, quick, last):
    """The header of a weights file: its origin."""
    row = row_of(network)
    what = row.draw.__doc__.splitlines()[0]
    data = {"recipe": row.data.replace(":", "."), "what": what, "quick": quick}
    total = hashlib.sha256()  # of shapes, types and numbers: whether two training sets are equal
    for tensor in training.tensors:
        total.update(f"{tuple(tensor.shape)} {tensor.dtype}".encode())
        tensor = torch.view_as_real(tensor) if tensor.is_complex() else tensor
        total.update(tensor.contiguous().numpy().tobytes())
    data |= {"items": len(training), "digest": total.hexdigest()}
    return {
        "network": network,
        "training": asdict(recipe),
        "seed": recipe.seed,
        "steps": int(last["step"]),
        "data": data,
        "commit": commit(),
        "version": version("qclearn"),
        "torch": torch.__version__,
        "date": date.today().isoformat(),
        "machine": f"{platform.machine()}, {torch.get_num_threads()} threads",
        "seconds": last["seconds"],
        "figures": {name: value for name, value in last.items() if name.startswith("validation_")},
    }
