"""Measures without a true map: held-out curves, and folds and maps that took no part; with one, its own figures."""

import numpy as np

from ..registration.features import standardised
from ..registration.landmarks import POINTS_PER_CURVE, SAMPLES, curve_distance, sample_curve
from ..registration.metrics import log2_distortions
from ..registration.report import held_out_distances

HELD_OUT = ("held_out", "held_out_mm", "worst_held_out_mm", "held_out_points_mm")
OWN = ("r_depth", "r_curvature", "r_maps", "log2_area", "log2_shape")  # figures of the true map itself
TRUE_MAP = ("floor_mm", "floor_curve_mm", *(f"true_{name}" for name in OWN))


def curve_errors(pair, curves, f):
    """Distances of curves' mapped points from the control's of equal arc length, disk and mm: each (10 K,)."""
    moving, control = pair.moving.surface, pair.control.surface
    mapped = np.concatenate([sample_curve(moving, curve["moving"], POINTS_PER_CURVE) @ f for curve in curves])
    there = [sample_curve(control, curve["control"], POINTS_PER_CURVE) for curve in curves]
    target, target_mm = (
        np.concatenate([samples @ data for samples in there]) for data in (pair.control.disk.z, control.vertices)
    )
    return abs(mapped - target), np.linalg.norm(pair.control.lift(mapped) - target_mm, axis=1)


def held_out(pair, sides, f):
    """The held-out curves' distances from the control's, mm, by the names of HELD_OUT: each curve's, mean over both
    ways, their mean and worst; and point to point by arc length. None without any."""
    if not pair.held:
        return dict.fromkeys(HELD_OUT)
    each = {name: distance for name, (distance,) in held_out_distances(sides, f).items()}
    points = curve_errors(pair, pair.held, f)[1]
    return dict(zip(HELD_OUT, (each, float(np.mean(list(each.values()))), max(each.values()), float(points.mean()))))


def folds_agree(pair, places):
    """`correlations` of depth and curvature: "r_depth", "r_curvature"."""
    found = correlations(pair, places, pair.moving.folds, pair.control.folds)
    return {f"r_{name}": r for name, r in found.items()}


def maps_agree(pair, places):
    """`correlations` of maps that took no part, name -> r; None without any."""
    moving = {name: sides[0] for name, sides in pair.maps.items()}
    return correlations(pair, places, moving, {name: sides[1] for name, sides in pair.maps.items()}) or None


def correlations(pair, places, here, there):
    """r by moving area of each map here (V,) with the one there (W,) at `places`, where both are known: name -> r."""
    found, areas = {}, pair.moving.surface.vertex_areas
    for name, values in here.items():
        both = np.stack([values, pair.control.disk.interpolate(there[name], places)], axis=1)
        known = np.isfinite(both).all(1)
        shares = areas[known] / areas[known].sum()
        one, other = standardised(both[known], shares).T
        found[name] = float(np.clip(shares @ (one * other), -1, 1))
    return found


def log2_means(surface, points):
    """`log2_distortions` as plain figures: means and, as "p95_...", 95th percentiles."""
    found = log2_distortions(surface, points)
    return {name: mean for name, (mean, _) in found.items()} | {f"p95_{name}": p95 for name, (_, p95) in found.items()}


def true_map(pair, lookup):
    """The true map's own figures, by the names of TRUE_MAP."""
    places = lookup(pair.truth_disk)
    found = log2_means(pair.moving.surface, pair.truth) | folds_agree(pair, places)
    found["r_maps"] = maps_agree(pair, places)
    return floors(pair) | {f"true_{name}": found[name] for name in OWN}


def floors(pair):
    """How far the true images of the curves lie from the control's curves, mm: a dict of two figures.

    A sulcus forms beside its course on the template, so a map that takes curves to curves is off by this much:
    "floor_mm" by points of equal arc length, "floor_curve_mm" by distance of curves.
    """
    if pair.given == "exact":
        return {"floor_mm": 0.0, "floor_curve_mm": 0.0}
    moving, control = pair.moving.surface, pair.control.surface

    def images(count):
        for curve in pair.curves:
            there = sample_curve(control, curve["control"], count) @ control.vertices
            yield sample_curve(moving, curve["moving"], count) @ pair.truth, there

    off = [np.linalg.norm(image - there, axis=1).mean() for image, there in images(POINTS_PER_CURVE)]
    apart = [curve_distance(image, there) for image, there in images(SAMPLES)]
    return {"floor_mm": float(np.mean(off)), "floor_curve_mm": float(np.mean(apart))}
