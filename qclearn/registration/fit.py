"""The best quasi-conformal map for given landmarks, without a network: Gauss-Newton steps, mesh after mesh."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Complex, Integer
from numpy import ndarray
from threadpoolctl import threadpool_limits

from ..plane.beltrami import check_coefficient
from ..plane.disk import LARGE
from ..plane.diskmesh import locate, polar_disk, sampling_matrix
from ..plane.fields import bounded, unbounded
from ..plane.mobius import mobius
from .certified import CertifiedMap, certified
from .engine import GaussNewton, SurfaceGaussNewton
from .normal import WORTH
from .problem import LandmarkError, Problem, Weights

FIRST_GAMMA = 1e2  # continuation: one step at each power of ten from here to gamma
STEPS_AT_GAMMA = 5
STEPS_ON_MESH, STEPS_BETWEEN = 24, 2  # at most, on the caller's mesh, and on the fine polar mesh before a large one
FEWEST_RINGS = 4  # of the polar mesh; half of them on the coarse one
POWER = 1.4  # by which the rings of the polar meshes crowd towards the centre
WORTH_ON_GRID = 1e-2  # there, as `WORTH` on the caller's mesh: what a step has to promise
ROUNDING = 1e-9  # by which an objective may exceed another and count as equal
ABOVE = "the fit ended above the best Möbius map"


@dataclass(frozen=True)
class LandmarkFit(CertifiedMap):
    """Result of `fit_landmarks`: a `CertifiedMap` and how it was found.

    steps: Gauss-Newton steps on the polar mesh and on the given one; losses: L_mu, L_grad_mu, L_Landmark, L_CP of the
    coefficient field. With features also L_features, and r: their names -> correlations after the best Möbius map and
    after this one.
    """

    steps: tuple
    losses: dict
    r: dict = field(default_factory=dict)


def fit_landmarks(
    z: Complex[ndarray, " V"],
    faces: Integer[ndarray, " F 3"],
    moving: Complex[ndarray, " M"],
    target: Complex[ndarray, " M"],
    alpha: float = Weights.alpha,
    beta: float = Weights.beta,
    gamma: float = Weights.gamma,
    curve: Integer[ndarray, " M"] | None = None,
    sliding: bool = False,
    start: Complex[ndarray, " F"] | None = None,
    rings: int | None = None,
    watch: Callable | None = None,
    enough: float = 0.0,
) -> LandmarkFit:
    """The quasi-conformal disk map that takes landmarks `moving` to `target`: a LandmarkFit, certified or reported.

    Minimises `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2` (means over the unit disk and over
    the M landmarks), to second order in nu the paper's L_CP. Neither this nor the mean squared distance ends above
    that of the best Möbius map: a fit that would is taken up again from there, or the Möbius map is the result, and
    `fallbacks` says so. z (V,) complex with its boundary on the unit circle; moving, target (M,) complex in the closed
    disk; curve (M,) int labels, points of a curve in order; sliding lets inner points of a curve move along the target
    curve. start: mu (F,) on the faces to begin from; rings of the polar mesh that carries nu (default: from the mesh's
    size); watch() is called before each step and may raise to stop it; enough: landmark error below which no further
    step is taken on the mesh (0: steps until they settle).
    Errors: LandmarkError, BeltramiError, SurfaceError. Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    problem, weights = Problem(z, faces, moving, target, curve, sliding), Weights(alpha, beta, gamma)
    return fit_problem(problem, weights, start, rings, watch, enough)


@threadpool_limits.wrap(limits=1)  # on matrices of this size BLAS threads wait for each other: up to five times slower
def fit_problem(problem, weights, start=None, rings=None, watch=None, enough=0.0):
    """`fit_landmarks` of a `Problem` with `Weights`."""
    if rings is not None and not (isinstance(rings, (int, np.integer)) and rings >= FEWEST_RINGS):
        raise LandmarkError(f"rings = {rings!r}: give an integer from {FEWEST_RINGS}, or None to go by the mesh's size")
    rings = rings or rings_for(problem.z)
    coarse = engine_on(GaussNewton, problem, rings // 2, weights)
    begin = start_field(problem.z, problem.faces, start, coarse.z)
    # At a tenth of gamma: the coarse mesh's own error moves the landmarks, and the full weight would bend nu after it.
    # On the tests' smooth problems that costs up to a step more there and ends up to 3 % higher in L_CP.
    state, steps = fit_on_grid(coarse, coarse.at(begin, problem.mobius), weights.gamma / 10, watch)
    fine = engine_on(SurfaceGaussNewton, problem, rings, weights)
    # Only what the steps have changed comes from the coarse mesh, so that a start keeps its details.
    nu = sampling_matrix(coarse.z, coarse.faces, fine.z) @ (state.nu - begin)
    nu, parameters = nu + start_field(problem.z, problem.faces, start, fine.z), state.mobius
    if len(problem.z) > LARGE:  # where a step costs much more than on the polar mesh
        middle = engine_on(GaussNewton, problem, rings, weights)
        state, more = fit_on_mesh(middle, middle.at(nu, parameters), watch, enough, STEPS_BETWEEN)
        nu, parameters, steps = state.nu, state.mobius, steps + more
    state, polished = fit_on_mesh(fine, fine.at(nu, parameters), watch, enough)
    fit = report_fit(fine, state, (steps, polished))
    best = problem.samples @ mobius(problem.z, *problem.mobius)
    return fit_from_mobius(fine, fit, best, watch) if exceeds(fine, state, best) else fit


def engine_on(kind, problem, rings, weights):
    """The engine of a class on the polar mesh of so many rings; of a problem that was fitted before, all but its
    weights is there."""
    key = kind, rings
    if key in problem.engines:
        return problem.engines[key].weighed(weights)
    problem.engines[key] = kind(problem, polar_disk(rings, 3 * rings, power=POWER), weights)
    return problem.engines[key]


def rings_for(z):
    """How many rings the polar mesh that carries nu has for a mesh of so many vertices."""
    return int(np.clip(np.sqrt(len(z) / 3), 8, 32))


def exceeds(engine, state, best):
    """Whether a fit ends above the best Möbius map, which takes the landmarks to `best` (M,): in its objective, or in
    the mean squared distance alone."""
    gamma, target, most = engine.weights.gamma, engine.problem.target, 1 + ROUNDING
    squares = [(abs(points - target) ** 2).mean() for points in (state.points, best)]
    fitted = engine.objective(state, gamma)
    return not (fitted <= most * engine.mismatch(best, gamma) and squares[0] <= most * squares[1])


def fit_from_mobius(engine, astray, best, watch):
    """What takes the place of a fit that ended above the best Möbius map: steps from there, or that map itself.

    The fit that went astray is kept where the Möbius map folds the mesh and cannot be mended, but it is a bijection.
    """
    parameters = engine.problem.mobius
    begin = engine.at(np.zeros(len(engine.z), complex), parameters)
    engine.known_gram = None  # it was learnt far from here
    state, steps = fit_on_mesh(engine, begin, watch)
    taken = astray.steps[0], astray.steps[1] + steps
    fit = report_fit(engine, state, taken)
    if fit.bijective and not exceeds(engine, state, best):
        return replace(fit, fallbacks=(*fit.fallbacks, f"{ABOVE}: {steps} steps from there"))
    return instead(astray, report_fit(engine, engine.mobius_alone(parameters), taken))


def instead(fit, plain):
    """What takes the place of a fit that ended above the best Möbius map: that map, unless it alone folds the mesh."""
    if plain.bijective or not fit.bijective:
        return replace(plain, fallbacks=(*plain.fallbacks, f"{ABOVE}: that map is returned"))
    return replace(fit, fallbacks=(*fit.fallbacks, f"{ABOVE}: kept, as that map folds the mesh"))


def fit_on_grid(engine, state, gamma, watch=None):
    """Steps on a polar mesh, from nu = 0 with continuation in gamma: (state, steps)."""
    low = gamma if state.nu.any() else min(FIRST_GAMMA, gamma)
    levels = [*10.0 ** np.arange(np.log10(low), np.log10(gamma) - 1e-9), *[gamma] * STEPS_AT_GAMMA]
    for steps, level in enumerate(levels):
        if watch:
            watch()
        found = engine.step(state, level, WORTH_ON_GRID if level == gamma else 0.0)
        if level == gamma and found is None:
            return state, steps
        state = found or state
    return state, len(levels)


def fit_on_mesh(engine, state, watch=None, enough=0.0, most=STEPS_ON_MESH):
    """Last steps, on the caller's mesh, as long as they promise enough and the error is not below `enough`: (state,
    steps)."""
    for steps in range(most):
        if watch:
            watch()
        found = None if engine.error(state) < enough else engine.step(state, engine.weights.gamma, WORTH)
        if found is None:
            return state, steps
        state = found
    return state, most


def start_field(z, faces, mu, grid):
    """nu at the polar mesh's vertices from a coefficient mu (F,) on the faces of another disk mesh; 0 from None."""
    if mu is None:
        return np.zeros(len(grid), complex)
    face, _ = locate(z, faces, grid)
    return unbounded(check_coefficient(mu, len(faces))[face])


def report_fit(engine, state, steps):
    """Certify a state's map and gather what `fit_landmarks` returns."""
    mu, weights = bounded(state.nu), engine.weights
    terms = {
        "L_mu": float((mu.conj() @ (engine.mass @ mu)).real),
        "L_grad_mu": float((mu.conj() @ (engine.laplace @ mu)).real),
        "L_Landmark": mean_square(state.points - engine.problem.target),
    }
    terms["L_CP"] = float(sum(factor * terms[name] for name, factor in weights.factors.items()))
    if engine.dense is not None:
        terms["L_features"] = float((engine.dense.residual(state.f) ** 2).sum() / weights.delta)
    found = certified(engine.problem, state.f, state.mobius, state.words)
    return LandmarkFit(**vars(found), steps=steps, losses=terms)


def mean_square(change):
    """Mean |change|^2 over landmarks; 0 without any."""
    return float((abs(change) ** 2).mean()) if len(change) else 0.0
