"""The paper's baseline: the harmonic map with soft landmarks and its overlap correction."""

import numpy as np
from scipy import sparse

from ...plane.linear import Dirichlet
from .solver import HARD, LandmarkSolver, truncated, warn_of

MOST_ROUNDS = 40
# Of the data in the smoothing; halved each round, so that no more of the match is lost than must.
FIRST_WEIGHT = 100.0


def harmonic(problem, weight=1.0, correct=True):
    """The map that minimises `1/2 int |grad f|^2 + (weight / 2) sum_k |f(p_k) - q_k|^2`, unfolded
    if `correct`.

    weight: the paper's lambda. The best Möbius map holds the circle. Source: Choi, Lam, Lui (2015),
    FLASH, on the disk of Choi, Lui (2015), as for the paper's table.
    """
    if not weight >= 0:
        raise ValueError(f"weight = {weight}: give a number from 0 (the paper's lambda)")
    solver = LandmarkSolver(problem)
    f = solver.solve(np.zeros(len(problem.disk.faces), complex), weight)
    return unfold(solver, f, np.exp(-np.sqrt(weight) / 4)) if correct else f


def unfold(solver, f, smoothness):
    """FLASH's overlap correction: rounds of four steps until no face is flipped; warns of repairs.

    1. smooth |mu| and truncate it; 2. solve with the landmarks held and measure the coefficient mu'; 3. blend,
    `mu' + smoothness (nu - mu')`, and truncate; 4. solve with that and without landmarks. smoothness in [0, 1]:
    1 forgets the landmarks, 0 follows them. The source leaves open how much to smooth: little at first, then more.
    """
    disk, rounds = solver.disk, 0
    first = left = len(disk.at(f).maybe_flipped)
    while left and rounds < MOST_ROUNDS:
        nu = truncated(smoothed(solver, truncated(disk.coefficient(f)), FIRST_WEIGHT / 2**rounds))
        held = truncated(disk.coefficient(solver.solve(nu, HARD)))
        f = solver.solve(truncated(held + smoothness * (nu - held)))
        left, rounds = len(disk.at(f).maybe_flipped), rounds + 1
    if first:
        warn_of([f"overlap correction: {first} faces flipped, {left} after {rounds} rounds"])
    return f


def smoothed(solver, mu, weight):
    """mu (F,) with smooth modulus: `((1 + 1/weight) + (2/weight) K) m = |mu|` at the vertices,
    argument as it is."""
    disk = solver.disk
    nodal = disk.to_vertices @ mu
    matrix = (1 + 1 / weight) * sparse.eye_array(len(nodal)) + (2 / weight) * disk.laplace
    problem = Dirichlet(matrix, [])
    size = np.empty(len(nodal))
    size[problem.free] = problem.solve_free(abs(nodal[problem.free]))
    turned = np.divide(size, abs(nodal), out=np.zeros_like(size), where=nodal != 0) * nodal
    return turned[disk.faces].mean(1)
