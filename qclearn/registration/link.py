"""A fit's field nu beside the mesh that is mapped: what no landmark and no weight changes."""

from functools import cached_property

import numpy as np

from ..plane.coefficients import bounded
from ..plane.solver import DiskSolver
from ..plane.tangent import Carrier


class Link:
    """A polar `Disk` mesh, which carries nu (N,) at its vertices, beside the `Disk` that is mapped, maybe itself."""

    def __init__(self, disk, mesh):
        self.disk, self.mesh, self.solver = disk, mesh, DiskSolver(disk)
        _ = self.solver.calibration  # cached, so that copies of the solver need not find it again
        self.mass, self.laplace = mesh.mass / np.pi, mesh.laplace / np.pi  # so that terms are means over the disk
        self.to_faces = mesh.to_faces if disk is mesh else mesh.sampling(disk.centroids)

    @cached_property
    def carrier(self):
        """What derivatives in closed form need of both meshes."""
        return Carrier(self.solver, self.mesh)

    def coefficient(self, nu):
        """mu (F,) on the faces of the mapped mesh of nu (N,)."""
        return bounded(self.to_faces @ nu)
