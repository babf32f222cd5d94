"""The explorable of how sure a map is between its landmarks: what Python knows of it."""

from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from qclearn.plane.grids import polar
from qclearn.plot import disk_axes
from qclearn.registration.problem import Problem, Weights
from qclearn.registration.uncertainty import RINGS, Laplace

from .live import Live
from .liveproblems import weights_of

INSIDE = 4.605  # the square of a plane normal variable of variance 1 is below it in 90 of 100 cases
START = (0.05, 0.0), (0.55, 0.3), (-0.1, 0.62), (-0.6, -0.1), (-0.45, 0.3), (0.35, -0.55)
MORE = (-0.25, -0.6), (0.6, -0.15), (0.3, 0.65), (-0.3, -0.3), (0.3, 0.05), (0.0, -0.8)


class HowSure(Live):
    """90 % ellipses of the map between landmarks, of the chapter on how sure a map is."""

    page = "howsure"
    initial = MappingProxyType(
        {
            "places": [list(place) for place in START + MORE],
            "count": len(START),
            "alpha": Weights.alpha,
            "beta": Weights.beta,
            "gamma": Weights.gamma,
            "scale": 0.03,
        }
    )
    seen = np.concatenate([[0], *(0.23 * j * np.exp(2j * np.pi * np.arange(6 * j) / (6 * j)) for j in (1, 2, 3, 4))])

    @staticmethod
    def landmarks(state):
        """The landmarks of a state, (M,)."""
        return np.array(state["places"][: int(state["count"])]) @ [1, 1j]

    def posterior(self, state):
        """The library's `Laplace` of the map without distortion, which meets all landmarks."""
        p = self.landmarks(state)
        return Laplace(Problem(polar(RINGS), p, p), weights_of(state), None, (0j, 0.0))

    def answer(self, state):
        """Covariances [xx, xy, yy] of the map at `seen`, and the circles' radii that have the
        ellipses' mean square."""
        laplace = self.posterior(state)
        found = laplace.ellipses(self.seen)
        radii = state["scale"] * np.sqrt(INSIDE * np.trace(found, axis1=1, axis2=2) / 2)
        return {"covariances": found[:, [0, 0, 1], [0, 1, 1]].tolist(), "radii": radii.tolist()}

    def picture(self, state):
        """A Matplotlib figure of the landmarks and the ellipses between them, and a description."""
        found, p, figure = self.answer(state), self.landmarks(state), Figure(figsize=(4.6, 4.6))
        ax, circle = disk_axes(figure.subplots()), np.exp(2j * np.pi * np.arange(49) / 48)
        for z, (xx, xy, yy) in zip(self.seen, found["covariances"]):
            values, axes = np.linalg.eigh([[xx, xy], [xy, yy]])
            turned = state["scale"] * np.sqrt(INSIDE * values.clip(0)) * axes
            line = z + (turned @ [circle.real, circle.imag]).T @ [1, 1j]
            ax.plot(line.real, line.imag, color="#1F4E79", linewidth=0.8)
        ax.plot(p.real, p.imag, "o", color="#117733")
        ax.set(xlim=(-1.1, 1.1), ylim=(-1.1, 1.1))
        return figure, (
            f"The disk with {len(p)} landmarks and an ellipse at each of {len(self.seen)} places: "
            "small near "
            f"landmarks, larger away from them, on average {np.mean(found['radii']):.2f} of the "
            "disk's radius."
        )
