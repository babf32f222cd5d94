"""Möbius maps of the unit disk: the conformal freedom that a Beltrami coefficient does not see."""

import numpy as np
import scipy
from jaxtyping import Complex, Float
from numpy import ndarray

# Of `nearest_mobius`: least, first and largest damping, relative; rounding of a sum of squares; a
# step too short.
DAMPING, ROUNDING, STILL = (1e-9, 1e-3, 1e6), 1e-14, 1e-15


def mobius(
    z: Complex[ndarray, " *P"],
    a: Complex[ndarray, " *#P"] = 0.0,
    theta: Float[ndarray, " *#P"] = 0.0,
) -> Complex[ndarray, " *P"]:
    """The disk Möbius map `exp(i theta) (z - a) / (1 - conj(a) z)`, which sends a to 0; theta in
    radians."""
    return np.exp(1j * theta) * (z - a) / (1 - np.conj(a) * z)


def mobius_inverse(
    w: Complex[ndarray, " *P"],
    a: Complex[ndarray, " *#P"] = 0.0,
    theta: Float[ndarray, " *#P"] = 0.0,
) -> Complex[ndarray, " *P"]:
    """Inverse of `mobius(., a, theta)`."""
    w = np.exp(-1j * theta) * w
    return (w + a) / (1 + np.conj(a) * w)


def mobius_slope(z, a=0.0, theta=0.0):
    """Derivative `exp(i theta) (1 - |a|^2) / (1 - conj(a) z)^2` of `mobius(., a, theta)` at z."""
    return np.exp(1j * theta) * (1 - abs(a) ** 2) / (1 - np.conj(a) * z) ** 2


def mobius_fields(w):
    """Changes of points w (..., P) with a Möbius increment (dtheta, Re da, Im da) after them, (...,
    P, 3).

    As a composition: `dw = i w dtheta - da + conj(da) w^2`.
    """
    return np.stack([1j * w, w**2 - 1, -1j * (1 + w**2)], axis=-1)


def best_mobius(
    p: Complex[ndarray, " M"],
    q: Complex[ndarray, " M"],
    weights: Float[ndarray, " M"] | None = None,
) -> tuple[complex, float]:
    """The disk Möbius map, as (a, theta), that minimises `mean |M(p) - q|^2` over points of the
    unit disk.

    Least squares over `s` in the plane with `a = s / sqrt(1 + |s|^2)`, which keeps |a| < 1, from
    eight rotations, so that a large turn between the point sets does not end in a local minimum.
    """
    p, q = np.asarray(p, complex), np.asarray(q, complex)
    scale = np.ones(len(p)) if weights is None else np.sqrt(np.asarray(weights) / np.mean(weights))

    def unpack(x):
        s = x[0] + 1j * x[1]
        return s / np.sqrt(1 + abs(s) ** 2), x[2]

    def residual(x):
        r = scale * (mobius(p, *unpack(x)) - q)
        return np.concatenate([r.real, r.imag])

    def jacobian(x):
        (a, theta), s = unpack(x), x[0] + 1j * x[1]
        w, g = mobius(p, a, theta), 1 / np.sqrt(1 + abs(s) ** 2)
        by_a, by_conj_a = -np.exp(1j * theta) / (1 - np.conj(a) * p), w * p / (1 - np.conj(a) * p)
        steps = [
            g * d - g**3 * (s.conjugate() * d).real * s for d in (1.0, 1j)
        ]  # da for ds = 1 and i
        columns = [by_a * da + by_conj_a * np.conj(da) for da in steps] + [1j * w]
        return np.stack(
            [np.concatenate([(scale * c).real, (scale * c).imag]) for c in columns], axis=1
        )

    starts = [np.array([0.0, 0.0, turn]) for turn in np.arange(8) * np.pi / 4]
    best = min(
        (
            scipy.optimize.least_squares(residual, x, jacobian, xtol=1e-14, ftol=1e-14, gtol=1e-14)
            for x in starts
        ),
        key=lambda s: s.cost,
    )
    a, theta = unpack(best.x)
    return complex(a), float(np.angle(np.exp(1j * theta)))


def centring_mobius(z, weights):
    """The point a for which `sum_k weights_k M_a(z_k) = 0`: a Möbius map to the weighted centroid's
    gauge.

    Newton steps on the minimum of a convex function of the hyperbolic plane (Douady and Earle's
    conformal barycentre for weights on the circle): to first order M_a moves a point z by `-a +
    conj(a) z^2`.
    """
    weights, a = np.asarray(weights, float) / np.sum(weights), 0j
    for _ in range(200):
        w = mobius(z, a)
        centre, second = weights @ w, weights @ w**2
        if abs(centre) < 1e-15:
            break
        step = (centre + second * np.conj(centre)) / (1 - abs(second) ** 2)
        a = mobius_inverse(step / max(1.0, 2 * abs(step)), a)  # no further than 1/2 at once
    return a


def compose_mobius(
    first: tuple[complex, float], second: tuple[complex, float]
) -> tuple[complex, float]:
    """Parameters (a, theta) of `second` after `first`, each given as (a, theta)."""
    a, theta = _composed(first, second)
    return complex(a), float(theta)


def _composed(first, second):
    a = mobius_inverse(second[0], *first)  # what the composition sends to 0
    at_one = mobius(mobius(np.ones_like(a), *first), *second)
    return a, np.angle(at_one * (1 - np.conj(a)) / (1 - a))


def nearest_mobius(p, q, start, rounds):
    """The disk Möbius maps that bring each of B point sets p (B, M) nearest to q (B, M): ((a,
    theta), |M(p) - q|).

    Damped Gauss-Newton steps, each a Möbius map near the identity after the map so far, until no
    map moves any more or `rounds` are over. start: (a, theta), (B,) each, to begin with.
    """
    found, damping = start, np.full(len(p), DAMPING[1])
    off = _moved(p, found) - q
    cost = (abs(off) ** 2).sum(1)
    for _ in range(rounds):
        columns = mobius_fields(off + q)
        adjoint = columns.conj().transpose(0, 2, 1)
        normal, slope = (adjoint @ columns).real, (adjoint @ off[..., None]).real
        normal += (damping * (np.trace(normal, axis1=1, axis2=2) + 1e-300))[:, None, None] * np.eye(
            3
        )
        turn, real, imaginary = np.linalg.solve(normal, -slope)[..., 0].T
        shift = (real + 1j * imaginary) / np.sqrt(1 + real**2 + imaginary**2)  # stays in the disk
        after = _composed(found, (shift, turn))
        moved = _moved(p, after) - q
        moved_cost = (abs(moved) ** 2).sum(1)
        lower = moved_cost <= cost * (1 + ROUNDING)
        damping = np.clip(np.where(lower, damping / 5, damping * 5), DAMPING[0], DAMPING[2])
        found = tuple(np.where(lower, new, old) for new, old in zip(after, found))
        off, cost = np.where(lower[:, None], moved, off), np.where(lower, moved_cost, cost)
        if (abs(turn) + abs(shift)).max() < STILL:
            break
    return found, abs(off)


def _moved(p, found):
    return mobius(p, *(part[:, None] for part in found))


def best_turn(p, q):
    """Parameters (a, theta), (B,) each, of the rotations that bring p (B, M) nearest to q."""
    return np.zeros(len(p), complex), np.angle((p.conj() * q).sum(1))


def mobius_misfits(p, q, turns=4, rounds=30):
    """Distances |M(p) - q| (B, M) after the best disk Möbius map of each of B point sets p, q (B,
    M), all at once.

    From `turns` rotations, the best one among them: `best_mobius` of hundreds of sets in the time
    of one; their mean squares agree to 1e-4 of themselves.
    """
    count, (a, theta) = len(p), best_turn(p, q)
    theta = (theta + 2 * np.pi * np.arange(turns)[:, None] / turns).ravel()
    _, off = nearest_mobius(
        *(np.tile(x, (turns, 1)) for x in (p, q)), (np.tile(a, turns), theta), rounds
    )
    best = (off**2).sum(1).reshape(turns, count).argmin(0) * count + np.arange(count)
    return off[best]
