"""Registration by landmarks and features: the landmark fit with a dense term, from coarse features to fine ones.

Objective: `nu^* W nu + gamma mean |M(f(p)) - q|^2 + delta sum_c a_c sum_k w_k (I_c(x_k) - J_c(M f(x_k)))^2`.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex
from numpy import ndarray
from threadpoolctl import threadpool_limits

from ..plane.diskmesh import polar_disk, sampling_matrix
from ..plane.mobius import best_mobius
from .dense import Dense
from .engine import GaussNewton, SurfaceGaussNewton
from .features import FINEST, Features
from .fit import POWER, ROUNDING, WORTH_ON_GRID, LandmarkFit, instead, report_fit, rings_for, start_field
from .normal import WORTH
from .problem import LandmarkError, Problem, Weights


class Level(NamedTuple):
    """One part of the way: rings of the mesh of nu, scale of the features (None: landmarks alone), steps at most, and
    whether the surface's own disk mesh is mapped, with the whole gamma."""

    rings: int
    sigma: float | None
    steps: int
    own_mesh: bool = False


# From fine features at once the map would run into the next best valley.
LEVELS = (Level(16, 32.0, 4), Level(16, 16.0, 4), Level(24, 8.0, 3), Level(32, FINEST, 2), Level(32, FINEST, 4, True))
GUIDING_GAMMA = 1e2  # until the last level: a large one tears the map to the landmarks before features can lead it
GUIDING_DELTA, COARSE = 0.3, 16.0  # at most, from this scale up: a large one tears it to the nearest folds
SETTLED, SETTLED_ON_GRID = 0.98, 0.95  # share of its objective that a step leaves where the next is not worth its cost
OVERFITS = 10.0  # delta above which a word is said


@threadpool_limits.wrap(limits=1)
def fit_registration(
    problem: Problem,
    weights: Weights,
    features: Features,
    start: Complex[ndarray, " F"] | None = None,
    watch: Callable | None = None,
    levels: Sequence = LEVELS,
) -> LandmarkFit:
    """The disk map of a `Problem` that takes landmarks and `Features` to theirs, with `Weights` (delta > 0):
    LandmarkFit.

    Gauss-Newton from coarse features on a coarse mesh to fine ones on the problem's own; `r` of the result has the
    features' correlations. start: mu (F,) on the faces to begin from; watch() is called before each step and may raise
    to stop it. A problem without landmarks begins at the identity: align its disk by features first.
    """
    if not weights.delta > 0:
        raise LandmarkError(f"delta = {weights.delta:g}: the features would take no part; give 0.1 to 1")
    engine = state = None
    steps = []
    for level in levels:
        if level.sigma is None and (start is not None or not len(problem.moving)):
            continue
        before, engine = engine, engine_of(level, problem, weights, features)
        state = first_state(engine, start) if state is None else carried(before, state, engine)
        state, taken = fit_level(engine, state, level, watch)
        steps.append(taken)
    fit = report_fit(engine, state, tuple(steps))
    plain = engine.mobius_alone(problem.mobius)
    if not engine.objective(state, weights.gamma) <= (1 + ROUNDING) * engine.objective(plain, weights.gamma):
        fit = instead(fit, report_fit(engine, plain, tuple(steps)))
    words = [f"delta = {weights.delta:g} overfits: choose it by held-out curves"] * (weights.delta > OVERFITS)
    r = np.transpose([features.correlation(plain.f), features.correlation(fit.f)]).tolist()
    return replace(fit, fallbacks=(*fit.fallbacks, *words), r=dict(zip(features.names, r)))


def engine_of(level, problem, weights, features):
    """The Gauss-Newton engine of one level."""
    rings = min(level.rings, rings_for(problem.z))
    mesh = polar_disk(rings, 3 * rings, power=POWER)
    if level.own_mesh:
        return SurfaceGaussNewton(problem, mesh, weights, Dense(features, level.sigma, weights.delta))
    weights, dense = weights.at(min(weights.gamma, GUIDING_GAMMA)), None
    if level.sigma is not None:
        delta = min(weights.delta, GUIDING_DELTA) if level.sigma >= COARSE else weights.delta
        dense = Dense(features, level.sigma, delta, sampling_matrix(*mesh, problem.z))
    return GaussNewton(problem, mesh, weights, dense)


def first_state(engine, start):
    """The state to begin with: the best Möbius map, or that after the map of a coefficient `start`."""
    problem = engine.problem
    state = engine.at(start_field(problem.z, problem.faces, start, engine.z), problem.mobius)
    if start is None or not len(problem.moving):
        return state
    return engine.moved(state, best_mobius(engine.samples @ state.solution.f, problem.target))


def carried(before, state, engine):
    """The state of the next engine with the same field and Möbius map."""
    same = len(engine.z) == len(before.z)
    nu = state.nu if same else sampling_matrix(before.z, before.faces, engine.z) @ state.nu
    return engine.at(nu, state.mobius)


def fit_level(engine, state, level, watch):
    """Steps of one level, as long as they promise enough and the last one has kept it: (state, steps)."""
    worth, settled = (WORTH, SETTLED) if level.own_mesh else (WORTH_ON_GRID, SETTLED_ON_GRID)
    gamma, before = engine.weights.gamma, engine.objective(state, engine.weights.gamma)
    for steps in range(level.steps):
        if watch:
            watch()
        found = engine.step(state, gamma, worth)
        if found is None:
            return state, steps
        state, last, before = found, before, engine.objective(found, gamma)
        if before > settled * last:
            return state, steps + 1
    return state, level.steps
