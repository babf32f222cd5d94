"""Möbius maps of the unit disk: the conformal freedom that a Beltrami coefficient does not see.

First the maps themselves, their composition and derivatives; then the map that brings a weighted
centroid to 0; then the maps that bring points nearest to other points.
"""

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray

from .checks import planar_points

LEAST, FIRST, MOST = 1e-9, 1e-3, 1e6  # damping of a Gauss-Newton step, relative
ROUNDING = 1e-14  # of a sum of squares
STILL = 1e-15  # a step too short to matter
# Maps that bring points alike near to their targets: relative, of a sum of squares; of a point; how
# much less of them moves 0.
ALIKE, AT_ONCE, NEARER = 1e-9, 1e-12, 1e-6


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


def compose_mobius(first: tuple, second: tuple) -> tuple:
    """Parameters (a, theta) of `second` after `first`, each given as (a, theta), numbers or arrays
    (B,)."""
    a = mobius_inverse(second[0], *first)  # what the composition sends to 0
    at_one = mobius(mobius(np.ones_like(a), *first), *second)
    return a, np.angle(at_one * (1 - np.conj(a)) / (1 - a))


def centring_mobius(z, weights):
    """The point a for which `sum_k weights_k M_a(z_k) = 0`: the map that brings the centroid to 0.

    Newton steps on the minimum of a convex function of the hyperbolic plane (Douady and Earle's
    conformal barycentre for weights on the circle): to first order M_a moves a point z by `-a +
    conj(a) z^2`.
    """
    weights = np.asarray(weights, float) / np.sum(weights)
    a = 0j
    for _ in range(200):
        w = mobius(z, a)
        centre = weights @ w
        second = weights @ w**2
        if abs(centre) < 1e-15:
            break
        step = (centre + second * np.conj(centre)) / (1 - abs(second) ** 2)
        a = mobius_inverse(step / max(1.0, 2 * abs(step)), a)  # no further than 1/2 at once
    return a


def best_mobius(p: Complex[ndarray, " M"], q: Complex[ndarray, " M"]) -> tuple[complex, float]:
    """The disk Möbius map, as (a, theta), that minimises `mean |M(p) - q|^2` over points of the
    unit disk: the nearest one from eight rotations, so that a large turn between the point sets
    does not end in a local minimum."""
    p, q = (planar_points(points, name)[None] for points, name in ((p, "p"), (q, "q")))
    (a, theta), _ = nearest_mobius(p, q, turns=8, rounds=100)
    return complex(a[0]), float(np.angle(np.exp(1j * theta[0])))


def nearest_mobius(p, q, turns=4, rounds=30):
    """The disk Möbius maps that bring each of B point sets p (B, M) nearest to q (B, M), all at
    once: ((a, theta), |M(p) - q|), of shapes (B,) and (B, M).

    By `descend`, from the best rotation and from others, `turns` in all at equal angles; the map
    that ends nearest is returned, and where many end alike near, as with two points on the rim, of
    those the first that moves 0 the least: rounding does not choose.
    """
    count = len(p)
    rotations = np.angle((p.conj() * q).sum(1)) + 2 * np.pi * np.arange(turns)[:, None] / turns
    p, q = (np.tile(points, (turns, 1)) for points in (p, q))

    def look(parameters):
        w = mobius(p, *(part[:, None] for part in parameters))
        return w - q, mobius_fields(w)

    start = np.zeros(len(p), complex), rotations.ravel()
    parameters, off = descend(look, start, rounds)
    cost = (abs(off) ** 2).sum(1).reshape(turns, count)
    alike = cost <= cost.min(0) * (1 + ALIKE) + p.shape[1] * AT_ONCE**2
    moved = np.where(alike, abs(parameters[0]).reshape(turns, count), np.inf)
    best = (moved <= moved.min(0) + NEARER).argmax(0) * count + np.arange(count)
    return tuple(part[best] for part in parameters), abs(off[best])


def descend(look, parameters, rounds):
    """Disk Möbius maps (a, theta), (B,) each, that lower B sums of squares, and what these are of,
    (B, K): by damped Gauss-Newton steps from `parameters`, until no map moves any more or `rounds`
    are over.

    look(parameters): residuals (B, K) and their derivatives (B, K, 3) by a Möbius increment after
    each map, as of `mobius_fields`; real, or complex. Each step is a Möbius map near the identity
    after the map so far.
    """
    damping = np.full(len(parameters[0]), FIRST)
    off, columns = look(parameters)
    cost = (abs(off) ** 2).sum(1)
    for _ in range(rounds):
        # One Gauss-Newton step of each map, damped relative to the trace of its normal matrix.
        adjoint = columns.conj().transpose(0, 2, 1)
        normal, slope = (adjoint @ columns).real, (adjoint @ off[..., None]).real
        ridge = damping * (np.trace(normal, axis1=1, axis2=2) + 1e-300)
        step = np.linalg.solve(normal + ridge[:, None, None] * np.eye(3), -slope)
        turn, real, imaginary = step[..., 0].T
        shift = (real + 1j * imaginary) / np.sqrt(1 + real**2 + imaginary**2)  # stays in the disk
        # A step that makes a sum of squares larger is not taken, and the next one is shorter.
        tried = compose_mobius(parameters, (shift, turn))
        off_tried, columns_tried = look(tried)
        cost_tried = (abs(off_tried) ** 2).sum(1)
        lower = cost_tried <= cost * (1 + ROUNDING)
        damping = np.clip(np.where(lower, damping / 5, damping * 5), LEAST, MOST)
        parameters = tuple(np.where(lower, new, old) for new, old in zip(tried, parameters))
        off = np.where(lower[:, None], off_tried, off)
        columns = np.where(lower[:, None, None], columns_tried, columns)
        cost = np.where(lower, cost_tried, cost)
        if (abs(turn) + abs(shift)).max() < STILL:
            break
    return parameters, off
