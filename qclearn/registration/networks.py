"""Disk maps of networks, checked before use; where a check fails, the exact solver and the fit
replace them, with a message.

Networks are plain callables; any others with the same calls can stand in their place:
`detect(surface, z, endpoints (K, 2)) -> list of (k,) complex curves in z`; `predict(z, faces,
moving, target, alpha=, beta=, gamma=, curve=) -> mu (F,)`; `solve(z, faces, mu) -> f (V,)`.
"""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from .fit import ROUNDING, exact_map, fit_with_fallbacks, moved_map
from .report import measured_losses

# Landmark error in the disk above which a network's map is refined: half of what detection leaves.
TOLERANCE = 5e-3
# Of the tolerance: what refinement aims at, as the report also counts points that curves share.
MARGIN = 0.9


def predicted(predict, problem, weights):
    """The mu (F,) that a network's `predict` answers for a problem."""
    return predict(
        problem.disk.z,
        problem.disk.faces,
        problem.moving,
        problem.target,
        curve=problem.curve,
        alpha=weights.alpha,
        beta=weights.beta,
        gamma=weights.gamma,
    )


def certified_network_map(predict, solve, problem, weights, tolerance, stages=nullcontext):
    """The disk map of a problem by CP-Net and DBS-Net within `tolerance`, a bijection: CheckedMap.
    Parts run in `stages(name)`. BijectivityError if the fit finds none."""
    with stages("predict"):
        mu = predicted(predict, problem, weights)
    with stages("solve"):
        f = solve(problem.disk.z, problem.disk.faces, mu)
    with stages("certify"):
        network_map = exact_if_folded(problem, mu, f)
    with stages("refine"):
        return refined(problem, weights, mu, network_map, tolerance)


def exact_if_folded(problem, mu, f):
    """`moved_map` of DBS-Net's f (V,), or where that folds or is not finite `exact_map` of mu
    (F,): CheckedMap, which may fold, too."""
    network_map = moved_map(problem, f) if np.isfinite(f).all() else None
    if network_map is not None and network_map.bijective:
        return network_map
    exact = exact_map(problem, mu)
    message = f"DBS-Net's map {fold_message(network_map)}: exact solver"
    return replace(exact, fallbacks=(message, *exact.fallbacks))


def refined(problem, weights, mu, network_map, tolerance):
    """`not_above_mobius` of the networks' map, or a fit from their mu where it folds or exceeds the
    tolerance."""
    error = network_map.landmark_error
    if not network_map.bijective:
        cause = f"the exact solver's map {fold_message(network_map)}"
    elif error <= tolerance:
        return not_above_mobius(problem, weights, network_map)
    else:
        cause = f"landmark error {error:.1e} above {tolerance:.1e}"
    fit = fit_with_fallbacks(problem, weights, mu, enough=MARGIN * tolerance)
    message = f"{cause}: {sum(fit.steps)} Gauss-Newton steps, to {fit.landmark_error:.1e}"
    switched = max(network_map.switched, fit.switched)
    fallbacks = (*network_map.fallbacks, message, *fit.fallbacks)
    return replace(fit, fallbacks=fallbacks, switched=switched)


def not_above_mobius(problem, weights, network_map):
    """The networks' map, or the best Möbius map if it is bijective and lower in L_CP or in mean
    |f(p) - q|^2."""
    plain = moved_map(problem, problem.disk.z)

    def sizes(candidate):
        mapped = problem.samples @ candidate.f
        loss = measured_losses(problem, weights, candidate.mu, mapped)["L_CP"]
        return loss, (abs(mapped - problem.target) ** 2).mean()

    pairs = zip(sizes(network_map), sizes(plain))
    if not plain.bijective or all(size <= (1 + ROUNDING) * best for size, best in pairs):
        return network_map
    message = "the networks' map ended above the best Möbius map: that map is returned"
    fallbacks = (*network_map.fallbacks, message)
    return replace(plain, fallbacks=fallbacks, switched=network_map.switched)


def gamma_messages(network, weights):
    """Messages on the gamma that CP-Net answers for where it is below the given one, as a list."""
    used = network.gamma_used(weights)
    return [f"CP-Net answered for gamma = {used:.3g}"] if used < weights.gamma else []


def fold_message(network_map):
    if network_map is None:
        return "was not finite"
    folded = len(network_map.flipped)
    return f"folded {folded} faces" if folded else "folded the boundary"
