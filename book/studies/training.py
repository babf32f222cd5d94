"""Train the networks of the book from a committed tree, one after the other or side by side; goes
on where it stopped.

    python -m book.studies.training --left                   # what is left, in steps and minutes
    python -m book.studies.training --only dbsnet --jobs 2   # those whose name begins so, two at a time
    python -m book.studies.training --curves qclearn/benchmark/results/training.json

A run is a folder in the user's cache, with checkpoint, log and in the end the weights; which of
them are shipped is decided by hand. One thread a run. --curves adds the logs to those that the book
draws, of unfinished runs as far as they are.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

from platformdirs import user_cache_path

from qclearn.io.provenance import commit

FOLDER = user_cache_path("qclearn") / "training" / "runs"
LOSSES = ("energy", "maps", "rows")  # of the paper's DBS-Net
STEPS = (1_100, 4_400, 17_600)  # the same, each with a whole cosine
SMALL, SMALL_STEPS = ({"size": 16, "frequencies": 4}, (1_100, 4_400))  # minutes each: the curves' shape, soon
CONTROL_STEPS = 900  # of the paper's CP-Net through each solver; as it is shipped it has its recipe's
WINNER = "exact"  # the solver that it is shipped from
# At gamma 1e4: in as many steps as the others it finds what its loss does not see (chapter on
# CP-Net).
SOONER = 4_500


class Run(NamedTuple):
    """One training: the network, fields of its configuration, the weight gamma where it has one,
    steps if not usual."""

    network: str
    config: dict
    gamma: float | None = None
    steps: int | None = None


def runs():
    """Every training, name -> Run. The paper's CP-Net goes through DBS-Nets as they are shipped:
    train those first."""
    solvers = {f"dbsnet-paper-{loss}-{steps}": dbsnet(loss, steps) for steps in STEPS for loss in LOSSES}
    small = {f"dbsnet-small-{loss}-{steps}": dbsnet(loss, steps, **SMALL) for steps in SMALL_STEPS for loss in LOSSES}
    best = {f"{name}-best": Run(name, {"preset": "best"}) for name in ("dbsnet", "ldnet", "cpnet")}
    controls = {f"cpnet-paper-g1e5-{name}": cpnet(name, "1e5", CONTROL_STEPS) for name in ("exact", "paper", "best")}
    shipped = {f"cpnet-paper-g{gamma}": cpnet(WINNER, gamma) for gamma in ("1e5", "2e5")}
    shipped |= {"cpnet-paper-g1e4": cpnet(WINNER, "1e4", SOONER), "cpnet-paper-g1e4-long": cpnet(WINNER, "1e4")}
    return {**small, **solvers, **best, "ldnet-paper": Run("ldnet", {"preset": "paper"}), **controls, **shipped}


def dbsnet(loss, steps, **sizes):
    return Run("dbsnet", {"preset": "paper", "loss": loss} | sizes, None, steps)


def cpnet(through, gamma, steps=None):
    return Run("cpnet", {"preset": "paper", "through": through}, float(gamma), steps)


def main():
    options = read_options()
    chosen = {name: run for name, run in runs().items() if name.startswith(tuple(options.only))}
    if options.curves:
        write_curves(options.curves)
    elif options.left:
        show_left(chosen)
    elif options.one:
        train_one(options.one)
    elif commit().endswith("+changes"):
        sys.exit(
            "the tree has changes that are not committed: weights must say what made them; commit, or use a worktree"
        )
    else:
        train_side_by_side([name for name in chosen if not weights_of(name)], options.jobs)
        show_left(chosen)


def read_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[""], help="beginnings of names (default: all)")
    parser.add_argument("--jobs", type=int, default=1, help="runs at a time (default: %(default)s)")
    parser.add_argument("--left", action="store_true", help="train nothing, print what is left")
    parser.add_argument("--curves", type=Path, help="train nothing, write the logs to this JSON file")
    parser.add_argument("--one", choices=runs(), help=argparse.SUPPRESS)
    return parser.parse_args()


def train_side_by_side(names, jobs):
    """Train in processes of their own, `jobs` at a time; one that fails is told, and the others go
    on."""

    def run_one(name):
        print(f"{name} ...", flush=True)
        status = subprocess.call([sys.executable, __file__, "--one", name])
        print(f"{name}: {f'failed ({status})' if status else 'done'}", flush=True)

    with ThreadPoolExecutor(jobs) as pool:
        list(pool.map(run_one, names))


def train_one(name):
    import torch

    from qclearn.nets.run import run_training

    torch.set_num_threads(1)
    run = runs()[name]
    changes = {} if run.steps is None else {"steps": run.steps}
    data = FOLDER.parent / "small" if "size" in run.config else None  # its sets have the names of the large ones
    run_training(run.network, run.config, run.gamma, FOLDER / name, data, **changes)


def weights_of(name):
    """Path of a run's weights file, None where it has not ended."""
    return next((FOLDER / name).glob(f"{runs()[name].network}-*.safetensors"), None)


def show_left(chosen):
    """A line a run: steps done and to do, minutes so far, and about how many are left."""
    for name, run in chosen.items():
        rows, total = log_of(FOLDER / name), steps_of(run)
        done, minutes = (int(rows[-1]["step"]), float(rows[-1]["seconds"]) / 60) if rows else (0, 0.0)
        left = f"about {minutes * (total - done) / done:.0f} min left" if done else "not begun"
        print(f"{name:32} {done:6} of {total:6} steps {minutes:6.0f} min  {'done' if weights_of(name) else left}")


def steps_of(run):
    """How many steps a run has: its own, or its recipe's."""
    from qclearn.nets.networks import network

    return run.steps or network(run.network).training[run.config["preset"]].steps


def log_of(folder):
    """Rows of a run's log as dicts of words, none where it has not begun."""
    path = folder / "log.csv"
    return list(csv.DictReader(path.read_text().splitlines())) if path.is_file() else []


def write_curves(path):
    """The logs of all runs that have begun here, name -> configuration, commit (None: unfinished),
    columns of the log; what the file already has of runs on other machines stays."""
    from qclearn.benchmark.measured import read_measured, write_measured
    from qclearn.nets.weights import read_weights

    known = read_measured("training", path) if path.exists() else {}
    curves = {name: known[name] for name in runs() if name in known}
    for name in runs():
        rows, weights = log_of(FOLDER / name), weights_of(name)
        if rows:
            config = json.loads((FOLDER / name / "config.json").read_text())
            log = {column: [float(f"{float(row[column]):.5g}") for row in rows] for column in rows[0]}
            curves[name] = config | {"commit": read_weights(weights)[0]["commit"] if weights else None, "log": log}
    write_measured("training", path, {name: curves[name] for name in runs() if name in curves})


if __name__ == "__main__":
    main()
