"""The explorable of Möbius maps: what Python knows of it."""

from types import MappingProxyType

import numpy as np

from qclearn.plane.mobius import mobius
from qclearn.plot import lines_plot, polar_lines

from .live import Live, two_disks


class Mobius(Live):
    """Möbius maps of the disk, of the chapter on conformal maps."""

    page = "mobius"
    initial = MappingProxyType({"size": 0.4, "direction": 30.0, "turn": 0.0, "figure": "polar"})
    circle = 0.5 + 0.2 * np.exp(2j * np.pi * np.arange(181) / 180)

    @staticmethod
    def parameters(state):
        """(a, theta) of the map."""
        return state["size"] * np.exp(1j * np.radians(state["direction"])), np.radians(state["turn"])

    def answer(self, state):
        """Centre and radius of what the red circle becomes, from three of its points."""
        p, q, r = mobius(self.circle[[0, 60, 120]], *self.parameters(state))
        w = (r - p) / (q - p)
        centre = (q - p) * (w - abs(w) ** 2) / (2j * w.imag) + p
        return {"centre": [centre.real, centre.imag], "radius": abs(p - centre)}

    def picture(self, state):
        """A Matplotlib figure of the disk and its image, and a description."""
        figure, axes = two_disks("the disk and the pole a", "its image")
        lines, (a, theta) = polar_lines(5, 24), self.parameters(state)
        views = (lambda z: z, a), (lambda z: mobius(z, a, theta), 0)
        for ax, (view, pole) in zip(axes, views):
            lines_plot(ax, [view(line) for line in lines], "#1F4E79")
            ax.plot(view(self.circle).real, view(self.circle).imag, color="#B22222", linewidth=2)
            ax.plot(np.real(pole), np.imag(pole), "o", color="#E69F00")
        return (figure, "A polar grid of the disk with a red circle, and its image by a Möbius map: circles all.")
