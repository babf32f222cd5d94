"""The way from a coarse mesh to the caller's own: one driver goes through a list of `Level`s."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..plane.checks import check_coefficient
from ..plane.coefficients import unbounded
from ..plane.grids import polar
from ..plane.linear import LARGE
from ..plane.mobius import best_mobius
from ..plane.tangent import CoefficientMesh
from .features import FINEST, Smoothing
from .gauss_newton import WORTH, Discretization, GaussNewtonObjective
from .problem import LandmarkError
from .residuals import AreaTerm, FeatureTerm, Places

WORTH_ON_GRID = 1e-2  # on a polar mesh, as `WORTH` on the caller's: what a step has to promise
SETTLED, SETTLED_ON_GRID = (
    0.98,
    0.95,
)  # share of its objective that a step leaves where the next is not worth its cost
FIRST_GAMMA = 1e2  # a rising level takes one step at each power of ten from here to its gamma
# Until the last level: a large one tears the map to the landmarks before features can lead it.
GUIDING_GAMMA = 1e2
GUIDING_DELTA, COARSE = (
    0.3,
    16.0,
)  # at most, from this scale up: a large one tears it to the nearest folds
AREAS_DELTA, AREAS_ETA = (
    1.0,
    0.1,
)  # at most, with areas above the finest scale: larger ones lead to the wrong valleys
STAND, BEYOND = (
    64,
    1.05,
)  # rings of the polar mesh that stands for a large one, and what that may add to its objective
RIM = (
    1 - 1 / STAND
)  # radius from where areas do not count on either: the two cut the rim into faces of other kinds


class Level(NamedTuple):
    """One part of the way.

    rings: of the mesh of nu; sigma: the features' scale (None: landmarks alone); steps: at most;
    own_mesh: map the surface's own mesh; worth: share of the objective that a step has to promise;
    settled: share that it may leave if another follows, 0 for any; share, most: of gamma; rising:
    raise gamma to that from FIRST_GAMMA, where nu is 0; proxy_rings: rings of a polar mesh that is
    mapped in the own one's place, with its weights; skip_ratio: take no step where the objective is
    at most so many times that of the level before.
    """

    rings: int
    sigma: float | None
    steps: int
    own_mesh: bool = False
    min_predicted_decrease: float = WORTH_ON_GRID
    stall_ratio: float = 0.0
    share: float = 1.0
    most: float = np.inf
    rising: bool = False
    proxy_rings: int = 0
    skip_ratio: float = 0.0

    def weights(self, weights):
        """The `Weights` at this level."""
        if self.own_mesh or self.proxy_rings:
            return weights
        delta, eta, scale = weights.delta, weights.eta, self.sigma or 0.0
        if scale >= COARSE:
            delta = min(delta, GUIDING_DELTA)
        if eta and scale > FINEST:
            delta, eta = min(delta, AREAS_DELTA), min(eta, AREAS_ETA)
        return replace(
            weights, gamma=min(self.share * weights.gamma, self.most), delta=delta, eta=eta
        )


def guided(rings, sigma, steps):
    """A level on a polar mesh that features lead."""
    return Level(rings, sigma, steps, stall_ratio=SETTLED_ON_GRID, most=GUIDING_GAMMA)


# With features; from fine ones at once the map would run into the next best valley.
LEVELS = (
    guided(16, 32.0, 4),
    guided(16, 16.0, 4),
    guided(24, 8.0, 3),
    guided(32, FINEST, 2),
    Level(32, FINEST, 4, True, WORTH, SETTLED),
)
# The same above LARGE vertices, where a step on the own mesh costs ten times as much and gains
# little more.
LARGE_LEVELS = (
    *LEVELS[:-1],
    LEVELS[-1]._replace(own_mesh=False, proxy_rings=STAND),
    LEVELS[-1]._replace(skip_ratio=BEYOND),
)


def feature_levels(disk):
    """The levels with features for a `Disk`."""
    return LARGE_LEVELS if len(disk.z) > LARGE else LEVELS


def landmark_levels(disk, rings):
    """The levels with landmarks alone, for a `Disk` and the rings of its finest polar mesh."""
    # At a tenth of gamma: the coarse mesh's own error moves the landmarks, and the full weight
    # would bend nu after it. On the tests' smooth problems that costs up to a step more there and
    # ends up to 3 % higher in L_CP.
    yield Level(rings // 2, None, 5, share=0.1, rising=True)
    own = Level(rings, None, 24, True, WORTH)
    if len(disk.z) > LARGE:
        yield own._replace(own_mesh=False, proxy_rings=STAND)
        own = own._replace(skip_ratio=BEYOND)
    yield own


def few(steps, rings):
    """At most so many steps on one polar mesh, whatever they promise."""
    return Level(rings, None, steps, min_predicted_decrease=0.0)


class MultiresolutionFit:
    """The way of one `Problem` through levels with any weights; keeps what no weight changes, for a
    slider say."""

    def __init__(self, problem):
        self.problem, self.settings, self.densities = problem, {}, {}

    def setting(self, level):
        """The `Discretization` of a level: the problem on its own mesh, on one that stands for it,
        or on that of nu."""
        key = level.rings, level.own_mesh, level.proxy_rings
        if key not in self.settings:
            problem = (
                replace(self.problem, disk=polar(level.proxy_rings))
                if level.proxy_rings
                else self.problem
            )
            whole = level.own_mesh or level.proxy_rings > 0
            link = (
                CoefficientMesh(problem.disk, polar(level.rings))
                if whole
                else polar_coefficient_mesh(level.rings)
            )
            self.settings[key] = Discretization(problem, link, whole)
        return self.settings[key]

    def engine(self, level, weights, features=None):
        """The `GaussNewtonObjective` of one level."""
        if weights.eta and self.problem.sides is None:
            raise LandmarkError(
                f"eta = {weights.eta:g}: areas belong to surfaces; give the problem its sides, or "
                "eta = 0"
            )
        setting, weights = self.setting(level), level.weights(weights)
        with_features = features is not None and level.sigma is not None
        if not (with_features or weights.eta):
            return GaussNewtonObjective(setting, weights)
        samples = None if level.own_mesh else setting.link.disk.sampling(self.problem.disk.z)
        places = Places(
            features.disk if features is not None else self.problem.sides.control.disk, samples
        )
        term = FeatureTerm(features, level.sigma, weights.delta, places) if with_features else None
        return GaussNewtonObjective(
            setting,
            weights,
            term,
            self.areas(level, setting, weights.eta, places) if weights.eta else None,
        )

    def areas(self, level, setting, eta, places):
        """The `AreaTerm` of one level; places: of the moving vertices."""
        sides, sigma = self.problem.sides, FINEST if setting.own else level.sigma or LEVELS[0].sigma
        shares, moving = setting.by_area(self.density("moving", sigma))
        if level.proxy_rings or level.skip_ratio:
            shares = np.where(abs(setting.link.disk.centroids) < RIM, shares, 0.0)
        places = places if level.own_mesh else Places(sides.control.disk)
        return AreaTerm(
            setting.link.disk, shares, moving, self.density("control", sigma), eta, places
        )

    def density(self, name, sigma):
        """A side's density at a scale, as `Smoothing.density`, kept."""
        if (name, sigma) not in self.densities:
            side = getattr(self.problem.sides, name)
            smoothing = side.features or Smoothing(
                side.surface, (), side.surface.vertices[:, :0], side.disk
            )
            self.densities[name, sigma] = smoothing.density(sigma, side.disk)
        return self.densities[name, sigma]

    def run(
        self, levels, weights, start=None, features=None, watch=None, enough=0.0, begun=(None, None)
    ):
        """Steps of each level, from mu `start` (F,) or None: the last engine, its last state, the
        steps a level.

        begun: engine and state to go on from instead.
        """
        (engine, state), steps = begun[:2], []
        for level in levels:
            before, last, engine = engine, state, self.engine(level, weights, features)
            if before is None:
                state = engine.at(
                    start_field(self.problem.disk, start, engine.link.mesh), self.problem.mobius
                )
                if features is not None and start is not None and len(self.problem.moving):
                    best = best_mobius(engine.samples @ state.solution.f, self.problem.target)
                    state = engine.with_mobius(state, best)
            else:
                nu = self.carried(before, state, engine, start if features is None else None)
                state = engine.at(nu, state.mobius)
            most = (
                level.skip_ratio * before.objective(last, weights.gamma)
                if before and level.skip_ratio
                else -np.inf
            )
            before = last = None  # with its factors, which make room for those of this level
            done = most > 0 and engine.objective(state, weights.gamma) <= most
            state, taken = (state, 0) if done else run_level(engine, state, level, watch, enough)
            steps.append(taken)
        return engine, state, tuple(steps)

    def carried(self, before, state, engine, start):
        """nu on the next engine's mesh: mu `start` (F,) with its details, and what the steps have
        changed."""
        old, new = before.link.mesh, engine.link.mesh
        if old is new:
            return state.nu
        known, begin = (start_field(self.problem.disk, start, mesh) for mesh in (old, new))
        return old.sampling(new.z) @ (state.nu - known) + begin


@lru_cache(maxsize=8)
def polar_coefficient_mesh(rings):
    """The `CoefficientMesh` of a polar mesh that carries nu and is mapped itself."""
    return CoefficientMesh(polar(rings), polar(rings))


def run_level(engine, state, level, watch=None, enough=0.0):
    """(state, steps) after the steps of one level, until one promises or gains too little, or the
    landmark error falls below `enough` (not on a rising level); watch() is called before each."""
    gamma = engine.weights.gamma
    low = min(FIRST_GAMMA, gamma) if level.rising and not state.nu.any() else gamma
    gammas = [*10.0 ** np.arange(np.log10(low), np.log10(gamma) - 1e-9), *[gamma] * level.steps]
    now = engine.objective(state, gamma) if level.stall_ratio else None
    for steps, at in enumerate(gammas):
        if watch:
            watch()
        if engine.spent:
            return state, steps
        near = enough > 0 and not level.rising and engine.error(state) < enough
        found = (
            None
            if near
            else engine.step(state, at, level.min_predicted_decrease if at == gamma else 0.0)
        )
        if found is None and at == gamma:
            return state, steps
        state = found or state
        if level.stall_ratio:
            last, now = now, engine.objective(state, gamma)
            if now > level.stall_ratio * last:
                return state, steps + 1
    return state, len(gammas)


def start_field(disk, mu, mesh):
    """nu at the vertices of a polar mesh from mu (F,) on a `Disk`; 0 from None."""
    if mu is None:
        return np.zeros(len(mesh.z), complex)
    return unbounded(check_coefficient(mu, len(disk.faces))[disk.locate(mesh.z)[0]])
