"""LD-Net on subjects it has not seen, against the shortest path in the fundus metric
(`landmarks.detect_curves`)."""

import time
from copy import copy

import numpy as np
import torch

from data_synth.cohort import hemispheres
from qclearn.nets import load
from qclearn.registration.curves import curve_distance, curves_in_space, detect_curves
from qclearn.surfaces.conformal import parameterize

RESAMPLES = 2000


def figures(seeds, quick=False):
    """Mean distance in mm to the true curves, plain and interrupted or branched sulci apart, and
    times.

    Times are the processor's, on one thread: what a clock shows where nothing else runs.
    """
    subjects = hemispheres(seeds[:2] if quick else seeds, 2500 if quick else 10_000)
    methods = detectors()
    rows, seconds = [], {name: [] for name in methods}
    for subject in subjects:
        distances, times = distances_to_truth(parameterize(subject.surface), methods)
        for name, passed in times.items():
            seconds[name].append(passed)
        for curve, values in distances.items():
            rows.append(
                {
                    "seed": subject.seed,
                    "curve": curve,
                    "interrupted": curve in subject.interrupted,
                    "branched": curve in subject.branched,
                    **values,
                }
            )
    result = {title: summary([row for row in rows if keep(row)], methods) for title, keep in CLASSES.items()}
    by_name = {name: summary([row for row in rows if row["curve"] == name], methods) for name in subjects[0].curves}
    return {
        **result,
        "sulci": by_name,
        "latency_ms": {name: latency(name) for name in methods if name != "twin"},
        "seconds": {name: float(np.median(passed)) for name, passed in seconds.items()},
        "rows": [list(row.values()) for row in rows],
        "columns": list(rows[0]),
    }


CLASSES = {
    "all": lambda row: True,
    "plain": lambda row: not row["interrupted"] and not row["branched"],
    "interrupted or branched": lambda row: row["interrupted"] or row["branched"],
    "interrupted": lambda row: row["interrupted"],
    "branched": lambda row: row["branched"],
}


def detectors():
    """What is compared, name -> detect(surface, z, endpoints)."""
    return {preset: load("ldnet", preset).detect for preset in ("best", "paper")} | {"twin": detect_curves}


def distances_to_truth(side, methods):
    """({curve: {method: mm, "apart": mm}}, {method: seconds}): the named curves found again from
    their endpoints.

    "apart": from the first method's curve to the last one's.
    """
    surface, z = side.surface, side.disk.z
    ends = np.array([path[[0, -1]] for path in surface.curves.values()])
    groups, seconds = [[z[path] for path in surface.curves.values()]], {}
    for name, detect in methods.items():
        fresh = copy(surface)  # of which nothing is remembered, as its depth would be
        start = time.process_time()
        groups.append(detect(fresh, z, ends))
        seconds[name] = time.process_time() - start
    points = iter(curves_in_space(side, [curve for group in groups for curve in group]))
    truth, *found = [[next(points) for _ in group] for group in groups]
    distances = {}
    for k, curve in enumerate(surface.curves):
        distances[curve] = {name: curve_distance(truth[k], part[k]) for name, part in zip(methods, found)}
        distances[curve]["apart"] = curve_distance(found[0][k], found[-1][k])
    return distances, seconds


def summary(rows, methods):
    """Means and medians over curves, and the first method less the twin with a 95 % interval,
    subjects resampled."""
    if not rows:
        return {"curves": 0}
    values = {name: np.array([row[name] for row in rows]) for name in (*methods, "apart")}
    first = next(iter(methods))
    difference, groups = values[first] - values["twin"], np.array([row["seed"] for row in rows])
    return {
        "curves": len(rows),
        **{name: float(values[name].mean()) for name in methods},
        "median": {name: float(np.median(values[name])) for name in methods},
        "worst": {name: float(values[name].max()) for name in methods},
        "difference": float(difference.mean()),
        "interval": interval(difference, groups),
        "won": float((difference < -0.1).mean()),
        "lost": float((difference > 0.1).mean()),  # by a tenth of a millimetre
        "same_path": float((values["apart"] < 1e-6).mean()),
    }


def interval(values, groups):
    """[2.5 %, 97.5 %] of the mean when the groups are drawn anew, with replacement."""
    rng = np.random.default_rng(0)
    totals = np.array([[values[groups == group].sum(), (groups == group).sum()] for group in np.unique(groups)])
    drawn = totals[rng.integers(len(totals), size=(RESAMPLES, len(totals)))].sum(axis=1)
    return [float(x) for x in np.percentile(drawn[:, 0] / drawn[:, 1], [2.5, 97.5])]


def latency(preset, repeats=20):
    """Milliseconds of one forward pass of a shipped network on its image, eight curves; the median."""
    model = load("ldnet", preset)
    size, passed = model.config.size, []
    images, ends = torch.rand(1, 2, size, size) * 255, torch.rand(1, 8, 2).to(torch.complex64)
    for _ in range(repeats):
        start = time.process_time()
        with torch.no_grad():
            getattr(model, "from_images", model)(images, ends)
        passed.append(time.process_time() - start)
    return 1e3 * float(np.median(passed))
