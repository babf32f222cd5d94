"""Features: per-vertex values that a registration compares, and Möbius maps that lay them on each
other.

`Smoothing` holds those of one surface at any scale, standardised, and its density (its area over
that of its disk); `Features` compares two. `mobius_by_features` aligns disks by features alone;
`check_features` reads what a call was given.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter

import numpy as np
import scipy
from scipy import sparse

from ..plane.grids import thinned
from ..plane.linear import LARGE, around_vertices, degenerate_faces, heat_flow
from ..plane.mobius import centring_mobius, compose_mobius, mobius, mobius_fields
from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Surface, SurfaceError, closing_fans
from .problem import is_finite

COMPUTED = {"depth": sulcal_depth, "curvature": mean_curvature}
FOLDS = tuple(COMPUTED)  # the features that a surface has by itself
FINEST = 4.0  # mm, the scale at which features are compared in reports

# Smoothing. Standard deviations to which a map is clipped, before and after it is smoothed, and
# the share of the vertices at either end that does not count in these.
OUTLIERS = 2.5
SMOOTH_OUTLIERS = 3.0
TAIL = 0.01
ROUND = 20.0  # mm, the scale at which a hemisphere has no folds and still its shape
HEAT_STEPS = 4  # implicit steps of the heat flow to one scale
COARSE_VERTICES = 12_000  # of a large surface, on which coarser scales are smoothed
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
DAMPING = 1e-2  # of the first step, in parts of the normal matrix

# Rotations of crude spheres: degrees about each axis of space, from coarse to fine.
TURNS = (32, 16, 8, 4, 2)
CELLS = 48  # per radius, of the grid in which nearest vertices are looked up


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
        self.levels, self.densities = {}, {}

    def at(self, sigma):
        """The smoothed values, outliers clipped, standardised; cached."""
        if sigma not in self.levels:
            values = clipped(self.heat(sigma), self.areas, SMOOTH_OUTLIERS)
            self.levels[sigma] = standardised(values, self.areas)
        return self.levels[sigma]

    def density(self, sigma, disk):
        """log of the share of the surface's area over that of the disk's (V,), smoothed, on any of
        its `Disk`s.

        Two disk maps of one surface differ by a smooth factor, the slope of a Möbius map. It is
        added after the smoothing.
        """
        if sigma not in self.densities:
            self.heat(sigma)
        density = self.densities[sigma] + log_density(self.areas, disk)
        return density - log_density(self.areas, self.disk)

    def heat(self, sigma):
        """The values after the heat flow `A u' = -K u` for the time sigma^2 / 2; caches the
        density's."""
        columns = [clipped(scaled(self.values), self.areas, OUTLIERS)]
        if self.disk is not None:
            columns.append(log_density(self.areas, self.disk)[:, None])
        smooth = self.flow(sigma, self.mass @ np.hstack(columns))
        if self.disk is not None:
            self.densities[sigma] = smooth[:, -1]
        return smooth[:, : len(self.names)]

    def flow(self, sigma, load):
        time = (self.unit * sigma) ** 2 / (2 * HEAT_STEPS)
        if self.few(sigma)[1] is None:
            return heat_flow(self.mass, time * self.stiffness, load, HEAT_STEPS)
        _, spread, mass, stiffness = self.coarse
        return spread @ heat_flow(mass, time * stiffness, spread.T @ load, HEAT_STEPS)

    def few(self, sigma):
        """Vertices (N,) that suffice at a scale, and the matrix (V, N) that spreads their values to
        all vertices. All vertices and None, unless the surface is large and the scale coarse."""
        if self.disk is None or len(self.areas) <= LARGE or sigma <= FINEST:
            return slice(None), None
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


def scaled(values):
    """Values (V, C), not all 0, with 1 as each map's largest size, so that squares neither vanish
    nor overflow."""
    return values / abs(values).max(0)


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
    """The features of a moving `ParameterizedSurface` compared with those of a control: a
    `ParameterizedSurface` or a group's mean.

    names (C,); feature_weights (C,): of sum 1; areas (V,): moving vertices' shares of the area;
    disk: the control's.
    """

    def __init__(self, moving, control, weights=None):
        self.smoothings = moving.smoothing, control.smoothing
        self.names, self.areas = moving.smoothing.names, moving.vertex_shares
        self.disk = control.disk
        weights = np.ones(len(self.names)) if weights is None else np.array(weights)
        self.feature_weights = weights / weights.sum()

    def at(self, sigma):
        """Both sides' features at scale sigma, standardised: (V, C) and (W, C)."""
        return tuple(one.at(sigma) for one in self.smoothings)

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


class Directions(Features):
    """Features that lead from afar: the vertices' places on `crude_sphere`s, as smooth as they
    are, the moving ones after the rotation by which the features at SCALE agree best.

    r: their mean correlation then; mirrored_r: if the moving side is mirrored.
    """

    def __init__(self, features, moving, control):
        self.smoothings, self.disk, self.areas = features.smoothings, features.disk, features.areas
        self.feature_weights = np.ones(3) / 3
        here, there = (
            crude_sphere(surface, side.few(ROUND)[1])
            for surface, side in zip((moving, control), features.smoothings)
        )
        search = RotationSearch(features, there)
        self.mirrored_r, _ = search.best(here * [-1, 1, 1])
        self.r, rotated = search.best(here)
        self.spheres = rotated, there

    def at(self, sigma):
        """Places on the unit sphere (V, 3) and (W, 3)."""
        return self.spheres


class RotationSearch:
    """Rotations of a moving sphere onto a control's (W, 3), tried on POINTS of its vertices."""

    def __init__(self, features, there):
        here, values = features.at(SCALE)
        self.some = np.random.default_rng(0).choice(len(here), POINTS, p=features.areas)
        few, _ = features.smoothings[1].few(SCALE)
        self.here, self.values = here[self.some] * features.feature_weights / POINTS, values[few]
        # Many rotations ask for the nearest vertex to each cell of a grid on the sphere.
        cells = np.indices((2 * CELLS + 1,) * 3).reshape(3, -1).T / CELLS - 1
        near = abs(np.linalg.norm(cells, axis=1) - 1) < 1 / CELLS
        self.nearest = np.zeros(len(cells), int)
        self.nearest[near] = scipy.spatial.KDTree(there[few]).query(cells[near])[1]

    def best(self, sphere):
        """The features' correlation after the best rotation of a sphere (V, 3) about the axes of
        space by up to TURNS in all, and the sphere after it."""
        Rotation = scipy.spatial.transform.Rotation
        best, r = Rotation.identity(), -np.inf
        for turn in TURNS:
            # From coarse to fine: a grid of rotations around the best one so far.
            steps = turn * (np.arange(-2, 3) / 2 if turn == TURNS[0] else np.arange(-1, 2) / 2)
            grid = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
            tried = Rotation.from_euler("xyz", grid, degrees=True) * best
            places = np.einsum("rij,pj->rpi", tried.as_matrix(), sphere[self.some])
            cells = np.rint((places + 1) * CELLS).astype(int)
            nearest = self.nearest[cells @ [(2 * CELLS + 1) ** 2, 2 * CELLS + 1, 1]]
            found = np.einsum("rpc,pc->r", self.values[nearest], self.here)
            if found.max() > r:
                r, best = float(found.max()), tried[int(found.argmax())]
        return r, best.apply(sphere)


def crude_sphere(surface, spread=None):
    """The vertices of a surface cut open at one rim on the unit sphere (V, 3), from their places
    alone.

    A fan closes the rim, and the places follow the closed surface's heat flow to the scale ROUND;
    centred, with deviation 1 along each axis of space, they are taken to the sphere from its
    centre. Sides that lie in space alike lie alike on their spheres, wherever they were cut.
    spread: of `Smoothing.few`, whose vertices then carry the heat.
    """
    count = len(surface.vertices)
    places, fan = closing_fans(surface)
    # A slit's rim may have faces without area in its fan; it needs none.
    slit = len(degenerate_faces(places, fan)) > 0
    closed = surface if slit else Surface(places, np.vstack([surface.faces, fan]))
    areas = closed.vertex_areas / closed.area
    mass, time = sparse.diags_array(areas), ROUND**2 / HEMISPHERE / (2 * HEAT_STEPS)
    places = closed.vertices - areas @ closed.vertices
    flow = mass, time * closed.stiffness, mass @ places
    if spread is None:
        places = heat_flow(*flow, HEAT_STEPS)
    else:
        spread = sparse.block_diag([spread, np.eye(len(places) - count)]).tocsr()
        small = (spread.T @ part @ spread for part in flow[:2])
        places = spread @ heat_flow(*small, spread.T @ flow[2], HEAT_STEPS)
    places = standardised(places, areas)[:count]
    return places / np.maximum(np.linalg.norm(places, axis=1, keepdims=True), np.finfo(float).tiny)


def featured(moving, control, maps):
    """Two `ParameterizedSurface`s with `Feature`s of `check_features`, and the `Features` that
    compare them."""
    names = [feature.name for feature in maps]

    def smoothed(side, name):
        values = np.stack([getattr(feature, name) for feature in maps], axis=1)
        return replace(side, smoothing=Smoothing(side.surface, names, values, side.disk))

    moving, control = smoothed(moving, "moving"), smoothed(control, "control")
    return moving, control, Features(moving, control, [feature.weight for feature in maps])


class Image:
    """The control's features (W, C) of one scale, at places that its `Disk.locate` returns."""

    def __init__(self, disk, values):
        self.disk, self.values = disk, values
        # Slopes are averaged to the vertices: not the derivative of the interpolant, but one
        # without its jumps.
        by_face = np.einsum("fk,fkc->fc", disk.gradients, values[disk.faces])
        self.by_vertex = disk.to_vertices @ by_face

    def at(self, places):
        """Values (P, C)."""
        return self.disk.interpolate(self.values, places)

    def slopes(self, places):
        """Complex gradients (P, C)."""
        return self.disk.interpolate(self.by_vertex, places)


def mobius_by_features(features, z, near=False, search=FOLDED):
    """(a, theta) of the disk Möbius map after which the features of a moving disk z (V,) match
    best, at SCALE; the best of many maps on a few vertices are refined on more, or with `near` the
    identity alone."""
    turns, radii, directions, best = search
    inner = np.flatnonzero(abs(z) < 0.999)  # the others leave the control's polygon
    share = features.areas[inner] / features.areas[inner].sum()
    some = np.random.default_rng(0).choice(inner, POINTS, p=share)
    match = Match(features, z, some)
    if near:
        return match.refined((0j, 0.0))[1]
    around = np.exp(2j * np.pi * np.arange(directions) / directions)
    centres = [0j, *np.multiply.outer(radii, around).ravel()]
    starts = [(a, turn) for a in centres for turn in 2 * np.pi * np.arange(turns) / turns]
    order = np.argsort(Match(features, z, some[:SCOUTS]).misfits(starts), kind="stable")
    return min((match.refined(starts[k]) for k in order[:best]), key=itemgetter(0))[1]


def best_by_features(features, z, search=FOLDED):
    """(a, theta) of the disk Möbius map after which the features of z (V,) match best, wherever z
    lay before."""
    centring = centring_mobius(z, features.areas), 0.0
    return compose_mobius(
        centring, mobius_by_features(features, mobius(z, *centring), search=search)
    )


def align_by_features(features, z):
    """The picture (V,) of a moving disk z (V,) under that map."""
    return mobius(z, *best_by_features(features, z))


class Match:
    """How well features match at some vertices of a moving disk z (V,) after a Möbius map."""

    def __init__(self, features, z, some):
        here, there = features.at(SCALE)
        self.locate, self.image = features.disk.locate, Image(features.disk, there)
        self.z, self.here = z[some], here[some]
        self.scale = np.sqrt(features.feature_weights / len(some))

    def misfits(self, many):
        """Mean squares (B,) of the difference after each of B Möbius maps (a, theta), looked up in
        one go."""
        a, theta = (np.array(part)[:, None] for part in zip(*many))
        places = self.locate(mobius(np.tile(self.z, (len(a), 1)), a, theta).ravel())
        there = self.image.at(places).reshape(len(a), *self.here.shape)
        return ((self.scale * (self.here - there)) ** 2).sum((1, 2))

    def after(self, parameters):
        """Mean square after one Möbius map, the points and their places then, and residuals."""
        w = mobius(self.z, *parameters)
        places = self.locate(w)
        residual = (self.scale * (self.here - self.image.at(places))).ravel()
        return residual @ residual, w, places, residual

    def refined(self, parameters):
        """(misfit, (a, theta)) after damped Gauss-Newton steps from there, each a Möbius map
        more."""
        damping = DAMPING
        cost, w, places, residual = self.after(parameters)
        for _ in range(ROUNDS):
            slopes = (self.scale * self.image.slopes(places)).conj()
            D = -(slopes[:, :, None] * mobius_fields(w)[:, None]).real.reshape(-1, 3)
            normal = D.T @ D
            damped = normal + damping * np.diag(np.diag(normal))
            turn, real, imaginary = np.linalg.solve(damped, -D.T @ residual)
            shift = complex(real, imaginary)
            tried = compose_mobius(parameters, (shift / np.sqrt(1 + abs(shift) ** 2), turn))
            after = self.after(tried)
            if after[0] < cost:
                parameters = tried
                cost, w, places, residual = after
                damping *= 0.2
            else:
                damping *= 10.0
        return cost, parameters


def check_features(features, moving, control):
    """The features of a call as a list of `Feature`s, or FeatureError, naming the map that cannot
    be used; each is a name of FOLDS, a pair of arrays (V,) and (W,), a `Feature`, or a pair of one
    of these and a weight."""
    if not isinstance(features, (list, tuple)) or not len(features):
        raise FeatureError(
            f"features are {features!r}: give a list of them, or None for landmarks alone"
        )
    maps = [_feature(number, given, moving, control) for number, given in enumerate(features, 1)]
    names = [feature.name for feature in maps]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise FeatureError(
            f"features named twice: {twice}; rename or drop one of each, or raise its weight"
        )
    return maps


def _feature(number, given, moving, control):
    is_pair = isinstance(given, (list, tuple)) and len(given) == 2
    weighted = is_pair and (isinstance(given[1], str) or not hasattr(given[1], "__len__"))
    given, weight = given if weighted else (given, None)
    if isinstance(given, str):
        if given not in FOLDS:
            raise FeatureError(
                f"unknown feature {given!r}: {' and '.join(FOLDS)} are computed, others are arrays"
            )
        compute = COMPUTED[given]
        given = Feature(given, compute(moving), compute(control))
    elif not isinstance(given, Feature):
        if not isinstance(given, (list, tuple)) or len(given) != 2:
            raise FeatureError(
                f"feature {number} is neither a name nor a pair of maps, one a side: {given!r:.60}"
            )
        given = Feature(f"feature {number}", *given)
    if not isinstance(given.name, str):
        raise FeatureError(f"feature {number}: its name {given.name!r} is not text")
    weight = given.weight if weight is None else weight
    if not (is_finite(weight) and weight > 0):
        raise FeatureError(f"{given.name}: weight {weight!r} is not positive and finite")
    moving = check_values(given.moving, f"{given.name}, moving side", moving)
    control = check_values(given.control, f"{given.name}, control side", control)
    return Feature(given.name, moving, control, float(weight))


def check_values(values, name, surface):
    """A feature's values on a surface as floats (V,), or FeatureError with their name."""
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
    core = clipped(scaled(values[:, None]), surface.vertex_areas / surface.area, OUTLIERS)
    if not np.ptp(core) > 1e-9:
        raise FeatureError(f"{name}: the same value everywhere but for outliers; leave it out")
    return values
