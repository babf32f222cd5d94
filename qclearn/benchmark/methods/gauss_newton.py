"""The library's own fit of landmarks: Gauss-Newton on nodal coefficients."""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ...plane.coefficients import bounded, unbounded
from ...plane.grids import COARSE, FINE, polar
from ...registration.fit import exact_map, fit_problem
from ...registration.levels import Level, MultiresolutionFit, run_level
from ...registration.problem import Weights
from .solver import warn_of


def gauss_newton(
    problem, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma, sliding=False, rings=None
):
    """`fit_landmarks`: the least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) -
    q|^2`, f (V,).

    sliding: inner points of a curve may move along their target curve; rings: of the mesh that
    carries nu. A RepairWarning says if rows were switched. Source: paper, eq. RegLoss; Gauss-Newton
    in its dual form.
    """
    problem = replace(problem, sliding=sliding or problem.sliding)
    fit = fit_problem(problem, Weights(alpha, beta, gamma), rings=rings)
    warn_of(fit.fallbacks)
    return fit.f


@threadpool_limits.wrap(limits=1)
def coarse_steps(problem, steps=1, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma):
    """`few_steps` from the fit settled on a coarse polar mesh: CP-Net's exact counterpart (V,)."""
    weights = Weights(alpha, beta, gamma)
    level = Level(COARSE[0], None, 5, rising=True)
    mesh = polar(*COARSE)
    objective = MultiresolutionFit(problem).objective(level, weights)
    start = objective.at(np.zeros(len(mesh.z), complex), problem.mobius)
    state, _ = run_level(objective, start, level)
    mu = bounded(mesh.interpolation(polar(*FINE).centroids) @ state.nu)
    return few_steps(problem, mu, steps, weights)


@threadpool_limits.wrap(limits=1)
def few_steps(problem, mu, steps, weights):
    """Up to `steps` steps of the fit on `polar(*FINE)` from mu (F,), then one exact solve: f (V,).

    The solve fits the disk Möbius map again. A RepairWarning says if rows were switched.
    """
    mesh = polar(*FINE)
    objective = MultiresolutionFit(problem).objective(Level(FINE[0], None, steps), weights)
    begin = objective.at(mesh.to_vertices @ unbounded(mu), (0j, 0.0))
    state = objective.aligned(begin)
    for _ in range(steps):
        after = objective.step(state, weights.gamma)
        if after is None:
            break
        state = after
    result = exact_map(problem, bounded(mesh.interpolation(problem.disk.centroids) @ state.nu))
    warn_of(result.fallbacks)
    return result.f
