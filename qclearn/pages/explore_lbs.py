"""The explorable of the Linear Beltrami Solver with pins, what Python knows of it; the browser's side is `lbs.js`."""

from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from scipy import sparse
from scipy.sparse.linalg import splu

from ..plane.beltrami import beltrami_coefficient, hat_gradients, signed_areas
from ..plane.bijectivity import flipped_faces
from ..plane.diskmesh import polar_disk
from .live import Live, as_pairs
from .plot import FLIPPED_COLOUR, disk_axes, disk_plot, grid_plot

HELD = 0.5  # distance from 0 of the points that are pinned


class LBS(Live):
    """Pins in the Linear Beltrami Solver, and its coefficients right and as printed, of the chapter on the solver."""

    page = "lbs"
    initial = MappingProxyType(
        {
            "asked": "twist",
            "strength": 0.0,
            "count": 4,
            "pull": 0.2,
            "e2": False,
            "e3": False,
            "e4": False,
            "e5": False,
            "moves": {},
        }
    )
    mesh = polar_disk(24, 72)
    rim = np.arange(1 + 23 * 72, 1 + 24 * 72)

    def coefficient(self, state):
        """mu (F,) that is asked for, at centroids."""
        z, faces = self.mesh
        c, s = z[faces].mean(1), state["strength"]
        return -1j * s * c**2 / (1 - 1j * s * abs(c) ** 2) if state["asked"] == "twist" else s / (2 + s) * c / c.conj()

    def pins(self, state):
        """(vertices (M,), targets (M,) complex) of the pins."""
        z, count = self.mesh[0], state["count"]
        at = HELD * np.exp(2j * np.pi * np.arange(count) / max(count, 1))
        vertices = abs(z[:, None] - at).argmin(0)
        targets = z[vertices] * (1 + 1j * state["pull"] / abs(z[vertices]))
        for place, (x, y) in state["moves"].items():
            if int(place) < count:
                targets[int(place)] = complex(x, y)
        return vertices, targets

    def rows(self, state):
        """K (V, V) as the state has it: right, or with slips E2, E3 and E5."""
        z, faces = self.mesh
        hats, area, mu = (
            hat_gradients(z, faces),
            signed_areas(z, faces)[:, None, None],
            self.coefficient(state)[:, None],
        )
        flux = ((1 + abs(mu) ** 2) * hats - 2 * mu * hats.conj()) / (1 - abs(mu) ** 2)
        blocks = area * (hats.conj()[:, :, None] * flux[:, None, :]).real
        blocks = blocks * (area**4 if state["e2"] else 1) / (area if state["e3"] else 1)
        if state["e5"]:
            blocks = blocks[:, np.arange(3)[:, None], [[0, 2, 1], [2, 1, 0], [1, 0, 2]]]
        entries = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
        return sparse.coo_array((blocks.ravel(), entries)).tocsr()

    def map(self, state):
        """f (V,) with (K f)_i = 0 but at the pins and the circle, or, with E4, but at the pins, 0 and 1."""
        z, (vertices, targets), K = self.mesh[0], self.pins(state), self.rows(state)
        held = np.array([0, self.rim[0]]) if state["e4"] else self.rim
        f = np.zeros(len(z), complex)
        f[held] = z[held]
        f[vertices] = targets
        held = np.union1d(held, vertices)
        free = np.setdiff1d(np.arange(len(z)), held)
        load, factors = -(K[free][:, held] @ f[held]), splu(K[free][:, free].tocsc())
        f[free] = factors.solve(load.real) + 1j * factors.solve(load.imag)
        return f

    def answer(self, state):
        """The map with SciPy's factorisation, and how many faces it folds."""
        f = self.map(state)
        return {"map": as_pairs(f), "folds": len(flipped_faces(self.mesh[1], f))}

    def picture(self, state):
        """A Matplotlib figure of the grid under the map and of its |mu|, and a description."""
        (z, faces), f, (_, targets) = self.mesh, self.map(state), self.pins(state)
        figure, folded = Figure(figsize=(6.4, 3.3)), flipped_faces(faces, f)
        image, sizes = figure.subplots(1, 2)
        grid_plot(disk_axes(image), z, faces, f)
        for triangle in f[faces[folded]]:
            image.fill(triangle.real, triangle.imag, color=FLIPPED_COLOUR, zorder=4)
        image.plot(targets.real, targets.imag, "o", color="#E69F00", zorder=5)
        disk_plot(sizes, z, faces, abs(beltrami_coefficient(z, faces, f)), cmap="YlGnBu", vmin=0, vmax=1)
        for ax, title in ((image, "grid, pins and folds"), (sizes, "|μ|")):
            ax.set_title(title, fontsize=10)
        return figure, f"A grid with four pinned points pulled aside, {len(folded)} folded triangles at them, and |μ|."
