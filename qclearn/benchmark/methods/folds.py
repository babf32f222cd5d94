"""The library's fit to folds: with landmarks, after their Möbius map alone, and without them."""

from dataclasses import replace

from ...plane.mobius import mobius
from ...registration import diagnose
from ...registration.fit import fit_with_fallbacks
from ...registration.problem import DELTA, ETA, LandmarkError, Problem, Weights
from ...registration.start import align_disks, sample_landmarks
from ...surfaces.conformal import repair_folds
from .solver import warn_of


def hybrid(
    problem, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma, delta=DELTA, eta=ETA
):
    """Landmarks and folds in one fit, the default of `register`: f (V,).

    The least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2 + delta` times
    the mismatch of the folds, from coarse features to fine ones. A RepairWarning says if rows were
    switched or weights lowered.
    """
    return by_folds(problem, Weights(alpha, beta, gamma, delta, eta))


def dense(problem, alpha=Weights.alpha, beta=Weights.beta, delta=DELTA, eta=ETA):
    """`hybrid` with gamma = 0: folds alone, from the landmarks' best Möbius map on, f (V,)."""
    pair = pair_of(problem)
    disk = repair_folds(pair.moving.surface, mobius(problem.disk.z, *problem.mobius))
    problem = Problem(disk, [], [], fewest=0, pair=pair)
    return by_folds(problem, Weights(alpha, beta, delta=delta, eta=eta))


def landmark_free(problem, alpha=Weights.alpha, beta=Weights.beta, delta=DELTA, eta=ETA):
    """Folds alone, from the Möbius map that fits them best, without landmarks: f (V,)."""
    pair = align_disks(replace(with_folds(problem), curves=[], held=[]))
    weights = Weights(alpha, beta, delta=delta, eta=eta)
    return by_folds(sample_landmarks(pair), weights, pair)


def by_folds(problem, weights, pair=None):
    """The fit of a problem whose disk may be another than its pair's moving one."""
    pair = pair or with_folds(problem)
    pair = replace(pair, moving=replace(pair.moving, disk=problem.disk))
    fit = fit_with_fallbacks(replace(problem, pair=pair), weights, features=pair.features)
    warn_of(fit.fallbacks)
    return fit.f


def with_folds(problem):
    """A problem's pair with its folds, computed anew: such a fit's time includes them."""
    return diagnose.with_folds(replace(pair_of(problem), features=None))


def pair_of(problem):
    if problem.pair is None:
        message = "this method looks at folds, and the problem has landmarks alone"
        raise LandmarkError(f"{message}: give it `pair`")
    return problem.pair
