"""Quasi-conformal iteration: a smooth coefficient and a map that meets the landmarks, in turns."""

import numpy as np

from ...plane.linear import factorise
from .solver import HARD, LandmarkSolver, truncated, warn_of

FIRST_SIGMA, GROWTH = 10.0, 1.6  # of the penalty on nu - mu(f), and its factor from round to round


def qc_iteration(problem, alpha=1.0, rounds=20):
    """A map with smooth coefficient nu, near the least of `int |grad nu|^2 + alpha int |nu|^2` with
    f(p) = q.

    Splits off mu(f) with the penalty `sigma int |nu - mu(f)|^2`, sigma rising, and alternates: f
    from nu by the solver with the landmarks held; nu from f by `(L + (alpha + sigma) M) nu = sigma
    M mu(f)` (Laplace and mass matrix of the disk), truncated. A last f that folds is solved again
    without landmarks, and a RepairWarning says so. The best Möbius map holds the circle. Source:
    Lam, Lui (2014), Landmark and intensity based registration, section 4.
    """
    if not (alpha >= 0 and rounds >= 1):
        advice = "give alpha from 0 and at least one round"
        raise ValueError(f"alpha = {alpha}, rounds = {rounds}: {advice}")
    solver = LandmarkSolver(problem)
    disk, sigma = solver.disk, FIRST_SIGMA
    nu, laplace, mass = np.zeros(len(disk.faces), complex), disk.laplace, disk.mass
    for _ in range(rounds):
        mu = truncated(disk.coefficient(solver.solve(nu, HARD)))
        load = sigma * (mass @ (disk.to_vertices @ mu))
        factors = factorise(laplace + (alpha + sigma) * mass)
        nodal = factors.solve(load.real) + 1j * factors.solve(load.imag)
        nu, sigma = truncated(nodal[disk.faces].mean(1)), GROWTH * sigma
    f = solver.solve(nu, HARD)
    left = len(disk.at(f).maybe_flipped)
    if left:
        f = solver.solve(nu)
        let_go = len(disk.at(f).maybe_flipped)
        message = f"{left} faces flipped with the landmarks held; let go, {let_go}"
        warn_of([f"quasi-conformal iteration: {message}"])
    return f
