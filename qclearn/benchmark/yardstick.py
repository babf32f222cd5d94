"""What can be measured where no true map is known: curves held out, and folds and maps that took no part.

Where the true map is known, its own figures, to lay beside those of a fit.
"""

import numpy as np

from ..registration.features import standardised
from ..registration.landmarks import POINTS_PER_CURVE, curve_distance, sample_curve
from ..registration.metrics import log2_distortions
from ..registration.report import held_out_distances

FINE = 400  # points on a curve where it is compared as a curve
HELD_OUT = ("held_out", "held_out_mm", "worst_held_out_mm", "held_out_points_mm")
TRUE_MAP = (
    "floor_mm",
    "floor_curve_mm",
    "true_r_depth",
    "true_r_curvature",
    "true_r_maps",
    "true_log2_area",
    "true_log2_shape",
)


def curve_errors(pair, curves, f):
    """Distances of a map's points on the moving curves from those of equal arc length on the control's: in its disk
    (10 K,), and in mm (10 K,)."""
    moving, control = pair.moving.surface, pair.control.surface
    mapped = np.concatenate([sample_curve(moving, curve["moving"], POINTS_PER_CURVE) @ f for curve in curves])
    there = [sample_curve(control, curve["control"], POINTS_PER_CURVE) for curve in curves]
    target, target_mm = (
        np.concatenate([samples @ data for samples in there]) for data in (pair.control.disk.z, control.vertices)
    )
    return abs(mapped - target), np.linalg.norm(pair.control.lift(mapped) - target_mm, axis=1)


def held_out(pair, sides, f):
    """How far the curves that took no part end from their own, mm: each ("held_out", name -> mean two-way distance of
    the curves), their mean and the worst; and point to point by arc length. None without any."""
    if not pair.held:
        return dict.fromkeys(HELD_OUT)
    each = {name: distance for name, (distance,) in held_out_distances(sides, f).items()}
    points = curve_errors(pair, pair.held, f)[1]
    return dict(zip(HELD_OUT, (each, float(np.mean(list(each.values()))), max(each.values()), float(points.mean()))))


def folds_agree(pair, places):
    """r over the moving area between its depth and curvature and the control's at `places`: "r_depth", ..."""
    found = correlations(pair, places, pair.moving.folds, pair.control.folds)
    return {f"r_{name}": r for name, r in found.items()}


def maps_agree(pair, places):
    """The same for maps that took no part, name -> r; None without any."""
    moving = {name: sides[0] for name, sides in pair.maps.items()}
    return correlations(pair, places, moving, {name: sides[1] for name, sides in pair.maps.items()}) or None


def correlations(pair, places, here, there):
    """r by area of each map here (V,) with the one there (W,) at `places`, where both are known: name -> r."""
    found, areas = {}, pair.moving.surface.vertex_areas
    for name, values in here.items():
        both = np.stack([values, pair.control.disk.interpolate(there[name], places)], axis=1)
        known = np.isfinite(both).all(1)
        shares = areas[known] / areas[known].sum()
        one, other = standardised(both[known], shares).T
        found[name] = float(np.clip(shares @ (one * other), -1, 1))
    return found


def log2_means(surface, points):
    """`log2_distortions` as plain figures: the means and, as "p95_...", the 95th percentiles."""
    found = log2_distortions(surface, points)
    return {name: mean for name, (mean, _) in found.items()} | {f"p95_{name}": p95 for name, (_, p95) in found.items()}


def true_map(pair, lookup):
    """The true map's own figures, by the names of TRUE_MAP."""
    places, stretch = lookup(pair.truth_disk), log2_means(pair.moving.surface, pair.truth)
    own = {"r_maps": maps_agree(pair, places), **folds_agree(pair, places)}
    own |= {name: stretch[name] for name in ("log2_area", "log2_shape")}
    return floors(pair) | {f"true_{name}": figure for name, figure in own.items()}


def floors(pair):
    """What the true curves themselves leave, mm: how far their true images lie from the control's curves.

    A sulcus forms beside its course on the template, and not at the same place in everybody: a map that takes curves to
    curves, as all do here, is off by this much on them. By points of equal arc length, and by distance of curves.
    """
    if pair.given == "exact":
        return {"floor_mm": 0.0, "floor_curve_mm": 0.0}
    off, apart = [], []
    for curve in pair.curves:
        for count, collect in ((POINTS_PER_CURVE, off), (FINE, apart)):
            image = sample_curve(pair.moving.surface, curve["moving"], count) @ pair.truth
            there = sample_curve(pair.control.surface, curve["control"], count) @ pair.control.surface.vertices
            collect.append(
                curve_distance(image, there) if collect is apart else np.linalg.norm(image - there, axis=1).mean()
            )
    return {"floor_mm": float(np.mean(off)), "floor_curve_mm": float(np.mean(apart))}
