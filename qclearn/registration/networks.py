"""Disk maps of networks, checked before use; where a check fails, the exact solver and the fit
replace them, with a message.

Networks are plain callables; any others with the same calls can stand in their place:
`detect(surface, z, endpoints (K, 2)) -> list of (k,) complex curves in z`; `predict(z, faces,
moving, target, alpha=, beta=, gamma=, curve=) -> mu (F,)`; `solve(z, faces, mu) -> f (V,)`.
"""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np

from .fit import exact_map, fit_with_fallbacks, is_above, moved_map
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
    # Where DBS-Net's map folds or is not finite, the exact map of mu, which may fold, too.
    with stages("certify"):
        network_map = moved_map(problem, f) if np.isfinite(f).all() else None
        if network_map is None or not network_map.bijective:
            message = f"DBS-Net's map {fold_message(network_map)}: exact solver"
            exact = exact_map(problem, mu)
            network_map = replace(exact, fallbacks=(message, *exact.fallbacks))
    with stages("refine"):
        return refined(problem, weights, mu, network_map, tolerance)


def refined(problem, weights, mu, network_map, tolerance):
    """The networks' map, or a fit from their mu where it folds or exceeds the tolerance; or the
    best Möbius map where that is bijective and the networks' lies above it, in L_CP or in mean
    |f(p) - q|^2."""
    error = network_map.landmark_error
    if not network_map.bijective or error > tolerance:
        cause = f"landmark error {error:.1e} above {tolerance:.1e}"
        if not network_map.bijective:
            cause = f"the exact solver's map {fold_message(network_map)}"
        fit = fit_with_fallbacks(problem, weights, mu, enough=MARGIN * tolerance)
        message = f"{cause}: {sum(fit.steps)} Gauss-Newton steps, to {fit.landmark_error:.1e}"
        switched = max(network_map.switched, fit.switched)
        fallbacks = (*network_map.fallbacks, message, *fit.fallbacks)
        return replace(fit, fallbacks=fallbacks, switched=switched)

    def sizes(candidate):
        mapped = problem.samples @ candidate.f
        loss = measured_losses(problem, weights, candidate.mu, mapped)["L_CP"]
        return loss, (abs(mapped - problem.target) ** 2).mean()

    plain = moved_map(problem, problem.disk.z)
    if not plain.bijective or not is_above(sizes(network_map), sizes(plain)):
        return network_map
    message = "the networks' map ended above the best Möbius map: that map is returned"
    fallbacks = (*network_map.fallbacks, message)
    return replace(plain, fallbacks=fallbacks, switched=network_map.switched)


def fold_message(network_map):
    if network_map is None:
        return "was not finite"
    folded = len(network_map.flipped)
    return f"folded {folded} faces" if folded else "folded the boundary"
