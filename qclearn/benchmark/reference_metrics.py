"""Measures by held-out curves, folds and held-out maps, and those of the true map itself."""

from types import SimpleNamespace

import numpy as np
import scipy

from ..registration.curves import (
    POINTS_PER_CURVE,
    SAMPLES,
    curve_distance,
    curve_lines,
    curves_in_space,
    sample_curve,
)
from ..registration.features import standardised
from ..registration.report import area_and_shape, log2_distortions, quantile
from .images import OnDisk

# Figures of held-out curves, figures of the true map itself, and their names in a row.
HELD_OUT = ["held_out", "held_out_mm", "worst_held_out_mm", "held_out_points_mm"]
HELD_OUT += ["held_out_middle_mm"]
OWN = ["r_depth", "r_curvature", "r_maps", "log2_area", "log2_shape"]
TRUE_MAP = ["floor_mm", "floor_curve_mm", *(f"true_{name}" for name in OWN)]


def curve_errors(pair, curves, f, image):
    """Distances (10 K,) of mapped curves from the control's at equal arc length: (in disk, mm).

    In the disk None for a map to the sphere.
    """
    moving, control = pair.moving.surface, pair.control.surface
    here = [sample_curve(moving, curve["moving"], POINTS_PER_CURVE) for curve in curves]
    there = [sample_curve(control, curve["control"], POINTS_PER_CURVE) for curve in curves]
    mapped = np.concatenate([samples @ f for samples in here])
    target = np.concatenate([samples @ pair.control.disk.z for samples in there])
    target_mm = np.concatenate([samples @ control.vertices for samples in there])
    in_disk = abs(mapped - target) if f.ndim == 1 else None
    return in_disk, np.linalg.norm(image.lift(image.locate(mapped)) - target_mm, axis=1)


def held_out(pair, sides, f, image):
    """The held-out curves' distances from the control's, mm, by the names of HELD_OUT.

    In order: each curve's, mean over both ways; their mean; their worst; point to point by arc
    length; the mean of `middle_distance`. None without any.
    """
    if not pair.held:
        return dict.fromkeys(HELD_OUT)
    names = [curve.name for curve in sides.held]
    here, _ = curve_lines(sides.moving, sides.held, "moving")
    there, _ = curve_lines(sides.control, sides.held, "control")

    def lift(points):  # to their images on the control
        return image.lift(image.locate(sides.moving.disk.interpolation(points) @ f))

    images = curves_in_space(SimpleNamespace(lift=lift), here)
    pairs = list(zip(images, curves_in_space(sides.control, there)))
    each = {name: float(curve_distance(*both)) for name, both in zip(names, pairs)}
    distances = list(each.values())
    points = curve_errors(pair, pair.held, f, image)[1].mean()
    middle = np.mean([middle_distance(*both) for both in pairs])
    figures = np.mean(distances), max(distances), points, middle
    return dict(zip(HELD_OUT, (each, *map(float, figures))))


def middle_distance(one, other):
    """Mean distance of the middle three fifths of either curve (n, 3), (m, 3) from the other.

    The ends of a curve are less certain than its course.
    """
    trees = scipy.spatial.cKDTree(one), scipy.spatial.cKDTree(other)
    far = trees[1].query(one)[0], trees[0].query(other)[0]
    return sum(d[len(d) // 5 : len(d) - len(d) // 5].mean() for d in far) / 2


def agreement(pair, image, places):
    """`correlations` of depth and curvature, "r_depth" and "r_curvature", and of held-out maps,
    "r_maps": name -> r, None without any."""
    by_name = correlations(pair, (image, places), pair.moving.folds, pair.control.folds)
    sides = [{name: values[k] for name, values in pair.maps.items()} for k in range(2)]
    maps = correlations(pair, (image, places), *sides) or None
    return {f"r_{name}": r for name, r in by_name.items()} | {"r_maps": maps}


def correlations(pair, target, here, there):
    """r by moving area of the maps here (V,) and there (W,) where both are known: name -> r.

    target: the image of a map and its places there.
    """
    by_name = {}
    areas = pair.moving.surface.vertex_areas
    image, places = target
    for name, values in here.items():
        both = np.stack([values, image.values(there[name], places)], axis=1)
        known = np.isfinite(both).all(1)
        shares = areas[known] / areas[known].sum()
        one, other = standardised(both[known], shares).T
        by_name[name] = float(np.clip(shares @ (one * other), -1, 1))
    return by_name


def log2_means(surface, points):
    """`log2_distortions` as plain figures: means and, as "p95_...", 95th percentiles."""
    distortions = log2_distortions(surface, points)
    means = {name: mean for name, (mean, _) in distortions.items()}
    return means | {f"p95_{name}": p95 for name, (_, p95) in distortions.items()}


def tails(surface, points):
    """95th percentiles by area of `area_and_shape`: "areal_95" of |log2 J|, "shape_95"."""
    areas = surface.vertex_areas / surface.area
    log2_j, log2_r = area_and_shape(surface, points)
    return {"areal_95": quantile(abs(log2_j), areas), "shape_95": quantile(abs(log2_r), areas)}


def true_map(pair, locate):
    """The true map's own figures, by the names of TRUE_MAP."""
    image = OnDisk(pair.control, locate)
    places = locate(pair.truth_disk)
    figures = log2_means(pair.moving.surface, pair.truth) | agreement(pair, image, places)
    return floors(pair) | {f"true_{name}": figures[name] for name in OWN}


def floors(pair):
    """Distance of the curves' true images from the control's curves, mm: a dict of two figures.

    A sulcus forms beside its course on the template, so a map that takes curves to curves is off by
    this much: "floor_mm" by points of equal arc length, "floor_curve_mm" by distance of curves.
    """
    if pair.given == "exact":
        return {"floor_mm": 0.0, "floor_curve_mm": 0.0}
    moving, control = pair.moving.surface, pair.control.surface

    def images(count):
        for curve in pair.curves:
            there = sample_curve(control, curve["control"], count) @ control.vertices
            yield sample_curve(moving, curve["moving"], count) @ pair.truth, there

    pairs = images(POINTS_PER_CURVE)
    off = [np.linalg.norm(image - there, axis=1).mean() for image, there in pairs]
    apart = [curve_distance(image, there) for image, there in images(SAMPLES)]
    return {"floor_mm": float(np.mean(off)), "floor_curve_mm": float(np.mean(apart))}
