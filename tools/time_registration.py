"""Measure what registrations cost: CPU seconds of one thread, on fsaverage5 as it is and with its faces cut finer.

    python tools/time_registration.py                # 10,000 and 40,000 vertices
    python tools/time_registration.py --cuts 0 2     # 10,000 and 160,000

A row a run: the whole of `register`, disk maps and features included, and the fit within it. Six of eleven sulci are
fitted in the hybrid, all in the run by landmarks, none in the last. Each process runs one row, so that its largest
memory is that of the run; what is left of a busy machine is counted by CPU time, not by the clock.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time

THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ALONE = THREADS | {"PYTHONDONTWRITEBYTECODE": ""}  # packages are compiled once, not by each process anew
FOLDS = ("depth", "curvature")
RUNS = ("landmarks", "hybrid", "no landmarks")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, nargs="+", default=[0, 1], help="how often each face is cut into four")
    parser.add_argument("--runs", nargs="+", choices=RUNS, default=RUNS)
    parser.add_argument("--row", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.row:
        print(json.dumps(measure(options.row[0], int(options.row[1]))))
        return
    print(f"{'vertices':>9}  {'run':14}{'s':>7}{'fit s':>7}{'MB':>7}{'mm':>7}{'held mm':>9}  flipped")
    for cuts in options.cuts:
        for run in options.runs:
            command = [sys.executable, __file__, "--row", run, str(cuts)]
            found = subprocess.run(command, env=os.environ | ALONE, capture_output=True, text=True, check=True)
            print(line(run, json.loads(found.stdout)), flush=True)


def line(run, row):
    """One row of the table."""
    off, held = (f"{row[key]:.2f}" if row[key] is not None else "-" for key in ("mm", "held_mm"))
    start = f"{row['vertices']:9}  {run:14}{row['seconds']:7.1f}{row['fit_seconds']:7.1f}{row['megabytes']:7.0f}"
    return f"{start}{off:>7}{held:>9}  {row['flipped']}"


def measure(run, cuts):
    """The figures of one run, dict."""
    import numpy as np

    import qclearn as qc
    from qclearn.registration import register as pipeline

    moving, control = (cut(qc.fsaverage5(side), cuts) for side in ("right", "left"))
    curves, fit, seconds = qc.demo_landmarks()["curves"], pipeline.bijective_fit, []

    def timed(*arguments):
        start = time.process_time()
        found = fit(*arguments)
        seconds.append(time.process_time() - start)
        return found

    pipeline.bijective_fit = timed
    options = {
        "landmarks": {"curves": curves, "features": None},
        "hybrid": {"curves": curves, "features": FOLDS, "hold_out": [curve["name"] for curve in curves[1::2]]},
        "no landmarks": {"curves": [], "features": FOLDS},
    }[run]
    start = time.process_time()
    report = qc.register(qc.mirror(moving), control, **options).report
    return {
        "vertices": len(moving.vertices),
        "seconds": time.process_time() - start,
        "fit_seconds": sum(seconds),
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        "mm": report["landmark_error_mm"],
        "held_mm": float(np.mean(list(report["held_out_mm"].values()), axis=0)[1]) if report["held_out_mm"] else None,
        "flipped": report["flipped"],
    }


def cut(surface, times):
    """A surface with each face cut into four, so many times; its vertices keep their numbers."""
    import numpy as np

    from qclearn.surfaces.surface import Surface

    for _ in range(times):
        n, edges = len(surface.vertices), surface.edges
        keys = edges[:, 0] * n + edges[:, 1]
        ends = np.sort(np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=-1), axis=-1)
        middle = n + np.searchsorted(keys, ends[..., 0] * n + ends[..., 1])
        a, b, c = surface.faces.T
        ab, bc, ca = middle.T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        surface = Surface(np.concatenate([surface.vertices, surface.vertices[edges].mean(1)]), faces)
    return surface


if __name__ == "__main__":
    main()
