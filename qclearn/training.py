"""What `qclearn train` does: a recipe's training set, the loop, and a weights file that says where it comes from."""

import os
import platform
from dataclasses import asdict, replace
from datetime import date
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import torch
from platformdirs import user_cache_path

from data_synth import training as data_recipes

from .nets import TrainingError, build, save_weights, train
from .nets.weights import PAPER_GAMMAS, digest, stem
from .provenance import commit


def run_training(network, preset="best", gamma=None, out=Path("run"), data=None, steps=None, seed=None, quick=False,
                 threads=None):
    """Train `network` by its recipe: (path of its weights file, last row of the log); (None, row) off the first process.

    The recipe is `TRAINING[preset]` of its module and the function of its name in `data_synth.training`; steps and seed
    replace the recipe's. TrainingError as `train`.
    """
    if (gamma is not None) != (network == "cpnet" and preset == "paper") or gamma not in (None, *PAPER_GAMMAS):
        raise TrainingError(f"gamma is {gamma}: the paper's CP-Net needs one of "
                            f"{', '.join(f'{g:g}' for g in PAPER_GAMMAS)}, the other networks take none")
    if threads:
        torch.set_num_threads(threads)
    recipe = import_module(f"qclearn.nets.{network}").TRAINING[preset]
    given = {"steps": steps, "seed": seed}
    recipe = replace(recipe, **{name: value for name, value in given.items() if value is not None})
    torch.manual_seed(recipe.seed)  # of the parameters' first values
    model = build(network, {"preset": preset} | ({} if gamma is None else {"gamma": gamma}))
    folder = Path(data) if data else user_cache_path("qclearn") / "training"
    training, validation = getattr(data_recipes, network)(model.config, folder, quick)
    row = train(model, training, validation, recipe, out)
    if os.environ.get("RANK", "0") != "0":
        return None, row
    path = out / f"{stem(network, preset, gamma)}.safetensors"
    save_weights(path, model, header(network, recipe, training, quick, row))
    return path, row


def header(network, recipe, training, quick, row):
    """What a weights file says of its origin."""
    function = getattr(data_recipes, network)
    return {
        "network": network, "training": asdict(recipe), "seed": recipe.seed, "steps": int(row["step"]),
        "data": {"recipe": f"data_synth.training.{network}", "what": function.__doc__.splitlines()[0], "quick": quick,
                 "items": len(training), "digest": digest(training.tensors)},
        "commit": commit(), "version": version("qclearn"), "torch": torch.__version__, "date": date.today().isoformat(),
        "machine": f"{platform.machine()}, {torch.get_num_threads()} threads", "seconds": row["seconds"],
        "figures": {name: value for name, value in row.items() if name.startswith("validation_")},
    }
