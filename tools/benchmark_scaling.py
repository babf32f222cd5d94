"""Measure how much sooner two worker processes finish the benchmark than one: several times each, in turns.

    python tools/benchmark_scaling.py --out qclearn/benchmark/kept/scaling.json

All runs on a few subjects on coarse meshes, which are grown beforehand. The benchmark's page reads
qclearn/benchmark/kept/scaling.json.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from data_synth.cohort import SEEDS, hemispheres
from qclearn.benchmark.pairs import CONTROL
from qclearn.benchmark.run import benchmark
from qclearn.files.provenance import provenance


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--subjects", type=int, default=1)
    parser.add_argument("--vertices", type=int, default=2500)
    parser.add_argument("--repetitions", type=int, default=3)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    hemispheres([*SEEDS[: options.subjects], CONTROL], options.vertices)
    seconds = {1: [], 2: []}
    for _ in range(options.repetitions):
        for workers, passed in seconds.items():
            with tempfile.TemporaryDirectory() as folder:
                results = benchmark(Path(folder, "out.json"), options.subjects, options.vertices, workers=workers)
            passed.append(results["provenance"]["seconds"])
    figures = {
        "subjects": options.subjects,
        "vertices": options.vertices,
        "tasks": len(results["rows"]),
        "seconds": {str(workers): passed for workers, passed in seconds.items()},
        "speed_up": float(np.median(seconds[1]) / np.median(seconds[2])),
        **provenance(),
    }
    text = json.dumps(figures, indent=1)
    print(text)
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
