"""Annotations of both sides, regions by name: how well the moving side's own and the control's,
carried over, agree."""

from importlib.metadata import version

import numpy as np

from ..plane.mobius import best_mobius, mobius
from ..surfaces.checks import degenerate_faces
from ..surfaces.surface import SurfaceError
from .curves import POINTS_PER_CURVE, curve_distance, curves_in_space, sample_curve
from .diagnose import FEWEST, disagreeing, laid_by_folds, reasons, worse
from .metrics import (
    coefficient_statistics,
    curve_rows,
    distortion_quantiles,
    log2_distortions,
    mean_rows,
)
from .pair import sample_curves

NAMELESS = ("", "???", "unknown")  # regions that are none
SIDES = ("moving", "control")


def check_annotations(annotations, *surfaces):
    """Both sides' regions as numbers (V,) and (W,), -1 for those that are not on both, and their
    names (R,); None where there are no annotations. SurfaceError where counts do not fit, or no
    region is on both sides."""
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
    return *numbers, shared.tolist()


def of_vertices(side, names, surface):
    """The names of regions of a surface's vertices (V,), also from those of the whole surface that
    it was cut from."""
    names, count, table = np.asarray(names), len(surface.vertices), surface.original_vertices
    if names.dtype.kind != "U" or names.ndim != 1:
        raise SurfaceError(
            f"annotation, {side} side: {names.dtype} {names.shape}; give the name of each "
            "vertex's region"
        )
    if len(names) == count:
        return names
    if (
        table is not None and table.max() < len(names) <= 2 * count
    ):  # no more than half of a surface is cut away
        return names[table]
    raise SurfaceError(
        f"annotation, {side} side: {len(names)} regions for {count} vertices; give one a vertex "
        "of the surface as it "
        "is registered, or of the whole one if its npz has original_vertices"
    )


def dice(sides, regions, *maps):
    """Dice's coefficients of two `SurfacePair` and regions of `check_annotations` after a first and
    a last disk map (V,).

    `2 |A n B| / (|A| + |B|)`, |.| the moving surface's area, A a region of the moving side and B
    the control's of that name where the map takes its vertices: `{"before", "after"}`, the mean
    weighted by |A| + |B|, and `"regions"`: name -> [before, after]. Empty where there are none.
    Source: Dice 1945.
    """
    if regions is None:
        return {}
    own, there, names = regions
    areas, disk = sides.moving.surface.vertex_areas, sides.control.disk
    rows = []
    for f in maps:
        face, weights = disk.lookup(f)
        carried = there[disk.faces[face, weights.argmax(1)]]
        one, other, both = (
            np.bincount(found[found >= 0], areas[found >= 0], len(names))
            for found in (own, carried, np.where(own == carried, own, -1))
        )
        rows.append([2 * both.sum() / (one + other).sum(), *(2 * both / (one + other))])
    (before, after), *rest = np.transpose(rows).tolist()
    return {"before": before, "after": after, "regions": dict(zip(names, rest))}


ERRORS = (
    "landmark_error_before",
    "landmark_error",
    "landmark_error_mm",
)  # null where no landmark was given


def report_of(sides, landmarks, weights, fit, points, regions=None):
    """The report of a registration, a dict for JSON, without method and seconds; regions: of
    `check_annotations`."""
    rows, features, moving = (
        error_rows(sides, landmarks.samples, fit.f),
        sides.features,
        sides.moving.surface,
    )
    plain = mobius(sides.moving.disk.z, *landmarks.problem.mobius)
    held_out, overlap = held_out_distances(sides, plain, fit.f), dice(sides, regions, plain, fit.f)
    against = unlike(sides, plain) if features else []
    return {
        **dict.fromkeys(ERRORS),
        **mean_rows(rows),
        **coefficient_statistics(fit.mu),
        **log2_distortions(moving, points),
        "distortion": distortion_quantiles(moving, points),
        "flipped": len(fit.flipped),
        "bijective": fit.bijective,
        "degenerate": len(degenerate_faces(points, moving.faces)),
        "fallbacks": [*sides.words, *landmarks.words, *fit.fallbacks],
        "alpha": weights.alpha,
        "beta": weights.beta,
        "gamma": weights.gamma,
        "delta": weights.delta,
        "eta": weights.eta,
        "features": dict(zip(features.names, features.shares.tolist())) if features else {},
        "r": fit.r if features else {},
        "start": fit.start if features else "",
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": rows,
        "held_out_mm": held_out,
        "dice": overlap,
        "suspect": [*reasons(moving, rows, fit), *against, *worse(held_out, overlap)],
        "stopped": None,
        "version": version("qclearn"),
    }


def unlike(sides, plain):
    """`features:`, if anything, after a Möbius map `plain` (V,) of the landmarks; so few that they
    do not determine it make way for the features' own."""
    found = [*disagreeing(sides.features, plain)]
    if found and 0 < len(sides.entries) < FEWEST:
        found = [*disagreeing(sides.features, laid_by_folds(sides).moving.disk.z)]
    return found


def error_rows(sides, samples, f):
    """`curve_rows` of the map f (V,) and the landmarks `samples` of both sides, sparse (10 K, V)
    each; for a detected curve also `landmark_error_true`, between the true curves, where the
    surfaces carry them."""
    moving, control, entries = sides.moving, sides.control, sides.entries
    if not entries:
        return []
    p, mapped, q = samples[0] @ moving.disk.z, samples[0] @ f, samples[1] @ control.disk.z
    off = np.linalg.norm(control.lift(mapped) - samples[1] @ control.surface.vertices, axis=1)
    before = abs(mobius(p, *best_mobius(p, q)) - q)
    rows = curve_rows([entry["name"] for entry in entries], before, abs(mapped - q), off)
    for row, entry in zip(rows, entries):
        paths = (
            true_path(moving.surface, entry, "moving"),
            true_path(control.surface, entry, "control"),
        )
        if any(entry["detect"].values()) and all(path is not None for path in paths):
            true_p = sample_curve(moving.surface, paths[0], POINTS_PER_CURVE) @ f
            true_q = sample_curve(control.surface, paths[1], POINTS_PER_CURVE) @ control.disk.z
            row["landmark_error_true"] = float(abs(true_p - true_q).mean())
    return rows


def true_path(surface, entry, side):
    """The vertex path of a curve as given, or as the surface carries it between the given
    endpoints, else None."""
    given, known = entry[side], surface.curves.get(entry["name"])
    if not entry["detect"][side]:
        return given
    if known is None or sorted(known[[0, -1]]) != sorted(given):
        return None
    return known if known[0] == given[0] else known[::-1]


def held_out_distances(sides, *maps):
    """Held-out curve -> `curve_distance` between its image by each of the maps (V,) and itself on
    the control."""
    if not sides.held:
        return {}
    lines_moving = sample_curves(sides.moving, sides.held, "moving")[1]
    lines_control = sample_curves(sides.control, sides.held, "control")[1]
    stops = np.cumsum([len(line) for line in lines_moving])[:-1]
    samples = sides.moving.disk.sampling(np.concatenate(lines_moving))
    wanted = curves_in_space(sides.control, lines_control)
    found = [curves_in_space(sides.control, np.split(samples @ f, stops)) for f in maps]
    distances = [[float(curve_distance(*pair)) for pair in zip(curves, wanted)] for curves in found]
    return {entry["name"]: list(row) for entry, row in zip(sides.held, zip(*distances))}
