"""Measure the shipped networks against their exact counterparts.

    python -m book.studies.evaluate_networks --out qclearn/benchmark/results/networks.json

One thread throughout, so that the times compare. Each part of the file carries its own provenance;
parts that are not run again are kept. The pages of the book read their figures from
qclearn/benchmark/results/networks.json.
"""

import argparse
import importlib
import os
import platform
import time
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import torch
from threadpoolctl import threadpool_limits

from data_synth.generations import GENERATION
from qclearn.benchmark.measured import read_measured, write_measured
from qclearn.io.provenance import provenance

SEEDS = list(range(1001, 1025))
# The last one needs networks that are not shipped.
PARTS = ("ldnet", "cpnet", "dbsnet", "losses", "controls")


def main():
    options = read_options()
    torch.set_num_threads(1)
    results = read_measured("networks", options.out) if options.out and options.out.exists() else {}
    for part in options.only:
        start = time.perf_counter()
        with threadpool_limits(1):
            figures = importlib.import_module(f"book.studies.evaluation.{part}").figures(SEEDS, quick=options.quick)
        results[part] = {**figures, "provenance": told(options, time.perf_counter() - start)}
        if options.out:  # after every part: what was measured is not lost
            options.out.parent.mkdir(parents=True, exist_ok=True)
            write_measured("networks", options.out, results)


def read_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, help="parts to run (default: all)")
    parser.add_argument("--quick", action="store_true", help="few samples, to see that all works")
    parser.add_argument("--out", type=Path, help="JSON file to write or to renew")
    return parser.parse_args()


def told(options, seconds):
    return {
        "seeds": SEEDS,
        "quick": options.quick,
        "generation": GENERATION,
        **provenance(),
        "seconds": round(seconds, 1),
        "threads": torch.get_num_threads(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("torch", "numpy", "scipy", "qclearn")},
    }


if __name__ == "__main__":
    main()
