"""The report of a registration: errors before and after the fit, distortion, held-out curves, and
Dice's coefficients of annotations."""

from dataclasses import asdict
from importlib.metadata import version

import numpy as np

from ..plane.mobius import mobius
from ..surfaces.checks import degenerate_faces
from ..surfaces.surface import SurfaceError
from ..surfaces.units import size_of
from .curves import POINTS_PER_CURVE, SIDES, curve_distance, curves_in_space, sample_curve
from .diagnose import FEWEST, align_by_folds, astray, differing_walls, disagreeing, reasons, worse
from .metrics import (
    ERRORS,
    coefficient_statistics,
    distortion_quantiles,
    log2_distortions,
    mean_rows,
)

NAMELESS = ("", "???", "unknown")  # regions that are none


def check_annotations(annotations, *surfaces):
    """Both sides' regions as numbers (V,) and (W,), -1 for those that are not on both, their names
    (R,), and the count of regions of the side that has more; None where there are no annotations.
    SurfaceError where counts do not fit, or no region is on both sides."""
    if annotations is None:
        return None
    if not isinstance(annotations, (list, tuple)) or len(annotations) != len(SIDES):
        raise SurfaceError(
            "annotations are no pair: give the moving and the control vertices' names of regions"
        )
    names = [of_vertices(*one) for one in zip(SIDES, annotations, surfaces)]
    shared = np.intersect1d(*names)
    shared = shared[~np.isin(np.char.lower(shared), NAMELESS)]
    if not len(shared):
        some = [", ".join(np.unique(own)[:3].tolist()) for own in names]
        raise SurfaceError(
            f"the annotations share no region's name (moving: {some[0]}; control: {some[1]}); "
            "rename"
        )
    numbers = [np.where(np.isin(own, shared), np.searchsorted(shared, own), -1) for own in names]
    regions = [np.setdiff1d(np.char.lower(own), NAMELESS) for own in names]
    return *numbers, shared.tolist(), max(map(len, regions))


def of_vertices(side, names, surface):
    """The names of regions of a surface's vertices (V,), also from those of the whole surface that
    it was cut from."""
    names = np.asarray(names)
    count = len(surface.vertices)
    table = surface.original_vertices
    if names.dtype.kind != "U" or names.ndim != 1:
        raise SurfaceError(
            f"annotation, {side} side: {names.dtype} {names.shape}; give the name of each "
            "vertex's region"
        )
    if len(names) == count:
        return names
    # No more than half of a surface is cut away.
    if table is not None and table.max() < len(names) <= 2 * count:
        return names[table]
    raise SurfaceError(
        f"annotation, {side} side: {len(names)} regions for {count} vertices; give one a vertex "
        "of the surface as it is registered, or of the whole one if its npz has original_vertices"
    )


def dice(pair, regions, *maps):
    """Dice's coefficients of a `SurfacePair` and regions of `check_annotations` after a first and a
    last disk map (V,).

    `2 |A n B| / (|A| + |B|)`, |.| the moving surface's area, A a region of the moving side and B
    the control's of that name where the map takes its vertices: `{"before", "after"}`, the mean
    weighted by |A| + |B|, `"regions"`: name -> [before, after], and `"of"`: how many regions the
    side with more of them has. Empty where there are none.
    Source: Dice 1945.
    """
    if regions is None:
        return {}
    own, on_control, names, count = regions
    areas = pair.moving.surface.vertex_areas
    disk = pair.control.disk

    def areas_of(numbers):
        return np.bincount(numbers[numbers >= 0], areas[numbers >= 0], len(names))

    rows = []
    for f in maps:
        # Each moving vertex takes the region of the control's nearest corner.
        face, weights = disk.lookup(f)
        carried = on_control[disk.faces[face, weights.argmax(1)]]
        total = areas_of(own) + areas_of(carried)
        both = areas_of(np.where(own == carried, own, -1))
        rows.append([2 * both.sum() / total.sum(), *(2 * both / total)])
    (before, after), *rest = np.transpose(rows).tolist()
    return {"before": before, "after": after, "regions": dict(zip(names, rest)), "of": count}


def report_of(pair, landmarks, weights, fit, points, regions):
    """The report of a registration, a dict for JSON, without method and seconds.

    landmarks: the pair's `SampledLandmarks`, whose `mobius_before` is the `_before` of everything;
    points (V, 3): the moving vertices on the control; regions: of `check_annotations`.
    """
    moving = pair.moving.surface
    features = pair.features
    rows = error_rows(pair, landmarks, fit.f)
    maps = landmarks.map_before, fit.f
    held_out = held_out_distances(pair, landmarks.held, *maps)
    overlap = dice(pair, regions, *maps)
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
        "dice": overlap,
        "suspect": [
            *reasons(moving, rows, fit),
            *feature_messages(pair, landmarks, fit.f),
            *worse(held_out, overlap),
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
    samples = pair.moving.disk.sampling(np.concatenate(moving))
    targets = curves_in_space(pair.control, control)
    images = [curves_in_space(pair.control, np.split(samples @ f, stops)) for f in maps]
    mm = size_of(pair.control.surface).mm
    return {
        name: [float(curve_distance(curve, target) / mm) for curve in curves]
        for name, target, curves in zip(lines, targets, zip(*images))
    }
