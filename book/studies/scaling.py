"""Measure how much sooner two worker processes finish the benchmark than one: several times each,
in turns.

    python -m book.studies.scaling --out qclearn/benchmark/results/scaling.json

All runs on a few subjects on coarse meshes, which are grown beforehand. The benchmark's page reads
qclearn/benchmark/results/scaling.json.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from data_synth.cohort import SEEDS, hemispheres
from qclearn.benchmark.measured import write_measured
from qclearn.benchmark.pairs import CONTROL
from qclearn.benchmark.run import benchmark
from qclearn.io.provenance import provenance

SUBJECTS, VERTICES, REPETITIONS = 1, 2500, 3


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    hemispheres([*SEEDS[:SUBJECTS], CONTROL], VERTICES)
    seconds = {1: [], 2: []}
    for _ in range(REPETITIONS):
        for workers, passed in seconds.items():
            with tempfile.TemporaryDirectory() as folder:
                results = benchmark(Path(folder, "out.json"), SUBJECTS, VERTICES, workers=workers)
            passed.append(results["provenance"]["seconds"])
    figures = {
        "subjects": SUBJECTS,
        "vertices": VERTICES,
        "tasks": len(results["rows"]),
        "seconds": {str(workers): passed for workers, passed in seconds.items()},
        "speed_up": float(np.median(seconds[1]) / np.median(seconds[2])),
        **provenance(),
    }
    print(json.dumps(figures, indent=1))
    if options.out:
        write_measured("scaling", options.out, figures)


if __name__ == "__main__":
    main()
