"""The explorable of a painted coefficient: what Python knows of it."""

from types import MappingProxyType

import numpy as np

from qcbook.figures import grid_plot
from qclearn.plane.grids import FINE, polar
from qclearn.plane.solver import DiskSolver
from qclearn.plot import disk_plot

from .live import Live, as_pairs, two_disks


class Mu(Live):
    """A coefficient that the reader sets and paints, of the chapter on quasi-conformal maps."""

    page = "mu"
    initial = MappingProxyType(
        {"preset": "waves", "size": 0.5, "direction": 60.0, "radius": 0.15, "brush": (0.5, 0.5), "strokes": ()}
    )
    mesh = polar(*FINE)
    presets = MappingProxyType(
        {
            "constant": lambda z: 1 + 0 * z,
            "radial": lambda z: z / z.conj(),
            "waves": lambda z: np.sin(4 * z.real) * np.cos(3 * z.imag) + 0j,
            "bump": lambda z: np.exp(-(abs(z - 0.3 - 0.2j) ** 2) / 0.3**2) + 0j,
            "blank": lambda z: 0 * z,
        }
    )

    def coefficient(self, state):
        """mu (F,) on the faces of the mesh: the preset, and what was painted over it."""
        centres = self.mesh.centroids
        mu = state["size"] * np.exp(1j * np.radians(state["direction"])) * self.presets[state["preset"]](centres)
        for x, y, radius, re, im in state["strokes"]:
            mu[abs(centres - complex(x, y)) <= radius] = complex(re, im)
        return mu

    def answer(self, state):
        """The exact solver's map."""
        return {"map": as_pairs(DiskSolver(self.mesh).solve(self.coefficient(state)))}

    def picture(self, state):
        """A Matplotlib figure of |mu| and of the grid under the exact map, and a description."""
        z, faces, mu = self.mesh.z, self.mesh.faces, self.coefficient(state)
        figure, (sizes, image) = two_disks("|μ|", "grid under the exact map")
        disk_plot(sizes, z, faces, abs(mu), cmap="YlGnBu", vmin=0, vmax=1)
        grid_plot(image, z, faces, DiskSolver(self.mesh).solve(mu))
        return (figure, "The size of a coefficient in waves over the disk, and the grid bent by the map that has it.")
