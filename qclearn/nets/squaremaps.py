"""The square's exact counterpart: maps of images mu by a polar solver, at the square's vertices."""

import numpy as np
import torch

from ..plane.grids import disk_to_square, square_disk
from .polar import PolarSolver

RINGS, SPOKES = 48, 144


class SquareMaps:
    """From images mu (B, size, size) to maps (B, (size + 1)^2) of `square_disk(size)`.

    solve: (B, F) -> (B, V) on a `Disk`, by default the exact one; what it is differentiable for,
    this is. Two discretisations of one map: between this one and the square's own lie 0.3 % of the
    displacement at size 64.
    """

    def __init__(self, size, disk=None, solve=None):
        if solve is None:
            solver = PolarSolver(RINGS, SPOKES)
            disk, solve = solver.mesh, solver.solve
        self.solve = solve
        places = (disk_to_square(disk.centroids) + 1 + 1j) * size / 2
        column, row = (
            np.clip(part.astype(int), 0, size - 1) for part in (places.real, places.imag)
        )
        self.pixels = torch.from_numpy(row * size + column)  # of each face's centroid
        face, weights = disk.locate(square_disk(size)[0])
        self.corners, self.weights = torch.from_numpy(disk.faces[face]), torch.tensor(weights)

    def __call__(self, mu, *stopping):
        """The maps f with f(0) = 0 and f(1) = 1; stopping: the solver's (tolerance, limit)."""
        device = mu.device
        f = self.solve(mu.flatten(1)[:, self.pixels.to(device)], *stopping)
        return (f[:, self.corners.to(device)] * self.weights.to(f.real)).sum(-1)
