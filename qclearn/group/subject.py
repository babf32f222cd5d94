"""What workers compute: a subject aligned with the mean, registered to it and carried to it."""

from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from ..plane.bijectivity import BijectivityError
from ..plane.disk import Disk
from ..plane.linear import around_vertices, face_areas
from ..registration.diagnose import disagreeing, reasons
from ..registration.features import (
    COMPUTED,
    SCALE,
    FeatureError,
    Features,
    Smoothing,
    align_by_features,
    mobius_by_features,
    standardised,
)
from ..registration.fit import fit_with_fallbacks
from ..registration.multiresolution import LEVELS
from ..registration.problem import Problem
from ..surfaces.conformal import apply_mobius, parameterize, repair_folds

# Of the features that are compared.
SCALES = sorted({level.sigma for level in LEVELS if level.sigma} | {SCALE})


@dataclass(frozen=True, eq=False)
class Shared:
    """What a subject, or the average of many, has at the vertices of the template's mesh.

    points (N, 3): on its surface, turned and shifted onto the mean's; values (N, C), levels: of its
    features; areas (N,): of the vertices on its surface.
    """

    points: np.ndarray
    values: np.ndarray
    levels: dict
    areas: np.ndarray


@dataclass(frozen=True, eq=False)
class Mean(Shared):
    """The subjects' mean on a mesh of the disk: what `Features` compare them with."""

    disk: Disk

    @property
    def smoothing(self):
        """Itself in a `Smoothing`'s place: its `at` has the features of all its scales."""
        return self

    def at(self, sigma):
        """The features' means at one scale, standardised (N, C)."""
        return standardised(self.levels[sigma], self.vertex_shares)

    @property
    def vertex_shares(self):
        """The vertices' shares of the area (N,)."""
        return self.areas / self.areas.sum()

    @property
    def variance(self):
        """Variance of each feature's mean over the area, (C,)."""
        return self.vertex_shares @ (self.values - self.vertex_shares @ self.values) ** 2

    @property
    def unit(self):
        """Length of the disk's unit at each vertex (N,), in the surfaces' unit: the root of the
        areas' ratio."""
        return np.sqrt(self.areas / (around_vertices(self.disk.areas, self.disk.faces) / 3))


@dataclass(frozen=True, eq=False)
class Fitted:
    """A subject's registration: its disk map f (V,), or None where there is none.

    reasons: to leave it out; messages: of repairs; r: feature -> correlation.
    """

    f: np.ndarray | None
    reasons: list = field(default_factory=list)
    messages: list = field(default_factory=list)
    r: dict = field(default_factory=dict)


def prepared(surface, names, given):
    """The subject of a surface: a `ParameterizedSurface` with features; given: name -> values (V,)
    of those not computed."""
    columns = [given[name] if name in given else COMPUTED[name](surface) for name in names]
    smoothing = Smoothing(surface, names, np.stack(columns, axis=1))
    for sigma in SCALES:
        smoothing.at(sigma)
    return replace(parameterize(surface), smoothing=smoothing)


def alone(subject):
    """A subject as the mean of itself, on its own mesh."""
    own, surface = subject.smoothing, subject.surface
    return Mean(surface.vertices, own.values, own.levels, surface.vertex_areas, subject.disk)


def aligned(subject, mean, near=False):
    """The subject after the Möbius map that matches its features to the mean's best.

    near: a local search. FeatureError where that map pulls the disk onto its boundary.
    """
    best = mobius_by_features(Features(subject, mean), subject.disk.z, near)
    moved = apply_mobius(subject, best)
    if not moved.is_embedded:
        raise FeatureError(
            "the features pull its disk onto the rim; check that they are those of the others"
        )
    return moved


def at_disk(subject, z):
    """The subject with another disk map z (V,)."""
    return replace(subject, disk=subject.disk.at(z))


def fitted(subject, mean, weights):
    """Register an aligned subject to the mean by features alone: `Fitted`."""
    features = Features(subject, mean)
    surface = subject.surface
    problem = Problem(subject.disk, [], [], fewest=0)
    try:
        fit = fit_with_fallbacks(problem, weights, None, 0.0, features)
    except BijectivityError as error:
        return Fitted(None, [f"folds: {error}"])
    suspect = [*reasons(surface, [], fit), *disagreeing(features, subject.disk.z, fit.f)]
    r = {name: after for name, (_, after) in fit.r.items()}
    return Fitted(fit.f, suspect, [*subject.messages, *fit.fallbacks], r)


def mirrored_gain(moving, control):
    """Increase of the features' mean correlation at SCALE when a moving `ParameterizedSurface`,
    aligned by features with the control's or a group's mean, is mirrored and aligned anew.
    Positive: it belongs to the other hemisphere."""
    features, z = Features(moving, control), moving.disk.z
    mirrored = align_by_features(features, z.conj())
    gain = features.correlation(mirrored, SCALE) - features.correlation(z, SCALE)
    return float(gain.mean())


def inverse(subject, f, points):
    """The inverse (N,) of a subject's disk map f (V,) at points (N,) of the mean's disk."""
    image = subject.disk.at(f)
    return image.interpolate(subject.disk.z, image.locate(points))


def carried(subject, f, points, mean):
    """`Shared` of a subject where its disk map f (V,) reaches points (N,) of the mean's disk."""
    image = subject.disk.at(f)
    places = image.locate(points)
    space = onto(image.interpolate(subject.surface.vertices, places), mean.points, mean.areas)
    areas = around_vertices(face_areas(space, mean.disk.faces), mean.disk.faces) / 3
    own = subject.smoothing
    levels = {sigma: image.interpolate(own.at(sigma), places) for sigma in SCALES}
    values = image.interpolate(own.values, places)
    return Shared(space, values, levels, areas)


def composed(subject, f, mean, centre):
    """f (V,) followed by centre (N,), repaired where that folds: (map, is bijective, inverse)."""
    f = repair_folds(subject.surface, mean.disk.interpolate(centre, mean.disk.locate(f))).z
    return f, subject.disk.certify(f).bijective, inverse(subject, f, mean.disk.z)


def onto(points, target, weights):
    """Points (N, 3) rotated and shifted to the least `sum_k weights_k |points_k - target_k|^2`.

    Source: Kabsch (1976).
    """
    centre, there = (np.average(side, axis=0, weights=weights) for side in (points, target))
    left, _, right = np.linalg.svd(((points - centre) * weights[:, None]).T @ (target - there))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])  # a turn, not a reflection
    return (points - centre) @ (left @ flip @ right) + there


def mean_of(shares, count, before):
    """The `Mean` of `count` `Shared`, added up one at a time, on the mesh of the mean before."""
    total = reduce(added, shares)
    levels = {sigma: values / count for sigma, values in total.levels.items()}
    points, values, areas = (x / count for x in (total.points, total.values, total.areas))
    return Mean(points, values, levels, areas, before.disk)


def added(one, other):
    """The sums of two `Shared`."""
    levels = {sigma: one.levels[sigma] + other.levels[sigma] for sigma in one.levels}
    points = one.points + other.points
    return Shared(points, one.values + other.values, levels, one.areas + other.areas)
