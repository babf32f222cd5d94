"""Shared by methods: the Beltrami solver with circle and landmarks held, and repair warnings."""

import warnings

import numpy as np

from ...plane.bijectivity import RepairWarning
from ...plane.linear import Dirichlet
from ...plane.mobius import mobius

HARD = 1e6  # weight that holds a landmark to about a millionth of the disk's radius
LARGEST = 0.99  # of |mu| after truncation


class LandmarkSolver:
    """The Linear Beltrami Solver on a problem's `Disk`, its circle held by the best Möbius map.

    A penalty holds landmarks between vertices, too: the map minimises `1/2 int grad f . A(mu) grad
    f + (weight / 2) sum_k |f(p_k) - q_k|^2`, i.e. at the free vertices `(K(mu) + weight E^T E) f =
    weight E^T q`, E the sampling matrix. weight 0: no landmarks; HARD: held; between: soft.
    """

    def __init__(self, problem):
        self.disk, self.samples, self.target = problem.disk, problem.samples, problem.target
        boundary = mobius(self.disk.z[self.disk.loop], *problem.mobius)
        self.boundary = boundary / abs(boundary)
        self.normal = (self.samples.T @ self.samples).tocsc()

    def solve(self, mu, weight=0.0):
        """The map f (V,) for mu (F,) and this weight of landmarks; BeltramiError for |mu| >= 1."""
        matrix = self.disk.stiffness(mu) + weight * self.normal
        dirichlet = Dirichlet(matrix, self.disk.loop)
        load = weight * (self.samples.T @ self.target)[dirichlet.free]
        f = np.empty(len(self.disk.z), complex)
        f[self.disk.loop] = self.boundary
        f[dirichlet.free] = dirichlet.solve_free(load - dirichlet.coupling @ self.boundary)
        return f


def truncated(mu):
    """mu with |mu| cut to LARGEST; 0 where mu is infinite or undefined, on collapsed faces."""
    mu = np.where(np.isfinite(mu), mu, 0)
    size = abs(mu)
    return mu * np.divide(LARGEST, size, out=np.ones_like(size), where=size > LARGEST)


def warn_of(repairs):
    """A RepairWarning for each repair of a method; the benchmark's rows hold the messages."""
    for message in repairs:
        warnings.warn(message, RepairWarning, stacklevel=3)
