"""The explorables: what Python knows of each, see `live.py`. The browser's side of one is `explore_<page>.js`."""

import time
from types import MappingProxyType

import numpy as np
from IPython.display import Image
from matplotlib.figure import Figure

from ..plane.disk import solve_beltrami_disk
from ..plane.diskmesh import polar_disk
from ..plane.mobius import mobius
from ..registration.fit import POWER, fit_problem
from ..registration.metrics import measured_losses
from ..registration.problem import Weights
from ..registration.register import load
from .canvas import Canvas
from .explore_boundary import Boundary
from .explore_growth import Growth
from .explore_lbs import LBS
from .live import Live, as_pairs, loops
from .livenets import cpnet_file, dbsnet_file
from .liveproblems import as_moved, example, problems_file, weights_of
from .livesurfaces import Landmarks, Sulci
from .plot import disk_axes, disk_plot, lines_plot
from .widgets import describe, fit_state


class Mobius(Live):
    """Möbius maps of the disk, of the chapter on conformal maps."""

    page = "mobius"
    initial = MappingProxyType({"size": 0.4, "direction": 30.0, "turn": 0.0, "figure": "polar"})
    circle = 0.5 + 0.2 * np.exp(2j * np.pi * np.arange(181) / 180)

    @staticmethod
    def parameters(state):
        """(a, theta) of the map."""
        return state["size"] * np.exp(1j * np.radians(state["direction"])), np.radians(state["turn"])

    def read(self, name, state, found):
        if name in ("a", "theta"):
            return self.parameters(state)[name == "theta"]
        return super().read(name, state, found)

    def answer(self, state):
        """Centre and radius of what the red circle becomes, from three of its points."""
        p, q, r = mobius(self.circle[[0, 60, 120]], *self.parameters(state))
        w = (r - p) / (q - p)
        centre = (q - p) * (w - abs(w) ** 2) / (2j * w.imag) + p
        return {"centre": [centre.real, centre.imag], "radius": abs(p - centre)}

    def picture(self, state):
        """A Matplotlib figure of the disk and its image, and a description."""
        figure = Figure(figsize=(6.4, 3.3))
        t, radii = np.exp(2j * np.pi * np.arange(181) / 180), np.linspace(0, 1, 31)
        lines = [*(r * t for r in (0.2, 0.4, 0.6, 0.8, 1)), *(radii * t[k] for k in range(0, 180, 15))]
        a, theta = self.parameters(state)
        views = ("the disk and the pole a", lambda z: z, a), ("its image", lambda z: mobius(z, a, theta), 0)
        for ax, (title, view, pole) in zip(figure.subplots(1, 2), views):
            disk_axes(ax)
            lines_plot(ax, [view(line) for line in lines], "#1F4E79")
            ax.plot(view(self.circle).real, view(self.circle).imag, color="#B22222", linewidth=2)
            ax.plot(np.real(pole), np.imag(pole), "o", color="#E69F00")
            ax.set_title(title, fontsize=10)
        return figure, "A polar grid of the disk with a red circle, and its image by a Möbius map: circles all."


class Mu(Live):
    """A coefficient that the reader sets and paints, of the chapter on quasi-conformal maps."""

    page = "mu"
    initial = MappingProxyType(
        {
            "preset": "waves",
            "size": 0.5,
            "direction": 60.0,
            "frequencies": 4,
            "radius": 0.15,
            "dbsnet": False,
            "brush": (0.5, 0.5),
            "strokes": (),
        }
    )
    mesh = polar_disk(32, 96, POWER)
    presets = MappingProxyType(
        {
            "constant": lambda z: 1 + 0 * z,
            "radial": lambda z: z / z.conj(),
            "waves": lambda z: np.sin(4 * z.real) * np.cos(3 * z.imag) + 0j,
            "bump": lambda z: np.exp(-(abs(z - 0.3 - 0.2j) ** 2) / 0.3**2) + 0j,
            "blank": lambda z: 0 * z,
        }
    )

    def files(self):
        """The inner loops in WebAssembly, and DBS-Net."""
        return loops() | {"dbsnet.bin": dbsnet_file(load("dbsnet"))}

    def coefficient(self, state):
        """mu (F,) on the faces of the mesh: the preset, and what was painted over it."""
        z, faces = self.mesh
        centres = z[faces].mean(1)
        mu = state["size"] * np.exp(1j * np.radians(state["direction"])) * self.presets[state["preset"]](centres)
        for x, y, radius, re, im in state["strokes"]:
            mu[abs(centres - complex(x, y)) <= radius] = complex(re, im)
        return mu

    def answer(self, state):
        """The exact solver's map."""
        return {"map": as_pairs(solve_beltrami_disk(*self.mesh, self.coefficient(state)))}

    def read(self, name, state, found):
        """mu (F,) on the faces of `mesh`."""
        if name == "mu":
            return self.coefficient(state)
        return super().read(name, state, found)

    def picture(self, state):
        """A Matplotlib figure of |mu| and of the grid under the exact map, and a description."""
        (z, faces), mu = self.mesh, self.coefficient(state)
        f, figure = solve_beltrami_disk(z, faces, mu), Figure(figsize=(6.4, 3.3))
        sizes, image = figure.subplots(1, 2)
        disk_plot(sizes, z, faces, abs(mu), cmap="YlGnBu", vmin=0, vmax=1)
        disk_axes(image)
        rings = f[1:].reshape(32, 96)
        lines = [*(np.append(ring, ring[0]) for ring in rings[3::4]), *(np.append(f[0], s) for s in rings.T[::4])]
        lines_plot(image, lines, "#1F4E79")
        for ax, title in ((sizes, "|μ|"), (image, "grid under the exact map")):
            ax.set_title(title, fontsize=10)
        return figure, "The size of a coefficient in waves over the disk, and the grid bent by the map that has it."


class Tuner(Live):
    """Weights, landmarks and targets of the landmark fit, of the page on live tuning."""

    page = "tuner"
    initial = MappingProxyType(
        {
            "problem": "cortex",
            "landmarks": "points",
            "solver": "exact",
            "mesh": "coarser",
            "looks": "2",
            "alpha": Weights.alpha,
            "beta": Weights.beta,
            "gamma": Weights.gamma,
            "lambda": 10.0,
            "starts": {},
            "targets": {},
        }
    )
    meshes = MappingProxyType({"coarser": (24, 72), "finer": (32, 96)})

    def files(self):
        """The inner loops in WebAssembly, the problems, and CP-Net."""
        return loops() | {"problems.json": problems_file(), "cpnet.bin": cpnet_file(load("cpnet"))}

    def problem(self, state):
        """The problem as the reader has changed it, on the mesh that the browser uses."""
        return as_moved(example(state["problem"]).problem, state, self.meshes[state["mesh"]])

    def answer(self, state):
        """The library's fit: its map, L_CP, landmark error and milliseconds."""
        problem, weights = self.problem(state), weights_of(state)
        start = time.perf_counter()
        fit = fit_problem(problem, weights, rings=self.meshes[state["mesh"]][0])
        losses = measured_losses(problem, weights, fit.mu, problem.samples @ fit.f)
        return {
            "map": as_pairs(fit.f),
            "L_CP": losses["L_CP"],
            "landmarkError": fit.landmark_error,
            "ms": 1000 * (time.perf_counter() - start),
        }

    def picture(self, state):
        """The library's figure of the exact fit, and a description."""
        given = example(state["problem"])
        found = {"exact fit": fit_state(given, tuple(state[name] for name in ("alpha", "beta", "gamma")))}
        words = f"Landmarks, deformed grid, |μ| and its histogram for {given.name}. {describe(found['exact fit'])}"
        return Image(Canvas(given, list(found)).draw(found)), words


EXPLORABLES = (Mobius, Mu, Tuner, Sulci, Landmarks, LBS, Boundary, Growth)
