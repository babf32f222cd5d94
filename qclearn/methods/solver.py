"""What several methods share: the Beltrami solver with circle and landmarks held, and how they say what they did."""

import warnings

import numpy as np

from ..plane.beltrami import Dirichlet, corner_average, signed_areas, stiffness
from ..plane.bijectivity import RepairWarning
from ..plane.diskmesh import boundary_loop
from ..plane.mobius import mobius

HARD = 1e6  # weight that holds a landmark to about a millionth of the disk's radius
LARGEST = 0.99  # of |mu| after truncation


class LandmarkSolver:
    """The Linear Beltrami Solver on a problem's disk mesh, its circle held by the best Möbius map.

    Landmarks join by a penalty, so that they may lie between vertices: the map minimises
    `1/2 int grad f . A(mu) grad f + (weight / 2) sum_k |f(p_k) - q_k|^2`, i.e.
    `(K(mu) + weight E^T E) f = weight E^T q` at the free
    vertices, with E the sampling matrix. weight 0: no landmarks; HARD: held; between: soft.
    """

    def __init__(self, z, faces, samples, target, boundary):
        self.z, self.faces, self.loop = z, faces, boundary_loop(faces)
        self.samples, self.target, self.boundary = samples, target, boundary
        self.normal = (samples.T @ samples).tocsc()
        self.to_vertices = corner_average(faces, len(z), signed_areas(z, faces))

    @classmethod
    def of(cls, problem):
        loop = boundary_loop(problem.faces)
        boundary = mobius(problem.z[loop], *problem.mobius)
        return cls(problem.z, problem.faces, problem.samples, problem.target, boundary / abs(boundary))

    def solve(self, mu, weight=0.0):
        """The map f (V,) with coefficient mu (F,) and landmarks of this weight; BeltramiError for |mu| >= 1."""
        matrix = stiffness(self.z, self.faces, mu) + weight * self.normal
        dirichlet = Dirichlet(matrix, self.loop)
        load = weight * (self.samples.T @ self.target)[dirichlet.free]
        f = np.empty(len(self.z), complex)
        f[self.loop] = self.boundary
        f[dirichlet.free] = dirichlet.solve_free(load - dirichlet.coupling @ self.boundary)
        return f

    def error(self, f):
        """Mean distance of the mapped landmarks from their targets."""
        return abs(self.samples @ f - self.target).mean()


def truncated(mu, largest=LARGEST):
    """mu with |mu| cut to `largest`; where mu is infinite or undefined (a collapsed face) its direction is lost: 0."""
    mu = np.where(np.isfinite(mu), mu, 0)
    size = abs(mu)
    return mu * np.divide(largest, size, out=np.ones_like(size), where=size > largest)


def report(words):
    """A RepairWarning for each thing a method did beyond its plain formula; the benchmark keeps their words."""
    for word in words:
        warnings.warn(word, RepairWarning, stacklevel=3)
