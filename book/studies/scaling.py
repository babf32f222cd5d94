"""Measure how much sooner two worker processes finish the benchmark than one: several times each,
in turns.

    python -m book.studies.scaling

All runs on a few subjects on coarse meshes, which are grown beforehand. The benchmark's page reads
qclearn/benchmark/results/scaling.json.
"""

import tempfile
from pathlib import Path

import numpy as np

from data_synth.cohort import SEEDS, hemispheres
from qclearn.benchmark.measured import RESULTS, write_measured
from qclearn.benchmark.pairs import CONTROL
from qclearn.benchmark.run import benchmark
from qclearn.io.provenance import provenance

SUBJECTS, VERTICES, REPETITIONS = 1, 2500, 3


def main():
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
    write_measured("scaling", RESULTS / "scaling.json", figures)


if __name__ == "__main__":
    main()
