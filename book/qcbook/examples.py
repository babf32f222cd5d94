"""Landmark problems that are small enough to be solved while a slider moves."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import MappingProxyType

import numpy as np

from qclearn.io.fsaverage import demo_landmarks, fsaverage5
from qclearn.plane.grids import FINE, joined, polar
from qclearn.registration.curves import check_curves, curves_of_both, fundus_metric, fundus_path, sample_curve
from qclearn.registration.features import FOLDS, Feature, Features, check_features, featured
from qclearn.registration.problem import Problem
from qclearn.registration.start import align
from qclearn.surfaces.conformal import ParameterizedSurface, parameterize
from qclearn.surfaces.curvature import AreaRadius, area_radius
from qclearn.surfaces.surface import Surface, mirror

# CP-Net is trained on this mesh. On another one the same mu gives another map: a large gamma would
# hide the gap.
MESH = polar(*FINE)


@dataclass(frozen=True)
class Example:
    """A named landmark problem on a small disk mesh; radius: spreads a crowded disk in pictures;
    features: of its surfaces, if it has some; mm: lengths on the control per unit of the disk, at the targets."""

    name: str
    problem: Problem
    radius: AreaRadius | None = None
    features: Features | None = None
    mm: np.ndarray | None = None

    @cached_property
    def sliding(self):
        """The problem with sliding landmarks."""
        return replace(self.problem, sliding=True)


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
    return Example(name, Problem(mesh, np.concatenate(moving), np.concatenate(target), labels), radius, features)


@dataclass(frozen=True)
class Courses:
    """Two cortical `ParameterizedSurface`s laid upon each other, and their common sulci: names, and
    paths, per side a list of vertex paths."""

    name: str
    moving: ParameterizedSurface
    control: ParameterizedSurface
    names: tuple
    paths: tuple

    def sample_landmarks(self, points):
        """Landmarks in the disk, `points` a curve: lists of (points,), moving and control."""
        return [
            [sample_curve(side.surface, path, points) @ side.disk.z for path in paths]
            for side, paths in zip((self.moving, self.control), self.paths)
        ]


def courses(name, moving, control, curves):
    """`Courses` on two surfaces; curves as in `register`, sulci between endpoints by `fundus_path`."""
    checked = check_curves(curves, moving, control)
    there = parameterize(control)
    here = align(parameterize(moving), there, checked)
    paths = [curves_between(surface, checked, side) for surface, side in ((moving, "moving"), (control, "control"))]
    return Courses(name, here, there, tuple(curve.name for curve in checked), paths)


def curves_between(surface, curves, side):
    """Vertex paths of `Curve`s on one side, "moving" or "control"; sulci between endpoints by `fundus_path`."""
    metric = fundus_metric(surface)
    ways = ((curve.path(side), curve.detect[side]) for curve in curves)
    return [fundus_path(surface, *path, metric) if detect else path for path, detect in ways]


def cortex_problem(name, moving, control, curves, vertices=None, points=5):
    """Landmarks, `points` a curve, and folds of two full cortical surfaces on a small disk mesh: an
    `Example`.

    curves as in `register`, sulci between endpoints by `fundus_path`. The mesh: the examples'
    graded polar one, or this number of vertices spread evenly over the moving surface, with
    Delaunay's faces in its disk.
    """
    return courses_problem(courses(name, moving, control, curves), vertices, points)


def courses_problem(pair, vertices=None, points=5):
    """`cortex_problem` of `Courses`."""
    surface, z = pair.moving.surface, pair.moving.disk.z
    mesh = MESH if vertices is None else joined(z[spread_vertices(surface, vertices)])
    found = _example(pair.name, mesh, *pair.sample_landmarks(points), area_radius(surface, z), folds_on(mesh, pair))
    faces, _ = pair.control.disk.locate(found.problem.target)
    return replace(found, mm=np.sqrt(pair.control.surface.face_areas[faces] / pair.control.disk.areas[faces]))


CORTICES = ("cortex", "first", "second")
SUBJECTS = MappingProxyType({"first": 1001, "second": 1002})  # seeds; of the cohort, which no network has seen


@cache
def cortices(name):
    """`Courses`: "cortex", fsaverage5's mirrored right side to its left; "first", "second":
    synthetic, to CONTROL."""
    if name == "cortex":
        sides = mirror(fsaverage5("right")), fsaverage5("left")
        return courses("sulci of fsaverage5", *sides, demo_landmarks())
    from qclearn.benchmark.pairs import CONTROL, hemispheres  # here: they bring the synthetic surfaces, an extra

    sides = [subject.surface for subject in hemispheres([SUBJECTS[name], CONTROL], progress=False)]
    return courses(f"a synthetic subject, seed {SUBJECTS[name]}", *sides, curves_of_both(*sides))


def folds_on(mesh, pair):
    """`Features` depth and curvature of `Courses`, the moving ones on a small `Disk` inside theirs."""
    disk, places = pair.moving.disk, pair.moving.disk.locate(mesh.z)
    whole = check_features(FOLDS, pair.moving.surface, pair.control.surface)
    small = ParameterizedSurface(Surface(disk.interpolate(pair.moving.surface.vertices, places), mesh.faces), mesh)
    maps = [Feature(one.name, disk.interpolate(one.moving, places), one.control) for one in whole]
    return featured(small, pair.control, maps)[2]


def spread_vertices(surface, count):
    """Indices (count,) of vertices spread evenly in space: every other boundary vertex, then always
    the farthest."""
    chosen = list(surface.boundary[::2])
    distance = np.full(len(surface.vertices), np.inf)
    for place in range(count):
        if place == len(chosen):
            chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((surface.vertices - surface.vertices[chosen[place]]) ** 2).sum(1))
    return np.array(chosen)
