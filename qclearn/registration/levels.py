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
from .gauss_newton import MIN_DECREASE, GaussNewtonObjective
from .problem import NOTHING, LandmarkError
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

    rings: of the polar mesh of nu; sigma: the features' scale (None: landmarks alone); steps: at
    most; mesh: what is mapped, "nu" that mesh itself, "own" the caller's, "proxy" a finer polar
    mesh in the caller's place; stall_ratio: share of the objective that two steps may leave if
    another is to follow; gamma_factor, most_gamma: on the mesh of nu gamma is so many times the
    caller's, and at most `most_gamma`; rising: raise gamma to that from FIRST_GAMMA, where nu is 0.
    """

    rings: int
    sigma: float | None
    steps: int
    mesh: str = "nu"
    stall_ratio: float = np.inf
    gamma_factor: float = 1.0
    most_gamma: float = np.inf
    rising: bool = False

    def weights(self, weights):
        """The `Weights` at this level: the caller's, or on the mesh of nu less."""
        if self.mesh != "nu":
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


# With features, which lead on polar meshes; from fine ones at once the map would run into the next
# best valley.
GUIDES = (guided(16, 32.0, 4), guided(16, 16.0, 4), guided(24, 8.0, 3), guided(32, FINEST, 2))
# The caller's own mesh, with all its areas, takes the place of the last guide.
LEVELS = (
    *GUIDES[:-1],
    Level(32, 8.0, 4, "own", STALL_RATIO_ON_GRID),
    Level(32, FINEST, 10, "own", STALL_RATIO),
)
# Above LARGE vertices a step on the own mesh costs ten times as much and gains little more: a proxy
# is fitted first.
LARGE_LEVELS = (*GUIDES, LEVELS[-1]._replace(mesh="proxy"), LEVELS[-1])


def rings_for(disk):
    """How many rings the polar mesh of nu has for a `Disk`, by its vertices."""
    return int(np.clip(np.sqrt(len(disk.z) / 3), 8, 32))


def feature_levels(disk, levels=None):
    """The levels with features for a `Disk`, or those given, with no more rings than
    `rings_for` it."""
    levels = levels or (LARGE_LEVELS if len(disk.z) > LARGE else LEVELS)
    return [level._replace(rings=min(level.rings, rings_for(disk))) for level in levels]


def landmark_levels(disk, rings):
    """The levels with landmarks alone, for a `Disk` and the rings of its finest polar mesh."""
    # At a tenth of gamma: the coarse mesh's own error moves the landmarks, and the full weight
    # would bend nu after it. On the tests' smooth problems that costs up to a step more there and
    # ends up to 3 % higher in L_CP.
    coarse = Level(rings // 2, None, 5, gamma_factor=0.1, rising=True)
    meshes = ("proxy", "own") if len(disk.z) > LARGE else ("own",)
    return [coarse, *(Level(rings, None, 24, mesh) for mesh in meshes)]


class MultiresolutionFit:
    """The fit of one `Problem` on a sequence of levels, with any weights: caches what no weight
    changes."""

    def __init__(self, problem):
        self.problem, self.meshes, self.densities = problem, {}, {}

    def coefficient_mesh(self, level):
        """The `CoefficientMesh` of a level, cached."""
        nu_mesh = polar(level.rings)
        if level.mesh == "nu":
            return on_itself(nu_mesh)
        if (level.rings, level.mesh) not in self.meshes:
            disk = polar(PROXY_RINGS) if level.mesh == "proxy" else self.problem.disk
            self.meshes[level.rings, level.mesh] = CoefficientMesh(disk, nu_mesh)
        return self.meshes[level.rings, level.mesh]

    def objective(self, level, weights, features=None):
        """The `GaussNewtonObjective` of one level."""
        problem, pair = self.problem, self.problem.pair
        if weights.eta and pair is None:
            raise LandmarkError(
                f"eta = {weights.eta:g}: areas belong to surfaces; give the problem its pair, or "
                "eta = 0"
            )
        weights, mesh = level.weights(weights), self.coefficient_mesh(level)
        places = Places((pair.control if features is None else features).disk) if pair else None
        feature_term = area_term = None
        if features is not None and level.sigma is not None:
            # Features are compared at moving vertices, whatever mesh is mapped; on the own mesh its
            # vertices are looked up once for both terms.
            at, judges = places or Places(features.disk), None
            if level.mesh != "own":
                judges = features.judges(level.sigma)
                at = Places(features.disk, mesh.disk.interpolation(problem.disk.z[judges[0]]))
            feature_term = FeatureTerm(features, level.sigma, weights.delta, at, judges)
        if weights.eta:
            area_term = self.area_term(level, mesh.disk, weights.eta, places)
        return GaussNewtonObjective(
            problem, mesh, weights, level.mesh == "nu", feature_term, area_term
        )

    def area_term(self, level, mapped, eta, places):
        """The `AreaTerm` of one level, whose mesh maps the `Disk` mapped; places: of its
        vertices."""
        moving = self.problem.pair.moving
        sigma = (level.sigma or LEVELS[0].sigma) if level.mesh == "nu" else FINEST
        # The moving surface's shares of area, and its density, on the mapped faces: sums and means
        # over the moving faces whose centroids they hold.
        shares = moving.face_shares
        density = self.density("moving", sigma)[moving.disk.faces].mean(1)
        if mapped is not moving.disk:
            face, count = mapped.locate(moving.disk.centroids)[0], len(mapped.faces)
            sums = np.bincount(face, shares * density, count)
            shares = np.bincount(face, shares, count)
            density = np.divide(sums, shares, out=np.zeros(count), where=shares > 0)
        # A proxy and the own mesh that it stands for are compared by what both have.
        if level.mesh == "proxy" or (level.mesh == "own" and len(mapped.z) > LARGE):
            shares = np.where(abs(mapped.centroids) < RIM, shares, 0.0)
        return AreaTerm(mapped, shares, density, self.density("control", sigma), eta, places)

    def density(self, name, sigma):
        """A side's density at a scale, as `Smoothing.density`, cached."""
        if (name, sigma) not in self.densities:
            side = getattr(self.problem.pair, name)
            smoothing = side.smoothing
            if smoothing is None:
                smoothing = Smoothing(side.surface, (), side.surface.vertices[:, :0], side.disk)
            self.densities[name, sigma] = smoothing.density(sigma, side.disk)
        return self.densities[name, sigma]

    def run(self, levels, weights, start=None, features=None, enough=0.0, resumed=None):
        """The last of these levels' objectives, its state, and how many steps each level took.

        start: mu (F,) to begin from, or None; resumed: an objective and its state to go on from
        instead; enough: of `run_level`.
        """
        disk, (objective, state) = self.problem.disk, resumed or (None, None)
        passed, steps = None, []
        for level in levels:
            before, objective = objective, self.objective(level, weights, features)
            mesh, aim = objective.coefficient_mesh, None
            if before is None:
                # The first state has the coefficient `start` and the landmarks' best Möbius map,
                # with features the best one after the map of `start`.
                state = objective.at(start_field(disk, start, mesh.mesh), self.problem.mobius)
                if features is not None and start is not None and len(self.problem.moving):
                    state = objective.aligned(state)
            else:
                # The others have the nu of the level before; without features with the details of
                # `start`, which only a fine mesh can carry.
                old, nu = before.coefficient_mesh.mesh, state.nu
                if old is not mesh.mesh:
                    known = start if features is None else None
                    nu = old.interpolation(mesh.mesh.z) @ (nu - start_field(disk, known, old))
                    nu = nu + start_field(disk, known, mesh.mesh)
                if passed == "proxy":
                    aim = SKIP_RATIO * before.value(state, weights.gamma)
                same = before.terms and before.coefficient_mesh is mesh
                learnt = state.learnt if same else None
                state = replace(objective.at(nu, state.mobius), learnt=learnt)
            before, passed = None, level.mesh  # with its factors, which make room for new ones
            taken = 0
            if aim is None or not objective.value(state, weights.gamma) <= aim:
                state, taken = run_level(objective, state, level, enough)
            steps.append(taken)
        return objective, state, tuple(steps)


def run_level(objective, state, level, enough=0.0):
    """(state, steps) after the steps of one level.

    They end where one promises or gains too little, where the work is spent, where nothing is
    left to gain, or where the landmark error falls below `enough` (not on a rising level).
    """
    gamma = objective.weights.gamma
    low = min(FIRST_GAMMA, gamma) if level.rising and not state.nu.any() else gamma
    gammas = [*10.0 ** np.arange(np.log10(low), np.log10(gamma) - 1e-9), *[gamma] * level.steps]
    least = MIN_DECREASE_ON_GRID if level.mesh == "nu" else MIN_DECREASE
    values = [np.inf, objective.value(state, gamma)]
    for steps, step_gamma in enumerate(gammas):
        if objective.spent or values[-1] <= NOTHING:
            return state, steps
        after = None
        if not enough > 0 or level.rising or not objective.error(state) < enough:
            after = objective.step(state, step_gamma, least if step_gamma == gamma else 0.0)
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
