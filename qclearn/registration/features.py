"""Features: per-vertex values that a registration compares, and Möbius maps that lay them on each
other.

`Smoothing` holds those of one surface at any scale, standardised, and its density (its area over
that of its disk); `Features` compares two. `mobius_by_features` aligns disks by features alone;
`check_features` reads what a call was given.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from ..plane.checks import unmasked
from ..plane.grids import thinned
from ..plane.linear import LARGE, around_vertices, heat_flow
from ..plane.mobius import centring_mobius, compose_mobius, descend, mobius, mobius_fields
from ..surfaces.curvature import curvature_potential, mean_curvature, sulcal_depth
from ..surfaces.surface import SurfaceError
from .problem import is_finite

COMPUTED = {"depth": sulcal_depth, "curvature": mean_curvature, "potential": curvature_potential}
FOLDS = tuple(COMPUTED)  # the features that a surface has by itself
FINEST = 4.0  # mm, the scale at which features are compared in reports

# Smoothing. Standard deviations to which a map is clipped, before and after it is smoothed, and
# the share of the vertices at either end that does not count in these.
OUTLIERS = 2.5
SMOOTH_OUTLIERS = 3.0
TAIL = 0.01
HEAT_STEPS = 4  # implicit steps of the heat flow to one scale
COARSE_VERTICES = 12_000  # of a large surface, on which coarser scales are smoothed
# What a fit compares. People's folds differ in depth and in strength from region to region: up to
# the scale LOCAL, mm, folds count by the mean and the deviation of their surroundings, NEIGHBOURHOOD
# mm wide, with LEAST_VARIANCE of the whole where these have none. Above it the potential of
# curvature takes one of SHARES of the depth's weight: the first, or of a fit without landmarks any.
LOCAL, NEIGHBOURHOOD, LEAST_VARIANCE = 8.0, 30.0, 0.05
SHARES = 0.5, 0.0, 1.0
# mm^2, of a surface on which a scale is in mm; on others in proportion, whatever their unit.
HEMISPHERE = 9e4

# Möbius maps by features alone.
SCALE = 16.0  # mm, of the features that are compared
# The maps to begin with: how many angles, and which points they send to 0, by radii and directions;
# how many of them are refined. Places in space are smooth and lead from afar.
FOLDED = (24, (0.25, 0.5), 8, 6)
PLACED = (12, (0.35,), 6, 2)
# Vertices that judge these maps, and those that the best are refined by.
SCOUTS = 300
POINTS = 1500
ROUNDS = 15  # of refinement, at most


class Smoothing:
    """Named per-vertex values (V, C) of one surface at any scale sigma: the standard deviation of
    the smoothing kernel, in mm on a surface with the area of a HEMISPHERE; with its `Disk`, if
    known, also the density there.

    Scales above FINEST are smoothed on a coarse mesh of the disk of a large surface.
    """

    def __init__(self, surface, names, values, disk=None):
        self.names, self.values, self.disk = names, values, disk
        self.mass, self.stiffness = sparse.diags_array(surface.vertex_areas), surface.stiffness
        self.areas = surface.vertex_areas / surface.area
        self.unit = np.sqrt(surface.area / HEMISPHERE)
        self.flows = {}

    def at(self, sigma):
        """The smoothed values (V, C), outliers clipped, standardised."""
        values = self.smoothed(sigma)[:, : len(self.names)]
        return standardised(clipped(values, self.areas, SMOOTH_OUTLIERS), self.areas)

    def compared(self, sigma):
        """What a fit compares at a scale (V, C): `at`, or up to the scale LOCAL for FOLDS `(v -
        mean) / sqrt(variance + LEAST_VARIANCE)`, both of their surroundings; cached."""
        if ("compared", sigma) not in self.flows:
            values, folds = self.at(sigma), [name in FOLDS for name in self.names]
            if sigma <= LOCAL and any(folds):
                own = values[:, folds]
                around = self.flow(NEIGHBOURHOOD, self.mass @ np.hstack([own, own**2]))
                mean, square = np.split(around, 2, axis=1)
                variance = np.maximum(square - mean**2, 0) + LEAST_VARIANCE
                values[:, folds] = (own - mean) / np.sqrt(variance)
                values = standardised(clipped(values, self.areas, SMOOTH_OUTLIERS), self.areas)
            self.flows["compared", sigma] = values
        return self.flows["compared", sigma]

    def density(self, sigma, disk):
        """log of the share of the surface's area over that of the disk's (V,), smoothed, on any of
        its `Disk`s.

        Two disk maps of one surface differ by a smooth factor, the slope of a Möbius map. It is
        added after the smoothing.
        """
        density = self.smoothed(sigma)[:, -1] + log_density(self.areas, disk)
        return density - log_density(self.areas, self.disk)

    def smoothed(self, sigma):
        """The values (V, C), and with a disk the density as one column more, after the heat flow `A
        u' = -K u` for the time sigma^2 / 2; cached."""
        if sigma not in self.flows:
            largest = abs(self.values).max(0)  # so that squares neither vanish nor overflow
            columns = [clipped(self.values / largest, self.areas, OUTLIERS)]
            if self.disk is not None:
                columns.append(log_density(self.areas, self.disk)[:, None])
            self.flows[sigma] = self.flow(sigma, self.mass @ np.hstack(columns))
        return self.flows[sigma]

    def flow(self, sigma, load):
        """The heat flow of values (V, K), given by their load `A u`."""
        time = (self.unit * sigma) ** 2 / (2 * HEAT_STEPS)
        if self.few(sigma)[1] is None:
            return heat_flow(self.mass, time * self.stiffness, load, HEAT_STEPS)
        _, spread, mass, stiffness = self.coarse
        return spread @ heat_flow(mass, time * stiffness, spread.T @ load, HEAT_STEPS)

    def few(self, sigma):
        """Vertices (N,) that suffice at a scale, and the matrix (V, N) that spreads their values to
        all vertices; all of them, and None, unless the surface is large and the scale coarse."""
        if self.disk is None or len(self.areas) <= LARGE or sigma <= FINEST:
            return np.arange(len(self.areas)), None
        return self.coarse[:2]

    @cached_property
    def coarse(self):
        """Functions linear on the triangles of few vertices: their numbers (N,), (V, N) to values
        at all, mass and stiffness."""
        some, mesh = thinned(self.disk, self.areas, COARSE_VERTICES)
        spread = mesh.interpolation(self.disk.z)
        held = spread.sum(0) > 0  # a point on the rim may be in no triangle
        some, spread = some[held], spread[:, held]
        return some, spread, spread.T @ self.mass @ spread, spread.T @ self.stiffness @ spread


def log_density(areas, disk):
    """log of the vertices' shares of the surface's area (V,) over their shares of the `Disk`'s."""
    around = around_vertices(disk.areas, disk.faces)
    return np.log(areas) - np.log(around / around.sum())


def standardised(values, areas):
    """Values (V, C) with mean 0 and variance 1 over shares of the area (V,); 0 where they are
    constant."""
    values = values - areas @ values
    deviation = np.sqrt(areas @ values**2)
    return np.divide(values, deviation, out=np.zeros_like(values), where=deviation > 0)


def clipped(values, areas, limit):
    """Values (V, C) cut to `limit` standard deviations from the mean, both over the area of all but
    the TAIL."""
    core = np.clip(values, *np.quantile(values, [TAIL, 1 - TAIL], axis=0))
    mean = areas @ core
    reach = limit * np.sqrt(areas @ (core - mean) ** 2)
    return np.clip(values, mean - reach, mean + reach)


class FeatureError(SurfaceError):
    """A per-vertex map that cannot lead a registration: which, on which side, and what to do."""


@dataclass(frozen=True, eq=False)
class Feature:
    """A per-vertex map of both sides, moving (V,) and control (W,), and its weight among the
    features."""

    name: str
    moving: np.ndarray
    control: np.ndarray
    weight: float = 1.0


class Features:
    """The features of a moving `ParameterizedSurface` compared with those of a control.

    names (C,); feature_weights (C,): of sum 1, by which a start weighs them; areas (V,): moving
    vertices' shares of the area; disk: the control's.
    """

    def __init__(self, moving, control, weights=None):
        self.smoothings = moving.smoothing, control.smoothing
        self.names, self.areas = moving.smoothing.names, moving.vertex_shares
        self.disk = control.disk
        # Which part of the depth's weight its potential takes; `sharing` makes the others.
        self.shares = SHARES if {"depth", "potential"} <= set(self.names) else SHARES[:1]
        self.share = self.shares[0]
        weights = np.ones(len(self.names)) if weights is None else np.array(weights)
        self.feature_weights = weights / weights.sum()

    def at(self, sigma):
        """Both sides' features at scale sigma, standardised: (V, C) and (W, C)."""
        return tuple(one.at(sigma) for one in self.smoothings)

    def compared(self, sigma):
        """What a fit compares at scale sigma, (V, C) and (W, C), and the maps' weights there (C,), of
        sum 1: beside depth the potential counts above the scale LOCAL alone, by the `share`."""
        weights, names = self.feature_weights.copy(), list(self.names)
        if len(self.shares) > 1:
            share = self.share if sigma > LOCAL else 0.0
            weights[names.index("depth")] *= 1 - share
            weights[names.index("potential")] *= share
        return *(one.compared(sigma) for one in self.smoothings), weights / weights.sum()

    def sharing(self, share):
        """The same with another share of the potential."""
        other = copy(self)
        other.share = share
        return other

    def judges(self, sigma):
        """The moving vertices at which features of a scale are compared, as of `Smoothing.few`, and
        their shares of the area (N,)."""
        some, spread = self.smoothings[0].few(sigma)
        return some, self.areas if spread is None else spread.T @ self.areas

    def correlation(self, f, sigma=FINEST):
        """r (C,) over the moving area between features of scale sigma and the control's where f
        (V,) takes them."""
        here, there = self.at(sigma)
        there = standardised(self.disk.interpolate(there, self.disk.locate(f)), self.areas)
        return np.clip(self.areas @ (here * there), -1, 1)


def featured(moving, control, maps):
    """Two `ParameterizedSurface`s with `Feature`s of `check_features`, and the `Features` that
    compare them."""
    names, sides = [feature.name for feature in maps], []
    for name, side in (("moving", moving), ("control", control)):
        values = np.stack([getattr(feature, name) for feature in maps], axis=1)
        smoothing = Smoothing(side.surface, names, values, side.disk)
        sides.append(replace(side, smoothing=smoothing))
    return *sides, Features(*sides, [feature.weight for feature in maps])


def vertex_slopes(disk, values):
    """Complex gradients (V, C) of values (V, C) on a `Disk`, averaged to the vertices: not the
    derivative of the interpolant, but one without its jumps."""
    return disk.to_vertices @ np.einsum("fk,fkc->fc", disk.gradients, values[disk.faces])


def mobius_by_features(features, z, search=FOLDED):
    """(a, theta) of the disk Möbius map after which the features of a moving disk z (V,) match
    best, at SCALE; the best of many maps on a few vertices are refined on more."""
    turns, radii, directions, best = search
    inner = np.flatnonzero(abs(z) < 0.999)  # the others leave the control's polygon
    share = features.areas[inner] / features.areas[inner].sum()
    some = np.random.default_rng(0).choice(inner, POINTS, p=share)
    around = np.exp(2j * np.pi * np.arange(directions) / directions)
    centres = np.concatenate([[0j], np.multiply.outer(radii, around).ravel()])
    a = np.repeat(centres, turns)
    theta = 2 * np.pi * np.tile(np.arange(turns), len(centres)) / turns
    residual, _ = Match(features, z, some[:SCOUTS])((a, theta))
    order = np.argsort((residual**2).sum(1), kind="stable")[:best]
    a, theta = a[order], theta[order]
    (a, theta), residual = descend(Match(features, z, some), (a, theta), ROUNDS)
    least = (residual**2).sum(1).argmin()
    return complex(a[least]), float(theta[least])


def best_by_features(features, z, search=FOLDED):
    """(a, theta) of the disk Möbius map after which the features of z (V,) match best, wherever z
    lay before."""
    centring = centring_mobius(z, features.areas), 0.0
    return compose_mobius(
        centring, mobius_by_features(features, mobius(z, *centring), search=search)
    )


class Match:
    """How features match at some vertices (M,) of a moving disk z (V,) after B Möbius maps (a,
    theta), (B,) each: the differences (B, M C), whose squares add up to the misfit, and their
    derivatives (B, M C, 3) by an increment of each map, as of `mobius_fields`."""

    def __init__(self, features, z, some):
        here, self.there = features.at(SCALE)
        self.disk, self.slopes = features.disk, vertex_slopes(features.disk, self.there)
        self.z, self.here = z[some], here[some]
        self.scale = np.sqrt(features.feature_weights / len(some))

    def __call__(self, parameters):
        z = np.tile(self.z, (len(parameters[0]), 1))
        w = mobius(z, *(part[:, None] for part in parameters))
        places = self.disk.locate(w.ravel())
        shape = *w.shape, -1
        there, slopes = (
            self.disk.interpolate(values, places).reshape(shape)
            for values in (self.there, self.slopes)
        )
        residual = self.scale * (self.here - there)
        by_map = (self.scale * slopes).conj()[..., None] * mobius_fields(w)[:, :, None]
        return residual.reshape(len(w), -1), -by_map.real.reshape(len(w), -1, 3)


def check_features(features, moving, control):
    """The features of a call as a list of `Feature`s, or FeatureError, naming the map that cannot
    be used; each is a name of FOLDS, a pair of arrays (V,) and (W,), a `Feature`, or a pair of one
    of these and a weight."""
    if not isinstance(features, (list, tuple)) or not len(features):
        raise FeatureError(
            f"features are {features!r}: give a list of them, or None for landmarks alone"
        )
    maps = []
    for number, given in enumerate(features, 1):
        # Apart from its weight, if it has one, a feature is a name, a `Feature` or a pair of maps.
        is_pair = isinstance(given, (list, tuple)) and len(given) == 2
        weighted = is_pair and (isinstance(given[1], str) or not hasattr(given[1], "__len__"))
        given, weight = given if weighted else (given, None)
        if isinstance(given, str):
            if given not in FOLDS:
                raise FeatureError(
                    f"unknown feature {given!r}: {', '.join(FOLDS)} are computed, others are arrays"
                )
            given = Feature(given, *(COMPUTED[given](surface) for surface in (moving, control)))
        elif not isinstance(given, Feature):
            if not isinstance(given, (list, tuple)) or len(given) != 2:
                raise FeatureError(
                    f"feature {number} is neither a name nor a pair of maps, one a side: "
                    f"{given!r:.60}"
                )
            given = Feature(f"feature {number}", *given)
        if not isinstance(given.name, str):
            raise FeatureError(f"feature {number}: its name {given.name!r} is not text")
        weight = given.weight if weight is None else weight
        if not (is_finite(weight) and weight > 0):
            raise FeatureError(f"{given.name}: weight {weight!r} is not positive and finite")
        here = check_values(given.moving, f"{given.name}, moving side", moving)
        there = check_values(given.control, f"{given.name}, control side", control)
        maps.append(Feature(given.name, here, there, float(weight)))
    names = [feature.name for feature in maps]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FeatureError(
            f"features named twice: {twice}; rename or drop one of each, or raise its weight"
        )
    return maps


def check_values(values, name, surface):
    """A feature's values on a surface as floats (V,), or FeatureError with their name."""
    unmasked(values, name, FeatureError)
    try:
        values = np.asarray(values)
    except ValueError:
        raise FeatureError(f"{name}: lists of unequal lengths; give one number a vertex") from None
    if values.dtype.kind != "f":
        hint = "labels have no order, and a complex map has two parts: give floats"
        raise FeatureError(f"{name}: values of type {values.dtype}; {hint}")
    if values.shape != (len(surface.vertices),):
        raise FeatureError(
            f"{name}: shape {values.shape} for {len(surface.vertices)} vertices; give one value a "
            "vertex of the surface as registered (cut open, if it was cut)"
        )
    unknown = np.flatnonzero(~np.isfinite(values))
    if len(unknown):
        raise FeatureError(
            f"{name}: not finite at vertices {unknown[:5].tolist()}; fill them in first"
        )
    if not np.ptp(values) > 1e-9 * abs(values).max():
        raise FeatureError(
            f"{name}: the same value everywhere, {values[0]:g}; leave this feature out"
        )
    values = values.astype(float)
    column = values[:, None] / abs(values).max()
    core = clipped(column, surface.vertex_areas / surface.area, OUTLIERS)
    if not np.ptp(core) > 1e-9:
        raise FeatureError(f"{name}: the same value everywhere but for outliers; leave it out")
    return values
