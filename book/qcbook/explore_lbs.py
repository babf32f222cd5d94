"""The explorable of the Linear Beltrami Solver with pins: what Python knows of it."""

from types import MappingProxyType

import numpy as np

from qcbook.figures import FLIPPED_COLOUR, grid_plot
from qclearn.plane.beltrami import solve_beltrami
from qclearn.plane.disk import Disk
from qclearn.plane.grids import COARSE, polar_disk
from qclearn.plot import disk_plot

from .live import Live, as_pairs, two_disks

HELD = 0.5  # distance from 0 of the points that are pinned


class LBS(Live):
    """Pins in the Linear Beltrami Solver, and its coefficients right and as printed, of the chapter
    on the solver."""

    page = "lbs"
    initial = MappingProxyType(
        {"asked": "twist", "strength": 0.0, "count": 4, "pull": 0.2, "moves": {}}
        | dict.fromkeys(("e2", "e3", "e4", "e5"), False)
    )
    mesh = Disk(*polar_disk(*COARSE))
    rim = np.arange(1 + 23 * 72, 1 + 24 * 72)

    def coefficient(self, state):
        """mu (F,) that is asked for, at centroids."""
        c, s = self.mesh.centroids, state["strength"]
        return -1j * s * c**2 / (1 - 1j * s * abs(c) ** 2) if state["asked"] == "twist" else s / (2 + s) * c / c.conj()

    def pins(self, state):
        """(vertices (M,), targets (M,) complex) of the pins."""
        z, count = self.mesh.z, state["count"]
        at = HELD * np.exp(2j * np.pi * np.arange(count) / max(count, 1))
        vertices = abs(z[:, None] - at).argmin(0)
        targets = z[vertices] * (1 + 1j * state["pull"] / abs(z[vertices]))
        for place, (x, y) in state["moves"].items():
            if int(place) < count:
                targets[int(place)] = complex(x, y)
        return vertices, targets

    def map(self, state):
        """f (V,) with the right coefficients: given at the pins and on the circle."""
        disk, (vertices, targets) = self.mesh, self.pins(state)
        pinned, values = np.append(vertices, self.rim), np.append(targets, disk.z[self.rim])
        return solve_beltrami(disk.z, disk.faces, self.coefficient(state), pinned, values)

    def answer(self, state):
        """The library's map, and how many faces it folds."""
        f = self.map(state)
        return {"map": as_pairs(f), "folds": len(self.mesh.at(f).maybe_flipped)}

    def picture(self, state):
        """A Matplotlib figure of the grid under the map and of its |mu|, and a description."""
        z, faces, f, (_, targets) = self.mesh.z, self.mesh.faces, self.map(state), self.pins(state)
        folded, (figure, (image, sizes)) = (self.mesh.at(f).maybe_flipped, two_disks("grid, pins and folds", "|μ|"))
        grid_plot(image, z, faces, f)
        for triangle in f[faces[folded]]:
            image.fill(triangle.real, triangle.imag, color=FLIPPED_COLOUR, zorder=4)
        image.plot(targets.real, targets.imag, "o", color="#E69F00", zorder=5)
        disk_plot(sizes, z, faces, abs(self.mesh.coefficient(f)), cmap="YlGnBu", vmin=0, vmax=1)
        words = f"A grid with four pinned points pulled aside, {len(folded)} folded triangles at them, and |μ|."
        return figure, words
