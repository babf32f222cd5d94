"""Möbius maps of the unit disk: the conformal freedom that a Beltrami coefficient does not see."""

import numpy as np
import scipy
from jaxtyping import Complex, Float
from numpy import ndarray


def mobius(
    z: Complex[ndarray, " *P"], a: Complex[ndarray, " *#P"] = 0.0, theta: Float[ndarray, " *#P"] = 0.0
) -> Complex[ndarray, " *P"]:
    """The disk Möbius map `exp(i theta) (z - a) / (1 - conj(a) z)`, which sends a to 0; theta in radians."""
    return np.exp(1j * theta) * (z - a) / (1 - np.conj(a) * z)


def mobius_inverse(
    w: Complex[ndarray, " *P"], a: Complex[ndarray, " *#P"] = 0.0, theta: Float[ndarray, " *#P"] = 0.0
) -> Complex[ndarray, " *P"]:
    """Inverse of `mobius(., a, theta)`."""
    w = np.exp(-1j * theta) * w
    return (w + a) / (1 + np.conj(a) * w)


def mobius_slope(z, a=0.0, theta=0.0):
    """Derivative `exp(i theta) (1 - |a|^2) / (1 - conj(a) z)^2` of `mobius(., a, theta)` at z."""
    return np.exp(1j * theta) * (1 - abs(a) ** 2) / (1 - np.conj(a) * z) ** 2


def mobius_fields(w):
    """`dw = i w dtheta - da + conj(da) w^2` by (dtheta, Re da, Im da) (..., 3): a Möbius increment after points w."""
    return np.stack([1j * w, w**2 - 1, -1j * (1 + w**2)], axis=-1)


def best_mobius(
    p: Complex[ndarray, " M"], q: Complex[ndarray, " M"], weights: Float[ndarray, " M"] | None = None
) -> tuple[complex, float]:
    """The disk Möbius map, as (a, theta), that minimises `mean |M(p) - q|^2` over points of the unit disk.

    Least squares over s with `a = s / sqrt(1 + |s|^2)`, which keeps |a| < 1, from eight rotations, so that a large turn
    between the point sets does not end in a local minimum.
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
        steps = [g * d - g**3 * (s.conjugate() * d).real * s for d in (1.0, 1j)]  # da for ds = 1 and i
        columns = [by_a * da + by_conj_a * np.conj(da) for da in steps] + [1j * w]
        return np.stack([np.concatenate([(scale * c).real, (scale * c).imag]) for c in columns], axis=1)

    starts = [np.array([0.0, 0.0, turn]) for turn in np.arange(8) * np.pi / 4]
    fits = [scipy.optimize.least_squares(residual, x, jacobian, xtol=1e-14, ftol=1e-14, gtol=1e-14) for x in starts]
    a, theta = unpack(min(fits, key=lambda fit: fit.cost).x)
    return complex(a), float(np.angle(np.exp(1j * theta)))


def centring_mobius(z, weights):
    """The point a with `sum_k weights_k M_a(z_k) = 0`, whose Möbius map M_a centres the points.

    Newton steps for a convex function of the hyperbolic plane (Douady and Earle's conformal barycentre for weights on
    the circle): to first order M_a moves a point z by `-a + conj(a) z^2`.
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


def compose_mobius(first: tuple[complex, float], second: tuple[complex, float]) -> tuple[complex, float]:
    """`second` after `first`, Möbius maps as (a, theta)."""
    a = mobius_inverse(second[0], *first)  # what the composition sends to 0
    at_one = mobius(mobius(1.0, *first), *second)
    return complex(a), float(np.angle(at_one * (1 - np.conj(a)) / (1 - a)))


def mobius_misfits(p, q, turns=4, rounds=30):
    """Distances |M(p) - q| (B, M) after the best disk Möbius map of each of B point sets p, q (B, M).

    Damped Gauss-Newton steps from `turns` rotations, all sets at once; mean squares are within 1e-4 of `best_mobius`'.
    """
    count, start = len(p), np.angle((p.conj() * q).sum(1))
    w = np.concatenate([p * np.exp(1j * (start + turn))[:, None] for turn in 2 * np.pi * np.arange(turns) / turns])
    q, damping = np.tile(q, (turns, 1)), np.full(turns * count, 1e-3)
    cost = (abs(w - q) ** 2).sum(1)
    for _ in range(rounds):
        columns = mobius_fields(w)
        normal = (columns.conj().transpose(0, 2, 1) @ columns).real
        slope = (columns.conj().transpose(0, 2, 1) @ (w - q)[..., None]).real
        normal += (damping * (np.trace(normal, axis1=1, axis2=2) + 1e-300))[:, None, None] * np.eye(3)
        turn, real, imaginary = np.linalg.solve(normal, -slope)[..., 0].T
        shift = (real + 1j * imaginary) / np.sqrt(1 + real**2 + imaginary**2)  # stays in the disk
        moved = mobius(w, shift[:, None], turn[:, None])
        moved_cost = (abs(moved - q) ** 2).sum(1)
        lower = moved_cost < cost
        damping = np.clip(np.where(lower, damping / 5, damping * 5), 1e-12, 1e6)
        w, cost = np.where(lower[:, None], moved, w), np.where(lower, moved_cost, cost)
    best = cost.reshape(turns, count).argmin(0) * count + np.arange(count)
    return abs(w - q)[best]
