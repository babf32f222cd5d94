"""The library's own fit of landmarks: Gauss-Newton on nodal coefficients."""

from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ..plane.beltrami import corner_average, signed_areas
from ..plane.diskmesh import polar_disk, sampling_matrix
from ..plane.fields import bounded, unbounded
from ..plane.mobius import best_mobius
from ..registration.certified import exact_map
from ..registration.engine import GaussNewton
from ..registration.fit import POWER, fit_on_grid, fit_problem
from ..registration.problem import Weights
from .solver import report

COARSE, MESH = polar_disk(24, 72, POWER), polar_disk(32, 96, POWER)  # of CP-Net, and of the few steps


def gauss_newton(problem, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma, sliding=False, rings=None):
    """`fit_landmarks`: the least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2`, f (V,).

    sliding: inner points of a curve may move along their target curve; rings: of the mesh that carries nu. A
    RepairWarning says if rows were switched.
    Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    fit = fit_problem(replace(problem, sliding=sliding or problem.sliding), Weights(alpha, beta, gamma), rings=rings)
    report(fit.fallbacks)
    return fit.f


@threadpool_limits.wrap(limits=1)
def coarse_steps(problem, steps=1, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma):
    """`few_steps` from the same fit on a coarse polar mesh, run until it settles there: CP-Net's exact twin, f (V,)."""
    weights, (grid, triangles), (finer, faces) = Weights(alpha, beta, gamma), COARSE, MESH
    engine = GaussNewton(problem, COARSE, weights)
    state, _ = fit_on_grid(engine, engine.at(np.zeros(len(grid), complex), problem.mobius), gamma)
    mu = bounded(sampling_matrix(grid, triangles, finer[faces].mean(1)) @ state.nu)
    return few_steps(problem, mu, steps, weights)


@threadpool_limits.wrap(limits=1)
def few_steps(problem, mu, steps, weights):
    """At most `steps` steps of the same fit from mu on the faces of MESH, there, then one exact solve: f (V,).

    The disk Möbius map is fitted again at last, on the disk mesh itself. A RepairWarning says if rows were switched.
    """
    (grid, triangles), (z, faces) = MESH, (problem.z, problem.faces)
    engine = GaussNewton(problem, MESH, weights)
    state = engine.at(corner_average(triangles, len(grid), signed_areas(grid, triangles)) @ unbounded(mu), (0j, 0.0))
    state = engine.moved(state, best_mobius(state.points, problem.target))
    for _ in range(steps):
        found = engine.step(state, weights.gamma)
        if found is None:
            break
        state = found
    found = exact_map(problem, bounded(sampling_matrix(grid, triangles, z[faces].mean(1)) @ state.nu))
    report(found.fallbacks)
    return found.f
