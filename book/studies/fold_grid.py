"""Compute maps of folds and curves on a grid of delta and eta, for the tuner's sliders.

    python -m book.studies.fold_grid

fsaverage5's mirrored right side onto its left, by the folds and every second of the named sulci; the others are
held out, as in `qclearn demo`. The map of each setting lies on the tuner's mesh, in the moving disk that all curves
align. The browser takes a map linear between four of the grid, and certifies what it shows.
"""

import warnings

from tqdm import tqdm

from qcbook import Tuner
from qcbook.examples import cortices
from qclearn import demo_landmarks
from qclearn.benchmark.measured import RESULTS, write_measured
from qclearn.io.provenance import provenance
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import pairs
from qclearn.plane.grids import COARSE, polar
from qclearn.registration.problem import Weights
from qclearn.registration.register import register

DIGITS = 6  # of a place in the disk
USUAL = {"alpha": Weights.alpha, "beta": Weights.beta, "gamma": Weights.gamma}


def grid(pair, curves, held, mesh, deltas, etas):
    """Rows, one for each delta, of maps, one for each eta: values [x, y] at the vertices of a polar `Disk` `mesh`.

    pair: `Courses`; curves: its landmarks, as `register` takes them; held: names of those held out.
    """
    moving, control = pair.moving.surface, pair.control.surface
    places, rim = pair.moving.disk.locate(mesh.z), abs(mesh.z) > 1 - 1e-9
    rows = [[] for _ in deltas]
    for row, delta in zip(rows, tqdm(deltas, disable=None)):
        for eta in etas:
            found = register(moving, control, curves, hold_out=held, delta=delta, eta=eta, **USUAL)
            f = pair.moving.disk.interpolate(found.disk_map, places)
            f[rim] /= abs(f[rim])
            row.append(pairs(f).round(DIGITS).tolist())
    return rows


def main():
    warnings.simplefilter("ignore", RepairWarning)  # boundary steps are raised at the ragged rim
    pair, curves = cortices("cortex"), demo_landmarks()
    labels = list(range(1, len(pair.names), 2))
    held = [pair.names[label] for label in labels]
    maps = grid(pair, curves, held, polar(*COARSE), **{f"{name}s": nodes for name, nodes in Tuner.grid.items()})
    figures = {"weights": USUAL, "held": labels, **Tuner.grid, "maps": maps, "provenance": provenance()}
    write_measured("foldgrid", RESULTS / "foldgrid.json", figures)


if __name__ == "__main__":
    main()
