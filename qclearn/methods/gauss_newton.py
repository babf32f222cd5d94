"""The library's own fit of landmarks: Gauss-Newton on nodal coefficients."""

import numpy as np
from threadpoolctl import threadpool_limits

from ..plane.beltrami import corner_average, face_mean, signed_areas
from ..plane.diskmesh import polar_disk, sampling_matrix
from ..plane.fields import bounded, unbounded
from ..plane.mobius import best_mobius
from ..registration.checked import exact_map
from ..registration.fit import Forward, GaussNewton, Landmarks, descend, fit_landmarks, fit_on_grid
from .problem import report

COARSE, MESH = polar_disk(24, 72, power=1.4), polar_disk(32, 96, power=1.4)  # of CP-Net, and of the few steps


def gauss_newton(problem, alpha=1.0, beta=1e-2, gamma=1e5, sliding=False, rings=None):
    """`fit_landmarks`: the least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2`, f (V,).

    sliding: inner points of a curve may move along their target curve; rings: of the mesh that carries nu. A
    RepairWarning says if rows were switched.
    Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    fit = fit_landmarks(
        problem.z,
        problem.faces,
        problem.moving,
        problem.target,
        alpha,
        beta,
        gamma,
        problem.curve,
        sliding,
        rings=rings,
    )
    report(fit.fallbacks)
    return fit.f


def on_mesh(problem, mesh, alpha, beta):
    """The fit's state on a polar mesh (z, faces) that also carries nu: (GaussNewton, Forward)."""
    z, faces = mesh
    return (
        GaussNewton(z, faces, Landmarks(problem.target, problem.curve, False), alpha, beta),
        Forward(z, faces, problem.moving, face_mean(faces, len(z))),
    )


@threadpool_limits.wrap(limits=1)
def coarse_steps(problem, steps=1, alpha=1.0, beta=1e-2, gamma=1e5):
    """`few_steps` from the same fit on a coarse polar mesh, run until it settles there: CP-Net's exact twin, f (V,)."""
    (grid, triangles), (newton, forward) = COARSE, on_mesh(problem, COARSE, alpha, beta)
    nu, _, _ = fit_on_grid(newton, forward, np.zeros(len(grid), complex), problem.mobius, gamma, None)
    finer, faces = MESH
    mu = bounded(sampling_matrix(grid, triangles, finer[faces].mean(1)) @ nu)
    return few_steps(problem, mu, steps, alpha, beta, gamma)


@threadpool_limits.wrap(limits=1)
def few_steps(problem, mu, steps, alpha=1.0, beta=1e-2, gamma=1e5):
    """At most `steps` steps of the same fit from mu on the faces of MESH, there, then one exact solve: f (V,).

    The disk Möbius map is fitted again at last, on the disk mesh itself. A RepairWarning says if rows were switched.
    """
    (grid, triangles), (newton, forward) = MESH, on_mesh(problem, MESH, alpha, beta)
    nu = corner_average(triangles, len(grid), signed_areas(grid, triangles)) @ unbounded(mu)
    forward.map(nu, (0j, 0.0))
    parameters = best_mobius(forward.points, problem.target)
    for _ in range(steps):
        step = newton.prepare(nu, forward, parameters, gamma)
        taken = descend(newton, forward, step, nu, parameters, gamma)
        if taken is None:
            break
        nu, parameters, _ = taken
    z, faces = problem.z, problem.faces
    fit = exact_map(
        z, faces, bounded(sampling_matrix(grid, triangles, z[faces].mean(1)) @ nu), problem.moving, problem.target
    )
    report(fit.fallbacks)
    return fit.f
