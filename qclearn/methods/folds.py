"""The library's fit with the folds of both surfaces: beside landmarks, after their Möbius map, and without them."""

from dataclasses import replace

from ..registration.checked import bijective_fit
from ..registration.features import FOLDS, Features, check_features
from ..registration.preparation import lay_upon, moved_disk, sampled
from ..registration.problem import DELTA, LandmarkError, Problem, Weights
from .solver import report


def hybrid(problem, alpha=Weights.alpha, beta=Weights.beta, gamma=Weights.gamma, delta=DELTA):
    """Landmarks and folds in one fit, the default of `register`: f (V,).

    The least `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2 + delta` times the mismatch of depth
    and curvature, from coarse features to fine ones. A RepairWarning says if rows were switched or weights lowered.
    """
    return by_folds(problem, Weights(alpha, beta, gamma, delta))


def dense(problem, alpha=Weights.alpha, beta=Weights.beta, delta=DELTA):
    """`hybrid` with gamma = 0: folds alone, from the landmarks' best Möbius map on, f (V,)."""
    sides = sides_of(problem)
    z, _ = moved_disk(sides.moving, problem.z, problem.mobius)
    return by_folds(Problem(z, problem.faces, [], [], fewest=0, sides=sides), Weights(alpha, beta, delta=delta))


def landmark_free(problem, alpha=Weights.alpha, beta=Weights.beta, delta=DELTA):
    """Folds alone, from the Möbius map that they give themselves: no landmark is looked at, f (V,)."""
    sides = replace(sides_of(problem), entries=[], held=[], features=features_of(problem))
    lay_upon(sides)
    return by_folds(sampled(sides).problem, Weights(alpha, beta, delta=delta), sides.features)


def by_folds(problem, weights, features=None):
    fit = bijective_fit(problem, weights, features=features or features_of(problem))
    report(fit.fallbacks)
    return fit.f


def features_of(problem):
    """Depth and curvature of both sides of a problem, computed anew: they are part of what such a fit costs."""
    sides = sides_of(problem)
    maps = check_features(FOLDS, sides.moving, sides.control)
    return Features(sides.moving, sides.control, sides.z_control, maps)


def sides_of(problem):
    if problem.sides is None:
        raise LandmarkError("this method looks at folds, and the problem has landmarks alone: give it `sides`")
    return problem.sides
