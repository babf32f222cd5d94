"""Two answers of folds alone for one pair of people: led by depth and curvature, and also by the
potential of curvature.

    python -m book.studies.valleys --people FOLDER

FOLDER holds ETI.npz and CIV.npz, open hemispheres with curves. Each answer has its objective on the
last level, where both compare the same maps, and the curves in the control's disk.
"""

import argparse
from pathlib import Path

from qclearn.benchmark.cortex import person
from qclearn.benchmark.measured import RESULTS, write_measured
from qclearn.io.provenance import provenance
from qclearn.plane.disk import pairs
from qclearn.registration.curves import check_curves, curves_of_both
from qclearn.registration.features import FOLDS, check_features, featured
from qclearn.registration.fit import fit_with_fallbacks
from qclearn.registration.problem import DELTA, ETA, Weights
from qclearn.registration.report import held_out_distances
from qclearn.registration.start import SurfacePair, align_disks, sample_landmarks
from qclearn.surfaces.conformal import parameterize

PAIR = "ETI", "CIV"
LED = (tuple(name for name in FOLDS if name != "potential"), FOLDS)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=Path, required=True, metavar="FOLDER", help="NAME.npz with curves")
    folder, made = parser.parse_args().people, provenance()
    moving, control = (parameterize(person(folder / f"{name}.npz").surface) for name in PAIR)
    curves = curves_of_both(moving.surface, control.surface)
    figures = {
        "pair": PAIR,
        "targets": {curve["name"]: pairs(control.disk.z[curve["control"]]).round(3).tolist() for curve in curves},
        "answers": [answer(moving, control, curves, names) for names in LED],
        "provenance": made,
    }
    write_measured("valleys", RESULTS / "valleys.json", figures)


def answer(moving, control, curves, names):
    """The figures of one fit, and its curves in the control's disk."""
    maps = check_features(names, moving.surface, control.surface)
    here, there, features = featured(moving, control, maps)
    held = check_curves(curves, moving.surface, control.surface)
    pair = align_disks(SurfacePair(here, there, [], held, features))
    problem, weights = sample_landmarks(pair), Weights(delta=DELTA, eta=ETA)
    fit = fit_with_fallbacks(problem, weights, features=pair.features)
    losses = {"alpha": "L_mu", "beta": "L_grad_mu", "delta": "L_features", "eta": "L_area"}
    terms = {loss: getattr(weights, weight) * fit.losses[loss] for weight, loss in losses.items()}
    distances = held_out_distances(problem.pair, problem.pair.held_lines, fit.f, fit.f)
    return {
        "features": names,
        "objective": sum(terms.values()),
        "terms": terms,
        "held_out_mm": {name: after for name, (_, after) in distances.items()},
        "lines": {curve["name"]: pairs(fit.f[curve["moving"]]).round(3).tolist() for curve in curves},
    }


if __name__ == "__main__":
    main()
