"""What every method is given, and what several of them share: the Beltrami solver with the circle and landmarks held."""

import warnings
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..plane.beltrami import Dirichlet, corner_average, signed_areas, stiffness
from ..plane.bijectivity import RepairWarning
from ..plane.diskmesh import boundary_loop, sampling_matrix
from ..plane.mobius import best_mobius, mobius
from ..registration.problem import check_landmarks

HARD = 1e6  # weight that holds a landmark to about a millionth of the disk's radius
LARGEST = 0.99  # of |mu| after truncation


@dataclass(frozen=True)
class Problem:
    """Landmarks of one moving disk to be carried to their targets in the control's disk.

    z (V,) complex, faces (F, 3): the moving surface's disk mesh, its boundary on the unit circle; moving, target (M,)
    complex: landmarks p in that disk and q in the control's; curve (M,) int: which curve each belongs to, in order.
    A method returns f (V,) complex: where each vertex lies in the control's disk. LandmarkError for unusable landmarks.
    """

    z: np.ndarray
    faces: np.ndarray
    moving: np.ndarray
    target: np.ndarray
    curve: np.ndarray = field(default=None)

    def __post_init__(self):
        checked = check_landmarks(self.moving, self.target, self.curve, sliding=False)
        for name, array in zip(("moving", "target", "curve"), checked):
            object.__setattr__(self, name, array)

    @cached_property
    def samples(self):
        """Sparse (M, V): per-vertex data at the moving landmarks."""
        return sampling_matrix(self.z, self.faces, self.moving)

    @cached_property
    def mobius(self):
        """(a, theta) of the disk Möbius map that alone brings the landmarks nearest to their targets."""
        return best_mobius(self.moving, self.target)


class LandmarkSolver:
    """The Linear Beltrami Solver on a problem's disk mesh, its circle held by the best Möbius map.

    Landmarks join by a penalty, so that they may lie between vertices: the map minimises
    `1/2 int grad f . A(mu) grad f + (weight / 2) sum_k |f(p_k) - q_k|^2`, i.e. `(K(mu) + weight E^T E) f = weight E^T q`
    at the free vertices, with E the sampling matrix. weight 0: no landmarks; HARD: held; between: soft.
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
        problem = Dirichlet(matrix, self.loop)
        load = weight * (self.samples.T @ self.target)[problem.free]
        f = np.empty(len(self.z), complex)
        f[self.loop] = self.boundary
        f[problem.free] = problem.solve_free(load - problem.coupling @ self.boundary)
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
