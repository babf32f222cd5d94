"""What a finished map carries from one surface to the other: points, values, and the errors of their curves."""

import numpy as np
from jaxtyping import Bool, Complex, Integer, Num
from numpy import ndarray

from ..plane.diskmesh import interpolate, locate
from ..plane.mobius import best_mobius, mobius
from .landmarks import POINTS_PER_CURVE, sample_curve
from .metrics import curve_rows


def lift(surface, z, points):
    """Points (P, 3) on the surface whose images in its disk map z are `points` (P,) complex."""
    return interpolate(surface.vertices, surface.faces, *locate(z, surface.faces, points))


def transfer(
    values: Num[ndarray, " V *k"] | Bool[ndarray, " V *k"],
    z_from: Complex[ndarray, " V"],
    faces_from: Integer[ndarray, " F 3"],
    z_to: Complex[ndarray, " P"],
    nearest: bool = False,
) -> Num[ndarray, " P *k"] | Bool[ndarray, " P *k"]:
    """Per-vertex values of one disk mesh carried to the points z_to of the same disk.

    From control to moving: `transfer(values, disk_control, faces_control, disk_map)`; back:
    `transfer(values, disk_map, faces_moving, disk_control)`. Linear in each triangle, or with `nearest` the value of
    the corner with the largest weight (for labels). ValueError if the count of values is not that of the vertices.
    """
    values = np.asarray(values)
    if len(values) != len(z_from):
        raise ValueError(
            f"{len(values)} values for {len(z_from)} vertices: give one a vertex of the surface they "
            "come from (the cut-open one, if it was cut)"
        )
    face, weights = locate(z_from, faces_from, z_to)
    if nearest:
        return values[np.asarray(faces_from)[face, weights.argmax(1)]]
    return interpolate(values, faces_from, face, weights)


def error_rows(moving, control, z_moving, z_control, entries, samples, f):
    """Per curve its landmark errors; for a detected one also between the true curves, where the surfaces carry them.

    samples: the landmarks of the moving and of the control surface, sparse (10 K, V) each; f (V,): the map.
    `landmark_error_true` is the error of the map between points on the true curves, which took no part in finding it.
    """
    p, mapped, q = samples[0] @ z_moving, samples[0] @ f, samples[1] @ z_control
    off = np.linalg.norm(lift(control, z_control, mapped) - samples[1] @ control.vertices, axis=1)
    before = abs(mobius(p, *best_mobius(p, q)) - q)
    rows = curve_rows([entry["name"] for entry in entries], before, abs(mapped - q), off)
    for row, entry in zip(rows, entries):
        paths = true_path(moving, entry, "moving"), true_path(control, entry, "control")
        if any(entry["detect"].values()) and all(path is not None for path in paths):
            true_p, true_q = (
                sample_curve(surface, path, POINTS_PER_CURVE) for surface, path in zip((moving, control), paths)
            )
            row["landmark_error_true"] = float(abs(true_p @ f - true_q @ z_control).mean())
    return rows


def true_path(surface, entry, side):
    """The vertex path of a curve as given, or as the surface carries it between the given endpoints, else None."""
    given, known = entry[side], surface.curves.get(entry["name"])
    if not entry["detect"][side]:
        return given
    if known is None or sorted(known[[0, -1]]) != sorted(given):
        return None
    return known if known[0] == given[0] else known[::-1]
