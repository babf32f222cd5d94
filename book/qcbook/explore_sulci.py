"""The explorable of the registered sulci in 3-D: what Python knows of it."""

import json
from functools import cache
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from scipy import sparse

from qcbook.scenes import surface_picture
from qclearn.plane.disk import Disk
from qclearn.plane.grids import COARSE
from qclearn.plot import map_curves
from qclearn.registration.fit import fit_problem
from qclearn.registration.register import register
from qclearn.registration.report import measured_losses
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.curvature import grey_levels, mean_curvature
from qclearn.surfaces.surface import Surface

from .examples import CORTICES, cortices, courses_problem
from .live import Live, as_pairs
from .livefiles import hemisphere_file
from .liveproblems import START, as_moved, problems_file, weights_of

LINE = 25  # points of a drawn sulcus
UNFOLDING = 150  # rounds of averaging over neighbours


def unfolded(surface, rounds=UNFOLDING):
    """Positions (V, 3) after averaging over neighbours, scaled to the old area; the rim is averaged
    along itself."""
    count = len(surface.vertices)
    rim = np.isin(np.arange(count), np.concatenate(surface.boundary_loops))
    ends = np.concatenate([surface.edges, surface.edges[:, ::-1]])
    ends = ends[~rim[ends[:, 0]] | rim[ends[:, 1]]]  # what moves a vertex of the rim lies on the rim
    weights = 1 / np.bincount(ends[:, 0], minlength=count)[ends[:, 0]]
    means = sparse.csr_array((weights, tuple(ends.T)), shape=(count, count))
    x = surface.vertices
    for _ in range(rounds):
        x = (x + means @ x) / 2
    middle = x.mean(0)
    corners = x[surface.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    return middle + (x - middle) * np.sqrt(surface.area / area)


def courses_of(pair):
    """Names of the sulci of `Courses`, and LINE points of each in the disk, for the moving and the
    control side."""
    lines = ([as_pairs(line.round(5)) for line in side] for side in pair.sample_landmarks(LINE))
    return {"names": pair.names, **dict(zip(("moving", "target"), lines))}


@cache
def radius_on_control(name):
    """The 90 % radius of `register`'s map by the curves of `cortices(name)` alone, in tenths of mm
    at the control's vertices (V',) int: that of the moving vertices which the map brings there."""
    pair = cortices(name)
    curves = [{"name": sulcus, "moving": p, "control": q} for sulcus, p, q in zip(pair.names, *pair.paths)]
    found = register(pair.moving.surface, pair.control.surface, curves, features=None, uncertainty=True)
    there = Disk(found.disk_map, found.faces_moving)
    return np.round(10 * there.interpolate(found.uncertainty, there.locate(found.disk_control))).astype(int)


class Sulci(Live):
    """The tuner's map carried to the control surface, of the chapter on registration."""

    page = "sulci"
    initial = MappingProxyType(
        START | {"turn": 0.0, "tilt": 10.0, "zoom": 1.0, "unfold": 0.6, "before": False, "sure": False}
    )
    mesh = COARSE

    def files(self):
        """The inner loops in WebAssembly, the problems, the courses of the sulci, and the control
        surfaces."""
        pairs = {name: cortices(name) for name in CORTICES}
        # The synthetic subjects have one control.
        surfaces = {name: f"control-{'cortex' if name == 'cortex' else 'subject'}.bin" for name in CORTICES}
        controls = {file: pairs[name] for name, file in surfaces.items()}
        courses = {
            name: {"control": surfaces[name], "radius": radius_on_control(name).tolist(), **courses_of(pair)}
            for name, pair in pairs.items()
        }
        files = {"problems.json": problems_file(), "sulci.json": json.dumps(courses).encode()}
        for file, pair in controls.items():
            files[file] = hemisphere_file(pair.control, unfolded=unfolded(pair.control.surface))
        return super().files() | files

    def fit(self, state):
        """The reader's problem, and the library's fit."""
        problem = as_moved(courses_problem(cortices(state["problem"])).problem, state, self.mesh)
        return problem, fit_problem(problem, weights_of(state), rings=self.mesh[0])

    def answer(self, state):
        """The library's fit: its map, L_CP, and how far the registered landmarks are from their
        targets in mm."""
        problem, fit = self.fit(state)
        losses = measured_losses(problem, weights_of(state), fit.mu, problem.samples @ fit.f)
        return {"map": as_pairs(fit.f), "L_CP": losses["L_CP"], "mm": self.distances(state, problem, fit.f).mean()}

    @staticmethod
    def distances(state, problem, f):
        """Distance in space (M,) of each landmark on the control surface from its target, in mm."""
        pair = cortices(state["problem"])
        ends = (pair.control.lift(points) for points in (problem.samples @ f, problem.target))
        return np.linalg.norm(np.subtract(*ends), axis=1)

    def picture(self, state):
        """A photograph of the unfolded control surface with the registered curves, and a
        description."""
        pair, (problem, fit) = cortices(state["problem"]), self.fit(state)
        moving, targets = pair.sample_landmarks(LINE)
        surface = pair.control.surface
        shape = ParameterizedSurface(Surface(unfolded(surface), surface.faces), pair.control.disk)
        curves = [(shape.lift(line), "target") for line in targets]
        curves += [(shape.lift(line), "registered") for line in map_curves(problem.disk, fit.f, moving)]
        shades = grey_levels(mean_curvature(surface), surface.vertex_areas)
        figure = Figure(figsize=(6.4, 4.3), dpi=50)  # a photograph: twice the dots would be a megabyte
        figure.add_axes((0, 0, 1, 1)).imshow(surface_picture(shape.surface, shades, curves=curves))
        figure.axes[0].axis("off")
        return figure, (
            f"The unfolded control surface of {pair.name}: registered sulci yellow, their targets red, on average "
            f"{self.distances(state, problem, fit.f).mean():.1f} mm apart."
        )
