"""What networks propose, checked before it is used: curves and disk maps, and the exact twin where a check fails.

Every step aside is said in words in a list `fallbacks`. The networks are plain callables, so that any others with the
same calls can stand in their place.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from scipy import sparse

from ..plane.beltrami import beltrami_coefficient, check_coefficient
from ..plane.bijectivity import BijectivityError, check_bijective
from ..plane.diskmesh import boundary_loop, sampling_matrix
from ..plane.fields import unbounded
from ..plane.mobius import best_mobius, mobius
from .fit import ROUNDING, LandmarkFit, MeshForward, fit_landmarks
from .landmarks import detect_curves
from .metrics import measured_losses

ON_VERTEX = 1e-6  # in the unit disk: a curve that ends no farther off its endpoint ends there
POINTS = 256  # that a detected curve is filled up to, so that its length in space is that on the surface
TOLERANCE = 5e-3  # landmark error in the disk above which a network's map is refined: half of what detection leaves
MARGIN = 0.9  # of the tolerance: what refinement aims at, as the report also counts points that curves share


@dataclass(frozen=True)
class Networks:
    """The three learned blocks.

    `detect(surface, z, endpoints (K, 2)) -> list of (k,) complex curves in z`;
    `predict(z, faces, moving, target, alpha=, beta=, gamma=, curve=) -> mu (F,)`; `solve(z, faces, mu) -> f (V,)`.
    """

    detect: Callable
    predict: Callable
    solve: Callable


def guarded_curves(detect, surface, z, entries, side, fallbacks):
    """The curves of one side in its disk map z, list of (k,) complex: as given, by `detect`, or else the shortest path.

    entries as `register.check_curves` returns them. A detected curve is not used where it leaves the disk or misses
    its endpoints, crosses itself, or crosses or touches another one between the ends.
    """
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
    fallbacks += [f"LD-Net's {side} curve {names[k]!r} {fault}: shortest path" for k, fault in faults.items()]
    return lines


def own_fault(line, ends):
    """Why one detected curve cannot be used, in words, or None."""
    if len(line) < 2 or not (np.isfinite(line).all() and abs(line).max() <= 1 + ON_VERTEX):
        return "leaves the disk"
    if abs(line[[0, -1]] - ends).max() > ON_VERTEX:
        return "misses its endpoints"
    return None if path_of(line).is_simple else "crosses itself"


def fill(line):
    """The same polyline with points added between its own, evenly in their number, to POINTS at least."""
    pieces = -(-POINTS // (len(line) - 1))
    return np.interp(np.arange((len(line) - 1) * pieces + 1) / pieces, np.arange(len(line)), line)


def path_of(line):
    return shapely.linestrings(np.stack([line.real, line.imag], axis=1))


def bijective_fit(z, faces, p, q, alpha, beta, gamma, labels, sliding, fallbacks, start=None, enough=0.0):
    """`fit_landmarks` at gamma, or at the next lower power of ten whose map is bijective (reported in fallbacks)."""
    weight = gamma
    while weight >= gamma * 1e-4:
        fit = fit_landmarks(z, faces, p, q, alpha, beta, weight, labels, sliding, start=start, enough=enough)
        if fit.bijective:
            fallbacks += list(fit.fallbacks) + [f"gamma lowered to {weight:g}"] * (weight < gamma)
            return fit
        weight /= 10
    raise BijectivityError(
        f"no bijective map for these landmarks down to gamma = {weight * 10:g} "
        f"({len(fit.flipped)} faces flipped); check that no two curves cross or are swapped"
    )


def guarded_map(networks, z, faces, p, q, alpha, beta, gamma, labels, tolerance, fallbacks, stages):
    """The disk map of landmarks p -> q by CP-Net and DBS-Net, certified and within `tolerance`, as a `LandmarkFit`.

    A folded map: the exact solver on the same mu, mended by row switching. A mean |f(p) - q| above the tolerance, or a
    map that stays folded: Gauss-Newton steps from mu. One whose measured `L_CP` or mean |f(p) - q|^2 is above that of
    the best Möbius map: that map. stages: context managers by name, which take the time.
    """
    with stages("predict"):
        mu = networks.predict(z, faces, p, q, alpha=alpha, beta=beta, gamma=gamma, curve=labels)
    with stages("solve"):
        f = networks.solve(z, faces, mu)
    with stages("certify"):
        evaluate = sampling_matrix(z, faces, p)
        fit = moved_map(z, faces, f, p, q, evaluate=evaluate) if np.isfinite(f).all() else None
        if fit is None or not fit.bijective:
            fallbacks.append(f"DBS-Net's map {fold_words(fit)}: exact solver")
            fit = exact_map(z, faces, mu, p, q)
            fallbacks += fit.fallbacks
    with stages("refine"):
        if fit.bijective and fit.landmark_error <= tolerance:
            return not_above_mobius(fit, z, faces, p, q, (alpha, beta, gamma), evaluate, fallbacks)
        before, words = fit, []
        fit = bijective_fit(
            z, faces, p, q, alpha, beta, gamma, labels, False, words, start=mu, enough=MARGIN * tolerance
        )
        cause = (
            f"landmark error {before.landmark_error:.1e} above {tolerance:.1e}"
            if before.bijective
            else f"the exact solver's map {fold_words(before)}"
        )
        fallbacks += [f"{cause}: {sum(fit.steps)} Gauss-Newton steps, to {fit.landmark_error:.1e}", *words]
        return fit


def not_above_mobius(fit, z, faces, p, q, weights, evaluate, fallbacks):
    """The fit of a network, or the best Möbius map where it is a bijection and better: see `guarded_map`."""
    plain = moved_map(z, faces, z, p, q, evaluate=evaluate)
    losses, squares = [], []
    for candidate in (fit, plain):
        mapped = evaluate @ candidate.f
        losses.append(measured_losses(z, faces, candidate.mu, mapped, q, *weights)["L_CP"])
        squares.append((abs(mapped - q) ** 2).mean())
    if not plain.bijective or all(fitted <= (1 + ROUNDING) * best for fitted, best in (losses, squares)):
        return fit
    fallbacks.append("the networks' map ended above the best Möbius map: that map is returned")
    return plain


def gamma_words(network, alpha, beta, gamma):
    """Words on the gamma that CP-Net answers for where it is not the given one, as a list."""
    used = network.gamma_used(alpha, beta, gamma)
    return [f"CP-Net answered for gamma = {used:.3g}"] if used < gamma else []


def fold_words(fit):
    if fit is None:
        return "was not finite"
    return f"folded {len(fit.flipped)} faces" if len(fit.flipped) else "folded the boundary"


def moved_map(z, faces, f, p, q, fallbacks=(), evaluate=None):
    """M after f (V,), M the disk Möbius map with the least `mean |M(f(p)) - q|^2`, certified or reported: LandmarkFit.

    evaluate: the sampling matrix (M, V) of p, if it is known.
    """
    evaluate, loop = sampling_matrix(z, faces, p) if evaluate is None else evaluate, boundary_loop(faces)
    parameters = best_mobius(evaluate @ f, q)
    f = mobius(f, *parameters)
    f[loop] /= abs(f[loop])
    return measured(z, faces, f, parameters, evaluate @ f, q, fallbacks)


def exact_map(z, faces, mu, p, q):
    """`moved_map` of the exact solver's map for mu (F,); where it folds, rows are switched and it is solved again."""
    forward = MeshForward(z, faces, p, sparse.eye_array(len(faces), format="csr"))
    fit = moved_map(z, faces, forward.solver.solve(mu), p, q, forward.words(), forward.evaluate)
    if fit.bijective:
        return fit
    f = forward.map(unbounded(check_coefficient(mu, len(faces))), fit.mobius)
    return measured(z, faces, f, fit.mobius, forward.points, q, forward.words())


def measured(z, faces, f, parameters, mapped, q, fallbacks):
    """A map as a `LandmarkFit` without steps and losses: its measured mu, landmark error and certificate."""
    certificate = check_bijective(z, faces, f)
    return LandmarkFit(
        f,
        beltrami_coefficient(z, faces, f),
        parameters,
        float(abs(mapped - q).mean()),
        certificate.bijective,
        certificate.flipped,
        (0, 0),
        {},
        tuple(fallbacks),
    )
