"""The library's own fit of landmarks: Gauss-Newton on nodal coefficients."""

from threadpoolctl import threadpool_limits

from ..diskmesh import polar_disk
from ..fit import Forward, GaussNewton, Landmarks, MeshForward, descend, fit_landmarks, sampling_matrix, start_field
from ..mobius import best_mobius, mobius
from .problem import report

RINGS = 32


def gauss_newton(problem, alpha=1.0, beta=1e-2, gamma=1e5, sliding=False):
    """`fit_landmarks`: the least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2`, f (V,).

    sliding: inner points of a curve may move along their target curve. A RepairWarning says if rows were switched.
    Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    fit = fit_landmarks(problem.z, problem.faces, problem.moving, problem.target, alpha, beta, gamma, problem.curve, sliding)
    report(fit.fallbacks)
    return fit.f


@threadpool_limits.wrap(limits=1)
def few_steps(problem, mu, steps, alpha=1.0, beta=1e-2, gamma=1e5):
    """At most `steps` steps of the same fit from mu (F,), on the polar mesh of 32 x 96, then one exact solve: f (V,).

    At last the disk Möbius map is fitted again, on the disk mesh itself. A RepairWarning says if rows were switched.
    """
    z, faces, target = problem.z, problem.faces, problem.target
    grid, triangles = polar_disk(RINGS, 3 * RINGS, power=1.4)
    newton = GaussNewton(grid, triangles, Landmarks(target, problem.curve, False), alpha, beta)
    forward = Forward(grid, triangles, problem.moving, sampling_matrix(grid, triangles, grid[triangles].mean(1)))
    nu = start_field(z, faces, mu, grid)
    forward.map(nu, (0j, 0.0))
    parameters = best_mobius(forward.points, target)
    for _ in range(steps):
        step = newton.prepare(nu, forward, parameters, gamma)
        taken = descend(newton, forward, step, nu, parameters, gamma)
        if taken is None:
            break
        nu, parameters, _ = taken
    last = MeshForward(z, faces, problem.moving, sampling_matrix(grid, triangles, z[faces].mean(1)))
    f = last.map(nu, parameters)
    report(last.words())
    return mobius(f, *best_mobius(last.points, target))
