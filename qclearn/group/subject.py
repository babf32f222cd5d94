"""One subject of a group and the mean of all: laid upon it, registered to it, carried to it. What workers compute."""

from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from ..plane.beltrami import signed_areas
from ..plane.bijectivity import BijectivityError, check_bijective
from ..plane.diskmesh import Lookup, interpolate, locate
from ..plane.mobius import mobius
from ..registration.checked import bijective_fit
from ..registration.features import FOLDS, FeatureError, Features, Smoothing, standardised
from ..registration.hybrid import LEVELS
from ..registration.preparation import conformal, moved_disk
from ..registration.problem import Problem
from ..registration.search import SCALE, mobius_by_features
from ..registration.suspect import disagreeing, strong_distortion, switched_rows
from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Surface

SCALES = sorted({level.sigma for level in LEVELS if level.sigma} | {SCALE})  # of the features that are compared
COMPUTED = dict(zip(FOLDS, (sulcal_depth, mean_curvature)))


@dataclass(frozen=True, eq=False)
class Subject:
    """A surface in its disk map z (V,) with its features: values (V, C) as they are, levels: scale -> smoothed and
    standardised (V, C)."""

    surface: Surface
    z: np.ndarray
    names: list
    values: np.ndarray
    levels: dict
    words: list

    @property
    def areas(self):
        """The vertices' shares of the area."""
        return self.surface.vertex_areas / self.surface.area

    def at(self, sigma):
        return self.levels[sigma]


@dataclass(frozen=True, eq=False)
class Shared:
    """What a subject has at the vertices of the template's mesh, or many on average.

    points (N, 3): on its surface, turned and shifted onto the mean's; values, levels: of its features; areas (N,): of
    the vertices on it, in the square of its length.
    """

    points: np.ndarray
    values: np.ndarray
    levels: dict
    areas: np.ndarray


@dataclass(frozen=True, eq=False)
class Mean(Shared):
    """The mean of what subjects have, on a mesh of the disk (disk (N,), faces)."""

    disk: np.ndarray
    faces: np.ndarray

    def at(self, sigma):
        """The features' means at one scale, standardised (N, C)."""
        return standardised(self.levels[sigma], self.shares)

    @property
    def shares(self):
        return self.areas / self.areas.sum()

    @property
    def unit(self):
        """How long the disk's unit is at each vertex (N,), in the subjects' length: the root of the areas' ratio."""
        return np.sqrt(self.areas / vertex_areas(self.faces, signed_areas(self.disk, self.faces)))


class Against(Features):
    """The `Features` of one subject and the mean."""

    def __init__(self, subject, mean):
        self.names, self.shares = subject.names, np.full(len(subject.names), 1 / len(subject.names))
        self.sides, self.areas, self.faces = (subject, mean), subject.areas, mean.faces
        self.lookup = Lookup(mean.disk, mean.faces)


@dataclass(frozen=True, eq=False)
class Fitted:
    """The registration of one subject to the mean: its disk map f (V,), or None; reasons why it takes no part; words on
    what was done besides; r: feature -> correlation with the mean after it."""

    f: np.ndarray | None
    reasons: list = field(default_factory=list)
    words: list = field(default_factory=list)
    r: dict = field(default_factory=dict)


def prepared(surface, names, given):
    """The `Subject` of a surface in its own disk. given: feature -> values (V,), of those that are not computed."""
    columns = [given[name] if name in given else COMPUTED[name](surface) for name in names]
    values, (z, words) = np.stack(columns, axis=1), conformal(surface)
    smoothing = Smoothing(surface, values)
    return Subject(surface, z, names, values, {sigma: smoothing.at(sigma) for sigma in SCALES}, words)


def alone(subject):
    """A subject as the mean of itself, on its own mesh."""
    surface = subject.surface
    own = surface.vertices, subject.values, subject.levels, surface.vertex_areas
    return Mean(*own, subject.z, surface.faces)


def laid(subject, mean, near=False):
    """The subject with its disk laid upon the mean's by the Möbius map after which their features match best; near: by
    the nearest such map alone."""
    parameters = mobius_by_features(Against(subject, mean), subject.z, near)
    z, whole = moved_disk(subject.surface, subject.z, parameters)
    if not whole:
        raise FeatureError("the features pull its disk onto the rim; check that they are those of the others")
    return replace(subject, z=z)


def mirrored_gain(subject, mean):
    """By how much the features correlate better with the mean's, at SCALE, if the laid subject is mirrored first."""
    features, z = Against(subject, mean), subject.z.conj()
    other = mobius(z, *mobius_by_features(features, z))
    return float((features.correlation(other, SCALE) - features.correlation(subject.z, SCALE)).mean())


def at_disk(subject, z):
    """The subject with another disk map."""
    return replace(subject, z=z)


def fitted(subject, mean, weights):
    """`Fitted`: the registration of a laid subject to the mean, by features alone."""
    features = Against(subject, mean)
    problem = Problem(subject.z, subject.surface.faces, [], [], fewest=0)
    try:
        fit = bijective_fit(problem, weights, None, 0.0, features)
    except BijectivityError as error:
        return Fitted(None, [f"folds: {error}"])
    reasons = [
        *switched_rows(fit.fallbacks, len(subject.z)),
        *strong_distortion(subject.surface, fit.mu),
        *disagreeing(features, subject.z),
    ]
    return Fitted(fit.f, reasons, [*subject.words, *fit.fallbacks], {name: after for name, (_, after) in fit.r.items()})


def inverse(subject, f, points):
    """Where the disk map f (V,) of a subject takes points (N,) of the mean's disk back to in its own, (N,)."""
    return interpolate(subject.z, subject.surface.faces, *locate(f, subject.surface.faces, points))


def carried(subject, f, points, mean):
    """`Shared`: what a subject has where its disk map f (V,) takes it to points (N,) of the mean's disk."""
    places = locate(f, subject.surface.faces, points)

    def there(values):
        return interpolate(values, subject.surface.faces, *places)

    space = onto(there(subject.surface.vertices), mean.points, mean.areas)
    a, b, c = (space[corner] for corner in mean.faces.T)
    areas = vertex_areas(mean.faces, np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
    levels = {sigma: there(values) for sigma, values in subject.levels.items()}
    return Shared(space, there(subject.values), levels, areas)


def composed(subject, f, mean, centre):
    """The map f (V,) to the mean's disk taken on by the map that `centre` (N,) is of its vertices, mended where that
    folds: (f, whether it is a bijection, its inverse at the vertices (N,))."""
    loop = subject.surface.boundary
    f = interpolate(centre, mean.faces, *locate(mean.disk, mean.faces, f))
    f[loop] /= abs(f[loop])
    f, _ = moved_disk(subject.surface, f, (0j, 0.0))
    return f, check_bijective(subject.z, subject.surface.faces, f).bijective, inverse(subject, f, mean.disk)


def onto(points, target, weights):
    """Points (N, 3) turned and shifted so that `sum_k weights_k |points_k - target_k|^2` is least (Kabsch 1976)."""
    centre, there = (np.average(side, axis=0, weights=weights) for side in (points, target))
    left, _, right = np.linalg.svd(((points - centre) * weights[:, None]).T @ (target - there))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a turn, not a reflection
    return (points - centre) @ (left @ flip @ right) + there


def vertex_areas(faces, areas):
    """One third of the faces' areas (F,) around each vertex."""
    return np.bincount(faces.ravel(), weights=np.repeat(areas, 3)) / 3


def mean_of(shares, count, before):
    """The `Mean` of so many `Shared`, added up one at a time, on the mesh of the mean before."""
    total = reduce(added, shares)
    levels = {sigma: values / count for sigma, values in total.levels.items()}
    return Mean(total.points / count, total.values / count, levels, total.areas / count, before.disk, before.faces)


def added(one, other):
    """The sums of two `Shared`."""
    levels = {sigma: one.levels[sigma] + other.levels[sigma] for sigma in one.levels}
    return Shared(one.points + other.points, one.values + other.values, levels, one.areas + other.areas)
