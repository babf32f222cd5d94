"""Teichmüller maps: among all maps that meet the landmarks, the one with the least maximum of |mu|."""

import numpy as np

from .solver import HARD, LandmarkSolver, truncated, warn_of

MOST_ROUNDS = 60
SETTLED = 1e-3  # change of the mean |mu|, relative, that ends the iteration


def teichmuller(problem):
    """The map with `mu = k conj(phi) / |phi|`, one k < 1 for the whole disk, that meets landmarks
    and circle: f (V,).

    The best Möbius map holds the circle; see `extremal`. Source: Lui, Lam, Yau, Gu (2014),
    Teichmüller mapping.
    """
    return extremal(LandmarkSolver(problem))


def extremal(solver):
    """Quasi-conformal iteration: `mu <- mean|mu| mu / |mu|` (mean over the disk), then f by the
    solver, f(p) = q held.

    Ends when the mean settles; a RepairWarning says if it did not within MOST_ROUNDS, or if faces
    stay flipped.
    """
    areas, level = solver.disk.areas / np.pi, 0.0
    f = solver.solve(np.zeros(len(areas), complex), HARD)
    for _ in range(MOST_ROUNDS):
        mu = truncated(solver.disk.coefficient(f))
        size, before = abs(mu), level
        level = areas @ size / areas.sum()
        if abs(level - before) <= SETTLED * level:
            break
        f = solver.solve(level * np.divide(mu, size, out=np.zeros_like(mu), where=size > 0), HARD)
    else:
        still = f"the mean |mu| still changes by {abs(level - before) / level:.1e}, {SETTLED:.0e} ends it"
        warn_of([f"Teichmüller iteration: not settled after {MOST_ROUNDS} rounds ({still})"])
    left = len(solver.disk.at(f).maybe_flipped)
    if left:
        warn_of([f"Teichmüller iteration: {left} faces flipped"])
    return f
