"""Landmark problems that are small enough to be solved while a slider moves."""

import warnings
from dataclasses import dataclass, replace
from functools import cache, cached_property
from types import MappingProxyType

import numpy as np
from scipy.spatial import Delaunay

from ..files.fsaverage import demo_landmarks, fsaverage5
from ..plane.beltrami import signed_areas
from ..plane.bijectivity import RepairWarning
from ..plane.diskmesh import interpolate, locate, polar_disk
from ..plane.spectrum import FINE, POWER
from ..registration.features import FOLDS, Feature, Features, check_features
from ..registration.landmarkfile import check_curves
from ..registration.landmarks import curves_of_both, fundus_metric, fundus_path, sample_curve
from ..registration.preparation import align
from ..registration.problem import Problem
from ..surfaces.conformal import disk_conformal_map
from ..surfaces.curvature import AreaRadius, area_radius
from ..surfaces.surface import Surface, mirror

# CP-Net is trained for maps on this mesh. On another one the same mu gives another map: at a large gamma that
# would hide how far the network is from the fit.
MESH = polar_disk(*FINE, POWER)


@dataclass(frozen=True)
class Example:
    """A landmark problem on a small disk mesh and its name; radius: to draw it with where the disk would crowd it;
    features: of the surfaces that it was taken from, if there are any."""

    name: str
    problem: Problem
    radius: AreaRadius | None = None
    features: Features | None = None

    @cached_property
    def sliding(self):
        """The problem with landmarks that slide along their curves."""
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
    return Example(name, Problem(*mesh, np.concatenate(moving), np.concatenate(target), labels), radius, features)


@dataclass(frozen=True)
class Paired:
    """Two cortical surfaces with their disk maps laid upon each other, and the courses of the sulci that both have.

    moving, control: `Surface`, with z_moving, z_control (V,) complex, the moving one after the best Möbius map of what
    is given; names: of the curves; paths: for the moving and for the control side a list of vertex paths.
    """

    name: str
    moving: Surface
    control: Surface
    z_moving: np.ndarray
    z_control: np.ndarray
    names: tuple
    paths: tuple

    def sampled(self, points):
        """The landmarks in the disk, `points` a curve: for the moving and for the control side a list of (points,)."""
        sides = (self.moving, self.z_moving), (self.control, self.z_control)
        return [
            [sample_curve(surface, path, points) @ z for path in paths]
            for (surface, z), paths in zip(sides, self.paths)
        ]


def paired(name, moving, control, curves):
    """Two surfaces as a `Paired`; curves as in `register`, sulci between endpoints by `fundus_path`."""
    entries = check_curves(curves, moving, control)
    z_control = disk_conformal_map(control)
    z_moving = align(moving, disk_conformal_map(moving), control, z_control, entries)
    paths = []
    for surface, side in ((moving, "moving"), (control, "control")):
        metric = fundus_metric(surface)
        paths.append(
            [fundus_path(surface, *entry[side], metric) if entry["detect"][side] else entry[side] for entry in entries]
        )
    names = tuple(entry["name"] for entry in entries)
    return Paired(name, moving, control, z_moving, z_control, names, tuple(paths))


def cortex_problem(name, moving, control, curves, vertices=None, points=5):
    """The landmarks and folds of two cortical surfaces, `points` a curve, on a small disk mesh: an `Example`.

    curves as in `register`, sulci between endpoints by `fundus_path`; the landmarks come from the full surfaces, as do
    depth and curvature. The mesh: the graded polar one of the examples; or, given their number, vertices spread evenly
    over the moving surface, joined at their places in its disk (Delaunay).
    """
    return paired_problem(paired(name, moving, control, curves), vertices, points)


def paired_problem(pair, vertices=None, points=5):
    """`cortex_problem` of surfaces that are `Paired`."""
    mesh = MESH if vertices is None else joined(pair.z_moving[spread_vertices(pair.moving, vertices)])
    features = folds_on(mesh, pair.moving, pair.z_moving, pair.control, pair.z_control)
    return _example(pair.name, mesh, *pair.sampled(points), area_radius(pair.moving, pair.z_moving), features)


CORTICES = ("cortex", "first", "second")
SUBJECTS = MappingProxyType({"first": 1001, "second": 1002})  # seeds; of the cohort, which no network has seen


@cache
def cortices(name):
    """The `Paired` cortices of a name: "cortex", fsaverage5's right side, mirrored, and its left one; "first" and
    "second", two synthetic subjects and the benchmark's control."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)  # boundary steps at the ragged rim
        if name == "cortex":
            sides = mirror(fsaverage5("right")), fsaverage5("left")
            return paired("sulci of fsaverage5", *sides, demo_landmarks())
        from ..benchmark.pairs import CONTROL, hemispheres  # here: they bring the synthetic surfaces, an extra

        sides = [subject.surface for subject in hemispheres([SUBJECTS[name], CONTROL], progress=False)]
        return paired(f"a synthetic subject, seed {SUBJECTS[name]}", *sides, curves_of_both(*sides))


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
