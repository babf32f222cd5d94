"""The library's own fit of landmarks: Gauss-Newton on nodal coefficients."""

import warnings

from ..bijectivity import RepairWarning
from ..fit import fit_landmarks


def gauss_newton(problem, alpha=1.0, beta=1e-2, gamma=1e5, sliding=False):
    """`fit_landmarks`: the least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2`, f (V,).

    sliding: inner points of a curve may move along their target curve. A RepairWarning says if rows were switched.
    Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    fit = fit_landmarks(problem.z, problem.faces, problem.moving, problem.target, alpha, beta, gamma, problem.curve, sliding)
    for word in fit.fallbacks:
        warnings.warn(word, RepairWarning, stacklevel=2)
    return fit.f
