"""Curves and disk maps of networks, checked before use; where a check fails, the exact twin and a word replace them.

Networks are plain callables; any others with the same calls can stand in their place:
`detect(surface, z, endpoints (K, 2)) -> list of (k,) complex curves in z`;
`predict(z, faces, moving, target, alpha=, beta=, gamma=, curve=) -> mu (F,)`; `solve(z, faces, mu) -> f (V,)`.
"""

from contextlib import nullcontext
from dataclasses import asdict, replace
from itertools import combinations

import numpy as np
import shapely

from ..plane.bijectivity import BijectivityError
from .fit import ROUNDING, exact_map, fit_problem, fit_registration, moved_map
from .landmarks import detect_curves
from .metrics import measured_losses

ON_VERTEX = 1e-6  # in the unit disk: a curve that ends no farther off its endpoint ends there
POINTS = 256  # that a detected curve is filled up to, so that its length in space is that on the surface
TOLERANCE = 5e-3  # landmark error in the disk above which a network's map is refined: half of what detection leaves
MARGIN = 0.9  # of the tolerance: what refinement aims at, as the report also counts points that curves share


def guarded_curves(detect, own, entries, side):
    """The curves (k,) of a `Side`, "moving" or "control", in its disk, as given or by `detect`: two lists, curves and
    words. The shortest path replaces a detected curve that has an `own_fault`, or crosses or touches another one."""
    surface, z = own.surface, own.disk.z
    lines, names = [z[entry[side]] for entry in entries], [entry["name"] for entry in entries]
    wanted = [k for k, entry in enumerate(entries) if entry["detect"][side]]
    found = detect(surface, z, np.array([entries[k][side] for k in wanted])) if wanted else []
    for k, line in zip(wanted, found, strict=True):
        lines[k] = np.asarray(line, complex)
    faults = {k: fault for k in wanted if (fault := own_fault(lines[k], z[entries[k][side]]))}
    for pair in combinations([k for k in range(len(lines)) if k not in faults], 2):
        if path_of(lines[pair[0]]).crosses(path_of(lines[pair[1]])):
            faults |= {k: f"crosses or touches {names[other]!r}" for k, other in (pair, pair[::-1]) if k in wanted}
    shortest = iter(detect_curves(surface, z, [entries[k][side] for k in sorted(faults)]) if faults else [])
    lines = [next(shortest) if k in faults else fill(line) if k in wanted else line for k, line in enumerate(lines)]
    return lines, [f"LD-Net's {side} curve {names[k]!r} {fault}: shortest path" for k, fault in faults.items()]


def own_fault(line, ends):
    """Why a detected curve cannot be used, in words, or None."""
    if len(line) < 2 or not (np.isfinite(line).all() and abs(line).max() <= 1 + ON_VERTEX):
        return "leaves the disk"
    if abs(line[[0, -1]] - ends).max() > ON_VERTEX:
        return "misses its endpoints"
    return None if path_of(line).is_simple else "crosses itself"


def fill(line):
    """The polyline with equally many points added to each piece, to POINTS at least."""
    pieces = -(-POINTS // (len(line) - 1))
    return np.interp(np.arange((len(line) - 1) * pieces + 1) / pieces, np.arange(len(line)), line)


def path_of(line):
    return shapely.linestrings(np.stack([line.real, line.imag], axis=1))


def bijective_fit(problem, weights, start=None, enough=0.0, features=None):
    """`fit_problem`, or with `Features` `fit_registration`, at the first `rungs` of weights whose map is bijective."""
    for rung in rungs(weights, problem, features):
        if features is None:
            fit = fit_problem(problem, rung, start=start, enough=enough)
        else:
            fit = fit_registration(problem, rung, features, start)
        if fit.bijective:
            lowered = [name for name in ("delta", "gamma") if getattr(rung, name) < getattr(weights, name)]
            words = [f"{name} lowered to {getattr(rung, name):g}" for name in lowered]
            return replace(fit, fallbacks=(*fit.fallbacks, *words))
    found = f"gamma = {rung.gamma:g}" if len(problem.moving) else f"delta = {rung.delta:g}"
    advice = "no two curves cross or are swapped" if len(problem.moving) else "the features of both sides agree"
    raise BijectivityError(
        f"no bijective map for these {'landmarks' if len(problem.moving) else 'features'} down to {found} "
        f"({len(fit.flipped)} faces flipped); check that {advice}"
    )


def rungs(weights, problem, features):
    """The weights to try in turn: lower delta once, then gamma by powers of ten; without landmarks delta alone."""
    yield weights
    if features is not None:
        for _ in range(1 if len(problem.moving) else 4):
            weights = replace(weights, delta=weights.delta / 4)
            yield weights
    if len(problem.moving):
        for power in range(1, 5):
            yield weights.at(weights.gamma / 10**power)


def predicted(predict, problem, weights):
    """The mu (F,) that a network's `predict` answers for a problem."""
    known = {name: value for name, value in asdict(weights).items() if name in ("alpha", "beta", "gamma")}
    disk = problem.disk
    return predict(disk.z, disk.faces, problem.moving, problem.target, curve=problem.curve, **known)


def guarded_map(predict, solve, problem, weights, tolerance, stages=nullcontext):
    """The disk map of a problem by CP-Net and DBS-Net within `tolerance`: CertifiedMap. Parts run in `stages(name)`."""
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
    return replace(exact, fallbacks=(f"DBS-Net's map {fold_words(found)}: exact solver", *exact.fallbacks))


def refined(problem, weights, mu, found, tolerance):
    """`not_above_mobius` of the networks' map, or a fit from their mu where it folds or exceeds the tolerance."""
    if found.bijective and found.landmark_error <= tolerance:
        return not_above_mobius(problem, weights, found)
    fit = bijective_fit(problem, weights, start=mu, enough=MARGIN * tolerance)
    large = f"landmark error {found.landmark_error:.1e} above {tolerance:.1e}"
    cause = large if found.bijective else f"the exact solver's map {fold_words(found)}"
    word = f"{cause}: {sum(fit.steps)} Gauss-Newton steps, to {fit.landmark_error:.1e}"
    switched = max(found.switched, fit.switched)
    return replace(fit, fallbacks=(*found.fallbacks, word, *fit.fallbacks), switched=switched)


def not_above_mobius(problem, weights, found):
    """The networks' map, or the best Möbius map if it is bijective and lower in L_CP or in mean |f(p) - q|^2."""
    plain = moved_map(problem, problem.disk.z)
    losses, squares = [], []
    for candidate in (found, plain):
        mapped = problem.samples @ candidate.f
        losses.append(measured_losses(problem, weights, candidate.mu, mapped)["L_CP"])
        squares.append((abs(mapped - problem.target) ** 2).mean())
    if not plain.bijective or all(fitted <= (1 + ROUNDING) * best for fitted, best in (losses, squares)):
        return found
    word = "the networks' map ended above the best Möbius map: that map is returned"
    return replace(plain, fallbacks=(*found.fallbacks, word), switched=found.switched)


def gamma_words(network, weights):
    """Words on the gamma that CP-Net answers for where it is below the given one, as a list."""
    used = network.gamma_used(weights)
    return [f"CP-Net answered for gamma = {used:.3g}"] if used < weights.gamma else []


def fold_words(found):
    if found is None:
        return "was not finite"
    return f"folded {len(found.flipped)} faces" if len(found.flipped) else "folded the boundary"
