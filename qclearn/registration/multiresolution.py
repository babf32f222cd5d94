"""A fit on a sequence of meshes: `MultiresolutionFit` takes a `Problem` through a list of `Level`s,
from a coarse polar mesh to the caller's own, and `run_level` takes the Gauss-Newton steps of one.

On a polar mesh nu and the map are cheap, and features are smooth: steps there find the right
valley. The last levels map the caller's mesh.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..plane.checks import check_coefficient
from ..plane.coefficients import unbounded
from ..plane.grids import polar
from ..plane.linear import LARGE
from ..plane.solver import CoefficientMesh, on_itself
from .features import FINEST, Smoothing
from .gauss_newton import MIN_DECREASE, Discretization, GaussNewtonObjective, State
from .problem import LandmarkError
from .residuals import AreaTerm, FeatureTerm, Places

# Share of the objective that a step on the mesh of nu has to promise, as MIN_DECREASE on the
# caller's or its proxy.
MIN_DECREASE_ON_GRID = 1e-2
# Share of the objective that two steps leave where the next is not worth its cost, on either mesh:
# one step may gain little and the next one much.
STALL_RATIO = 0.98
STALL_RATIO_ON_GRID = 0.95

# A rising level takes one step at each power of ten from here to its gamma.
FIRST_GAMMA = 1e2
# At most, on polar meshes: a large gamma tears the map to the landmarks before features can lead
# it.
GUIDING_GAMMA = 1e2
# At most, on polar meshes from the scale COARSE_MM up: a large delta tears the map to the nearest
# folds.
GUIDING_DELTA = 0.3
COARSE_MM = 16.0
# At most, with areas on polar meshes above the finest scale: larger ones lead to the wrong valleys.
AREAS_DELTA = 1.0
AREAS_ETA = 0.1

# Above LARGE vertices a polar mesh of so many rings is fitted in the caller's place, and that one
# only where its objective is higher by more than this ratio.
PROXY_RINGS = 64
SKIP_RATIO = 1.05
# Radius from where areas do not count on either: the two cut the rim into faces of other kinds.
RIM = 1 - 1 / PROXY_RINGS


class Level(NamedTuple):
    """One mesh of a fit, and its steps.

    rings: of the mesh of nu; sigma: the features' scale (None: landmarks alone); steps: at most;
    own_mesh: map the caller's own mesh; min_predicted_decrease: share of the objective by which
    the model of a step must lower it; stall_ratio: share of the objective that two steps may leave
    if another is to follow, inf for any; gamma_factor, most_gamma: gamma here is so many times the
    caller's, and at most `most_gamma`; rising: raise gamma to that from FIRST_GAMMA, where nu is 0;
    proxy_rings: rings of a polar mesh that is mapped in the own one's place, its proxy, with its
    weights; skip_ratio: take no step where the objective is at most so many times that of the level
    before.
    """

    rings: int
    sigma: float | None
    steps: int
    own_mesh: bool = False
    min_predicted_decrease: float = MIN_DECREASE_ON_GRID
    stall_ratio: float = np.inf
    gamma_factor: float = 1.0
    most_gamma: float = np.inf
    rising: bool = False
    proxy_rings: int = 0
    skip_ratio: float = 0.0

    @property
    def on_nu_mesh(self):
        """Whether the mesh of nu is mapped itself, not the caller's or its proxy."""
        return not (self.own_mesh or self.proxy_rings)

    def weights(self, weights):
        """The `Weights` at this level."""
        if not self.on_nu_mesh:
            return weights
        delta, eta, sigma = weights.delta, weights.eta, self.sigma or 0.0
        if sigma >= COARSE_MM:
            delta = min(delta, GUIDING_DELTA)
        if eta and sigma > FINEST:
            delta, eta = min(delta, AREAS_DELTA), min(eta, AREAS_ETA)
        gamma = min(self.gamma_factor * weights.gamma, self.most_gamma)
        return replace(weights, gamma=gamma, delta=delta, eta=eta)


def guided(rings, sigma, steps):
    """A level on a polar mesh that features lead."""
    return Level(rings, sigma, steps, stall_ratio=STALL_RATIO_ON_GRID, most_gamma=GUIDING_GAMMA)


def on_own_mesh(rings, sigma, steps, **more):
    """A level on the caller's own mesh."""
    least = MIN_DECREASE
    return Level(rings, sigma, steps, own_mesh=True, min_predicted_decrease=least, **more)


def with_proxy(level):
    """A level on the own mesh as two: on the proxy mesh, and on the own one where that is not
    enough."""
    proxy = level._replace(own_mesh=False, proxy_rings=PROXY_RINGS)
    return proxy, level._replace(skip_ratio=SKIP_RATIO)


# With features, which lead on polar meshes; from fine ones at once the map would run into the next
# best valley.
GUIDES = (guided(16, 32.0, 4), guided(16, 16.0, 4), guided(24, 8.0, 3), guided(32, FINEST, 2))
# The caller's own mesh, with all its areas, takes the place of the last guide.
LEVELS = (
    *GUIDES[:-1],
    on_own_mesh(32, 8.0, 4, stall_ratio=STALL_RATIO_ON_GRID),
    on_own_mesh(32, FINEST, 10, stall_ratio=STALL_RATIO),
)
# Above LARGE vertices a step on the own mesh costs ten times as much and gains little more.
LARGE_LEVELS = (*GUIDES, *with_proxy(LEVELS[-1]))


def feature_levels(disk):
    """The levels with features for a `Disk`."""
    return LARGE_LEVELS if len(disk.z) > LARGE else LEVELS


def landmark_levels(disk, rings):
    """The levels with landmarks alone, for a `Disk` and the rings of its finest polar mesh."""
    # At a tenth of gamma: the coarse mesh's own error moves the landmarks, and the full weight
    # would bend nu after it. On the tests' smooth problems that costs up to a step more there and
    # ends up to 3 % higher in L_CP.
    coarse = Level(rings // 2, None, 5, gamma_factor=0.1, rising=True)
    own = on_own_mesh(rings, None, 24)
    return [coarse, *(with_proxy(own) if len(disk.z) > LARGE else [own])]


class Progress(NamedTuple):
    """Where a fit on levels stands: the last objective, its state, how many steps each level
    took."""

    objective: GaussNewtonObjective
    state: State
    steps: tuple = ()


class MultiresolutionFit:
    """The fit of one `Problem` on a sequence of levels, with any weights: caches what no weight
    changes."""

    def __init__(self, problem):
        self.problem, self.discretizations, self.densities = problem, {}, {}

    def discretization(self, level):
        """The `Discretization` of a level: the problem on its own mesh, on the proxy, or on that of
        nu."""
        key = level.rings, level.own_mesh, level.proxy_rings
        if key not in self.discretizations:
            rings, on_nu_mesh = level.rings, level.on_nu_mesh
            disk = polar(level.proxy_rings) if level.proxy_rings else self.problem.disk
            mesh = on_itself(polar(rings)) if on_nu_mesh else CoefficientMesh(disk, polar(rings))
            self.discretizations[key] = Discretization(self.problem, mesh, on_nu_mesh)
        return self.discretizations[key]

    def objective(self, level, weights, features=None):
        """The `GaussNewtonObjective` of one level."""
        pair = self.problem.pair
        if weights.eta and pair is None:
            raise LandmarkError(
                f"eta = {weights.eta:g}: areas belong to surfaces; give the problem its pair, or "
                "eta = 0"
            )
        discretization, weights = self.discretization(level), level.weights(weights)
        by_features = features is not None and level.sigma is not None
        feature_term = area_term = None
        if by_features or weights.eta:
            places = Places((pair.control if features is None else features).disk)
            if by_features:
                judges = None
                at = places
                if not level.own_mesh:  # features are compared at moving vertices all the same
                    judges = features.judges(level.sigma)
                    at = Places(features.disk, discretization.interpolation[judges[0]])
                feature_term = FeatureTerm(features, level.sigma, weights.delta, at, judges)
            if weights.eta:
                area_term = self.area_term(level, discretization, weights.eta, places)
        return GaussNewtonObjective(discretization, weights, feature_term, area_term)

    def area_term(self, level, discretization, eta, places):
        """The `AreaTerm` of one level; places: of the mapped vertices."""
        mapped = discretization.coefficient_mesh.disk
        sigma = (level.sigma or LEVELS[0].sigma) if level.on_nu_mesh else FINEST
        shares, moving = discretization.by_area(self.density("moving", sigma))
        if level.proxy_rings or level.skip_ratio:
            shares = np.where(abs(mapped.centroids) < RIM, shares, 0.0)
        return AreaTerm(mapped, shares, moving, self.density("control", sigma), eta, places)

    def density(self, name, sigma):
        """A side's density at a scale, as `Smoothing.density`, cached."""
        if (name, sigma) not in self.densities:
            side = getattr(self.problem.pair, name)
            smoothing = side.smoothing
            if smoothing is None:
                smoothing = Smoothing(side.surface, (), side.surface.vertices[:, :0], side.disk)
            self.densities[name, sigma] = smoothing.density(sigma, side.disk)
        return self.densities[name, sigma]

    def run(self, levels, weights, start_mu=None, features=None, enough=0.0, resumed=None):
        """The `Progress` after the steps of these levels, with the steps of these alone.

        start_mu: mu (F,) to begin from, or None; resumed: `Progress` to go on from instead;
        enough: of `run_level`.
        """
        objective, state = resumed[:2] if resumed else (None, None)
        steps = []
        for level in levels:
            before, objective = objective, self.objective(level, weights, features)
            limit = 0.0
            if before is None:
                state = self.first_state(objective, start_mu, features is not None)
            else:
                if level.skip_ratio:
                    limit = level.skip_ratio * before.value(state, weights.gamma)
                known_mu = start_mu if features is None else None
                nu = self.carried(before, state, objective, known_mu)
                same = before.terms and before.discretization is objective.discretization
                known = state.preconditioner if same else None
                state = replace(objective.at(nu, state.mobius), preconditioner=known)
            before = None  # with its factors, which make room for those of this level
            taken = 0
            if not (limit > 0 and objective.value(state, weights.gamma) <= limit):
                state, taken = run_level(objective, state, level, enough)
            steps.append(taken)
        return Progress(objective, state, tuple(steps))

    def first_state(self, objective, start_mu, by_features):
        """The state with mu `start_mu` (F,) and `Problem.mobius`, or with features the best Möbius
        map after the map of mu."""
        nu = start_field(self.problem.disk, start_mu, objective.coefficient_mesh.mesh)
        state = objective.at(nu, self.problem.mobius)
        if by_features and start_mu is not None and len(self.problem.moving):
            state = objective.aligned(state)
        return state

    def carried(self, before, state, objective, start_mu):
        """nu on the next objective's mesh: mu `start_mu` (F,) with its details, and what the steps
        have changed."""
        old, new = before.coefficient_mesh.mesh, objective.coefficient_mesh.mesh
        if old is new:
            return state.nu
        known, begin = (start_field(self.problem.disk, start_mu, mesh) for mesh in (old, new))
        return old.interpolation(new.z) @ (state.nu - known) + begin


def run_level(objective, state, level, enough=0.0):
    """(state, steps) after the steps of one level.

    They end where one promises or gains too little, where the work is spent, or where the landmark
    error falls below `enough` (not on a rising level).
    """
    gamma = objective.weights.gamma
    low = min(FIRST_GAMMA, gamma) if level.rising and not state.nu.any() else gamma
    gammas = [*10.0 ** np.arange(np.log10(low), np.log10(gamma) - 1e-9), *[gamma] * level.steps]
    values = [np.inf, objective.value(state, gamma)]
    for steps, step_gamma in enumerate(gammas):
        if objective.spent:
            return state, steps
        after = None
        if not enough > 0 or level.rising or not objective.error(state) < enough:
            least = level.min_predicted_decrease if step_gamma == gamma else 0.0
            after = objective.step(state, step_gamma, least)
        if after is None and step_gamma == gamma:
            return state, steps
        state = after or state
        values.append(objective.value(state, gamma))
        if values[-1] > level.stall_ratio * values[-3]:
            return state, steps + 1
    return state, len(gammas)


def start_field(disk, mu, mesh):
    """nu at the vertices of a polar mesh from mu (F,) on a `Disk`; 0 from None."""
    if mu is None:
        return np.zeros(len(mesh.z), complex)
    return unbounded(check_coefficient(mu, len(disk.faces))[disk.locate(mesh.z)[0]])
