"""Figures of a generation of synthetic subjects: how well their folds correspond, and how much like cortex they are.

    python tools/cohort_figures.py [--generation 3] [--seeds 5001-5012] [--control 2001] [--vertices 10000]

For each seed, onto the control: how far the control's curves lie from the true images of the subject's, as curves and
by points of equal arc length (the two floors of the benchmark), correlation of the sulcal depths under the true map,
distance of the landmarks in the unit disk after the best Möbius map, rows of the realism table inside their ranges, and
seconds and memory of growth. Grows everything anew: ten seconds a subject.
"""

import resource
import time
import warnings

import click
import numpy as np

import qclearn as qc
from data_synth import make_cortex
from data_synth.correspondence import depth_correlation
from data_synth.generations import GENERATION
from data_synth.realism import realism, score
from qclearn.benchmark.pairs import Mapped, cohort_pair, prepare
from qclearn.benchmark.yardstick import floors

COLUMNS = ("floor_curve_mm", "floor_mm", "depth_correlation", "landmarks", "realism", "seconds")


def grown(seed, vertices, generation):
    """(subject, its `Mapped` surface, processor seconds of its growth)."""
    start = time.process_time()
    subject = make_cortex(seed, vertices, generation=generation)
    seconds = time.process_time() - start
    return subject, Mapped(subject.surface, qc.disk_conformal_map(subject.surface), subject.template), seconds


def figures(seed, vertices, generation, control):
    """The figures of a seed's subject onto the control, by the names of COLUMNS, and the realism rows outside."""
    subject, mapped, seconds = grown(seed, vertices, generation)
    pair = cohort_pair(mapped, control[1])
    problem = prepare(pair).problem  # aligned by the best Möbius map
    rows = score(realism(subject.surface))
    return {
        **floors(pair),
        "depth_correlation": depth_correlation(subject, control[0]),
        "landmarks": abs(problem.moving - problem.target).mean(),
        "realism": sum(row.inside for row in rows),
        "seconds": seconds,
        "outside": ", ".join(f"{row.name} {row.value:.3g}" for row in rows if not row.inside),
    }


@click.command(help=__doc__)
@click.option("--generation", default=GENERATION, show_default=True)
@click.option("--seeds", default="5001-5012", show_default=True)
@click.option("--control", default=2001, show_default=True)
@click.option("--vertices", default=10_000, show_default=True)
def main(generation, seeds, control, vertices):
    warnings.simplefilter("ignore", qc.RepairWarning)
    first, last = map(int, seeds.split("-"))
    target, rows = grown(control, vertices, generation), []
    print("seed", *COLUMNS)
    for seed in range(first, last + 1):
        rows.append(figures(seed, vertices, generation, target))
        print(seed, *(f"{rows[-1][name]:.3g}" for name in COLUMNS), rows[-1]["outside"], flush=True)
    for name in COLUMNS:
        values = [row[name] for row in rows]
        print(f"{name}: mean {np.mean(values):.3g}, {min(values):.3g} to {max(values):.3g}")
    print(f"peak memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")


if __name__ == "__main__":
    main()
