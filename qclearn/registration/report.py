"""The report of a registration: errors before and after the fit, distortion, held-out curves."""

from dataclasses import asdict
from importlib.metadata import version

import numpy as np

from ..plane.mobius import mobius
from ..surfaces.checks import degenerate_faces
from ..surfaces.units import size_of
from .curves import POINTS_PER_CURVE, curve_distance, curves_in_space, sample_curve
from .diagnose import FEWEST, align_by_folds, astray, differing_walls, disagreeing, reasons, worse
from .metrics import (
    ERRORS,
    coefficient_statistics,
    distortion_quantiles,
    log2_distortions,
    mean_rows,
)


def report_of(pair, landmarks, weights, fit, points):
    """The report of a registration, a dict for JSON, without method and seconds.

    landmarks: the pair's `SampledLandmarks`, whose `mobius_before` is the `_before` of everything;
    points (V, 3): the moving vertices on the control.
    """
    moving = pair.moving.surface
    features = pair.features
    rows = error_rows(pair, landmarks, fit.f)
    maps = landmarks.map_before, fit.f
    held_out = held_out_distances(pair, landmarks.held, *maps)
    messages = [*differing_walls(moving, pair.control.surface), *pair.messages, *landmarks.messages]
    r = {}
    if features:
        # `fit.r` begins with r after the Möbius map of distinct landmarks; the report's `before` is
        # after that of all.
        before = features.correlation(landmarks.map_before).tolist()
        r = {name: [one, fit.r[name][1]] for name, one in zip(features.names, before)}
    return {
        **dict.fromkeys(ERRORS),  # null where no landmark was given
        **mean_rows(rows),
        **coefficient_statistics(fit.mu),
        **log2_distortions(moving, points),
        "distortion": distortion_quantiles(moving, points),
        "flipped": len(fit.flipped),
        "bijective": fit.bijective,
        "degenerate": len(degenerate_faces(points, moving.faces)),
        "fallbacks": [*messages, *fit.fallbacks],
        **asdict(weights),
        "features": dict(zip(features.names, features.feature_weights.tolist()))
        if features
        else {},
        "r": r,
        "start": fit.start_message if features else "",
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": rows,
        "held_out_mm": held_out,
        "suspect": [
            *reasons(moving, rows, fit),
            *feature_messages(pair, landmarks, fit.f),
            *worse(held_out),
        ],
        "version": version("qclearn"),
    }


def feature_messages(pair, landmarks, f):
    """`features:` messages on an aligned pair and its fitted map f (V,), a list. Curves too few to
    determine `mobius_before` make way for the features' best; enough of them know the place."""
    if pair.features is None:
        return []
    start = landmarks.map_before
    few = len(pair.curves) < FEWEST
    if pair.curves and few:
        start = align_by_folds(pair).moving.disk.z
    messages = [*disagreeing(pair.features, start, f)]
    return messages or ([*astray(pair, f)] if few else [])


def error_rows(pair, landmarks, f):
    """Per curve, dict: its name and the means of its landmarks' ERRORS, for the map f (V,) and
    `SampledLandmarks` of a pair; for a detected curve also `landmark_error_true`, between the true
    curves, where the surfaces carry them."""
    if not pair.curves:
        return []
    moving = pair.moving
    control = pair.control
    here, there = landmarks.samples
    mapped = here @ f
    q = there @ control.disk.z
    before = abs(mobius(here @ moving.disk.z, *landmarks.mobius_before) - q)
    off_mm = np.linalg.norm(control.lift(mapped) - there @ control.surface.vertices, axis=1)
    off_mm /= size_of(control.surface).mm
    rows = []
    by_curve = np.reshape([before, abs(mapped - q), off_mm], (3, len(pair.curves), -1)).mean(2)
    for curve, errors in zip(pair.curves, by_curve.T.tolist()):
        row = {"name": curve.name, **dict(zip(ERRORS, errors))}
        rows.append(row)
        true_p = true_path(moving.surface, curve, "moving")
        true_q = true_path(control.surface, curve, "control")
        if any(curve.detect.values()) and true_p is not None and true_q is not None:
            after = sample_curve(moving.surface, true_p, POINTS_PER_CURVE) @ f
            target = sample_curve(control.surface, true_q, POINTS_PER_CURVE) @ control.disk.z
            row["landmark_error_true"] = float(abs(after - target).mean())
    return rows


def true_path(surface, curve, side):
    """The vertex path of a `Curve` as given, or as the surface carries it between the given
    endpoints, else None."""
    given = curve.path(side)
    known = surface.curves.get(curve.name)
    if not curve.detect[side]:
        return given
    if known is None or sorted(known[[0, -1]]) != sorted(given):
        return None
    return known if known[0] == given[0] else known[::-1]


def held_out_distances(pair, lines, *maps):
    """Held-out curve -> `curve_distance`, mm, between its image by each of the maps (V,) and itself
    on the control. lines: name -> (moving, control) line in the disks of the pair, as
    `SampledLandmarks.held`."""
    if not lines:
        return {}
    moving, control = zip(*lines.values())
    stops = np.cumsum([len(line) for line in moving])[:-1]
    samples = pair.moving.disk.interpolation(np.concatenate(moving))
    targets = curves_in_space(pair.control, control)
    images = [curves_in_space(pair.control, np.split(samples @ f, stops)) for f in maps]
    mm = size_of(pair.control.surface).mm
    return {
        name: [float(curve_distance(curve, target) / mm) for curve in curves]
        for name, target, curves in zip(lines, targets, zip(*images))
    }
