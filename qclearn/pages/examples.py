"""Landmark problems that are small enough to be solved while a slider moves."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from ..plane.beltrami import signed_areas
from ..plane.diskmesh import interpolate, locate, polar_disk
from ..registration.features import FOLDS, Feature, Features, check_features
from ..registration.fit import POWER
from ..registration.landmarkfile import check_curves
from ..registration.landmarks import fundus_metric, fundus_path, sample_curve
from ..registration.preparation import align
from ..registration.problem import Problem
from ..surfaces.conformal import disk_conformal_map
from ..surfaces.curvature import AreaRadius, area_radius
from ..surfaces.surface import Surface

# CP-Net is trained for maps on this mesh. On another one the same mu gives another map: at a large gamma that
# would hide how far the network is from the fit.
MESH = polar_disk(32, 96, POWER)


@dataclass(frozen=True)
class Example:
    """A landmark problem on a small disk mesh and its name; radius: to draw it with where the disk would crowd it;
    features: of the surfaces that it was taken from, if there are any."""

    name: str
    problem: Problem
    radius: AreaRadius | None = None
    features: Features | None = None


def example_problems():
    """Three problems on a graded polar mesh of 3,073 vertices: list of `Example`."""
    t = np.linspace(-1, 1, 9)
    three = [0.55 + 0.25j * t, -0.35 + 0.35j + 0.2 * t * np.exp(0.7j), -0.1 - 0.5j + 0.3 * t]
    two = [0.25j + 0.55 * t, -0.25j + 0.55 * t]
    close = [0.08j + 0.4 * t, -0.08j + 0.4 * t]
    shift = 0.35 * (1 - t**2) * 0.55
    return [
        _example("a smooth twist", MESH, three, [p * np.exp(0.9j * (1 - abs(p) ** 2)) for p in three]),
        _example("points spaced anew along two curves", MESH, two, [two[0] + shift, two[1] - shift]),
        _example("two neighbours pulled apart", MESH, close, [close[0] + 0.25, close[1] - 0.25]),
    ]


def _example(name, mesh, moving, target, radius=None, features=None):
    labels = np.repeat(np.arange(len(moving)), [len(curve) for curve in moving])
    return Example(name, Problem(*mesh, np.concatenate(moving), np.concatenate(target), labels), radius, features)


def cortex_problem(name, moving, control, curves, vertices=None, points=5):
    """The landmarks and folds of two cortical surfaces, `points` a curve, on a small disk mesh: an `Example`.

    curves as in `register`, sulci between endpoints by `fundus_path`; the landmarks come from the full surfaces, as do
    depth and curvature. The mesh: the graded polar one of the examples; or, given their number, vertices spread evenly
    over the moving surface, joined at their places in its disk (Delaunay).
    """
    entries = check_curves(curves, moving, control)
    z_moving, z_control = disk_conformal_map(moving), disk_conformal_map(control)
    z_moving = align(moving, z_moving, control, z_control, entries)
    landmarks = []
    for surface, z, side in ((moving, z_moving, "moving"), (control, z_control, "control")):
        metric = fundus_metric(surface)
        paths = [
            fundus_path(surface, *entry[side], metric) if entry["detect"][side] else entry[side] for entry in entries
        ]
        landmarks.append([sample_curve(surface, path, points) @ z for path in paths])
    mesh = MESH if vertices is None else joined(z_moving[spread_vertices(moving, vertices)])
    features = folds_on(mesh, moving, z_moving, control, z_control)
    return _example(name, mesh, *landmarks, area_radius(moving, z_moving), features)


def folds_on(mesh, moving, z_moving, control, z_control):
    """Depth and curvature of two surfaces, the moving ones on a small mesh (z, faces) of its disk: `Features`."""
    places, whole = locate(z_moving, moving.faces, mesh[0]), check_features(FOLDS, moving, control)
    small = Surface(interpolate(moving.vertices, moving.faces, *places), mesh[1])
    maps = [Feature(one.name, interpolate(one.moving, moving.faces, *places), one.control) for one in whole]
    return Features(small, control, z_control, maps)


def joined(z):
    """Points z (V,) of the disk and the triangles (F, 3) of Delaunay that join them."""
    faces = Delaunay(np.stack([z.real, z.imag], axis=1)).simplices.astype(np.int64)
    return z, np.where((signed_areas(z, faces) < 0)[:, None], faces[:, ::-1], faces)


def spread_vertices(surface, count):
    """Indices (count,) of vertices spread evenly in space: every other boundary vertex, then always the farthest."""
    chosen = list(surface.boundary[::2])
    distance = np.full(len(surface.vertices), np.inf)
    for place in range(count):
        if place == len(chosen):
            chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((surface.vertices - surface.vertices[chosen[place]]) ** 2).sum(1))
    return np.array(chosen)
