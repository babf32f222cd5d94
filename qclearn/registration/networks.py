"""Curves and disk maps of networks, checked before use; where a check fails, the exact twin and a
word replace them.

Networks are plain callables; any others with the same calls can stand in their place:
`detect(surface, z, endpoints (K, 2)) -> list of (k,) complex curves in z`; `predict(z, faces,
moving, target, alpha=, beta=, gamma=, curve=) -> mu (F,)`; `solve(z, faces, mu) -> f (V,)`.
"""

from contextlib import nullcontext
from dataclasses import asdict, replace

import numpy as np

from .fit import ROUNDING, exact_map, fit_with_fallbacks, moved_map
from .metrics import measured_losses

# Landmark error in the disk above which a network's map is refined: half of what detection leaves.
TOLERANCE = 5e-3
# Of the tolerance: what refinement aims at, as the report also counts points that curves share.
MARGIN = 0.9


def predicted(predict, problem, weights):
    """The mu (F,) that a network's `predict` answers for a problem."""
    known = {
        name: value for name, value in asdict(weights).items() if name in ("alpha", "beta", "gamma")
    }
    disk = problem.disk
    return predict(disk.z, disk.faces, problem.moving, problem.target, curve=problem.curve, **known)


def certified_network_map(predict, solve, problem, weights, tolerance, stages=nullcontext):
    """The disk map of a problem by CP-Net and DBS-Net within `tolerance`: CertifiedMap. Parts run
    in `stages(name)`."""
    with stages("predict"):
        mu = predicted(predict, problem, weights)
    with stages("solve"):
        f = solve(problem.disk.z, problem.disk.faces, mu)
    with stages("certify"):
        found = unfolded(problem, mu, f)
    with stages("refine"):
        return refined(problem, weights, mu, found, tolerance)


def unfolded(problem, mu, f):
    """`moved_map` of DBS-Net's f (V,), or where that folds `exact_map` of mu (F,): CertifiedMap."""
    found = moved_map(problem, f) if np.isfinite(f).all() else None
    if found is not None and found.bijective:
        return found
    exact = exact_map(problem, mu)
    return replace(
        exact, fallbacks=(f"DBS-Net's map {fold_message(found)}: exact solver", *exact.fallbacks)
    )


def refined(problem, weights, mu, found, tolerance):
    """`not_above_mobius` of the networks' map, or a fit from their mu where it folds or exceeds the
    tolerance."""
    if found.bijective and found.landmark_error <= tolerance:
        return not_above_mobius(problem, weights, found)
    fit = fit_with_fallbacks(problem, weights, start=mu, enough=MARGIN * tolerance)
    large = f"landmark error {found.landmark_error:.1e} above {tolerance:.1e}"
    cause = large if found.bijective else f"the exact solver's map {fold_message(found)}"
    word = f"{cause}: {sum(fit.steps)} Gauss-Newton steps, to {fit.landmark_error:.1e}"
    switched = max(found.switched, fit.switched)
    return replace(fit, fallbacks=(*found.fallbacks, word, *fit.fallbacks), switched=switched)


def not_above_mobius(problem, weights, found):
    """The networks' map, or the best Möbius map if it is bijective and lower in L_CP or in mean
    |f(p) - q|^2."""
    plain = moved_map(problem, problem.disk.z)
    losses, squares = [], []
    for candidate in (found, plain):
        mapped = problem.samples @ candidate.f
        losses.append(measured_losses(problem, weights, candidate.mu, mapped)["L_CP"])
        squares.append((abs(mapped - problem.target) ** 2).mean())
    if not plain.bijective or all(
        fitted <= (1 + ROUNDING) * best for fitted, best in (losses, squares)
    ):
        return found
    word = "the networks' map ended above the best Möbius map: that map is returned"
    return replace(plain, fallbacks=(*found.fallbacks, word), switched=found.switched)


def gamma_messages(network, weights):
    """Words on the gamma that CP-Net answers for where it is below the given one, as a list."""
    used = network.gamma_used(weights)
    return [f"CP-Net answered for gamma = {used:.3g}"] if used < weights.gamma else []


def fold_message(found):
    if found is None:
        return "was not finite"
    return f"folded {len(found.flipped)} faces" if len(found.flipped) else "folded the boundary"
