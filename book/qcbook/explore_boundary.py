"""The explorable of the free boundary: what Python knows of it."""

from types import MappingProxyType

import numpy as np

from qcbook.figures import grid_plot
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius
from qclearn.plane.solver import DiskSolver

from .live import Live, as_pairs, two_disks


class Boundary(Live):
    """Harmonic measure seen from a pole, and descents of two losses, of the chapter on the free
    boundary."""

    page = "boundary"
    initial = MappingProxyType({"strength": 0.5, "pole": (0.5, 0.6), "loss": "printed", "step": 0, "centred": False})
    mesh = Disk(*polar_disk(24, 73))  # an odd number of spokes: no boundary point lies opposite to 1
    rim = np.arange(1 + 23 * 73, 1 + 24 * 73)

    def coefficient(self, state):
        """mu (F,) of the sliding map z exp(i s Im(z) |z|)."""
        c = self.mesh.centroids
        h_z = state["strength"] / 2 * (-1j * abs(c) + c.imag * c.conj() / abs(c))
        return 1j * c * h_z.conj() / (1 + 1j * c * h_z)

    def map(self, state):
        """(V,): the descent's start, the right map with the pole at 0; `centred`, the end of energy
        minus area."""
        right = DiskSolver(self.mesh).solve(self.coefficient(state))
        if state["centred"]:
            return right
        # The map that sends the pole's image to 0, and 1 to 1.
        f = mobius(right, (self.mesh.interpolation([complex(*state["pole"])]) @ right)[0])
        return f / f[self.rim[0]]

    def answer(self, state):
        """The library's maps: the descent's start, and the right one."""
        return {name: as_pairs(self.map({**state, "centred": name == "right"})) for name in ("start", "right")}

    def picture(self, state):
        """A Matplotlib figure of harmonic measure seen from the pole and of the map at this step,
        and a description."""
        z, f, pole = self.mesh.z, self.map(state), complex(*state["pole"])
        figure, (seen, image) = two_disks("harmonic measure seen from the pole", "boundary points of the map")
        steps = np.angle(np.roll(f[self.rim], -1) / f[self.rim]) % (2 * np.pi)
        middle = z[self.rim] * np.exp(1j * np.pi / len(steps))
        band = middle * np.maximum(0.02, 1 - 0.2 * steps / steps.mean())
        seen.fill(middle.real, middle.imag, color="#E69F00")
        seen.fill(band.real, band.imag, color="white")
        seen.plot(pole.real, pole.imag, "o", color="#B22222")
        grid_plot(image, z, self.mesh.faces, f)
        image.plot(f[self.rim].real, f[self.rim].imag, ".", color="#E69F00")
        words = "A band along the circle, wide where a red pole is near, and a grid whose boundary points crowd."
        return figure, words
