"""The explorable of the landmark fit, the registration tuner: what Python knows of it."""

import json
import time
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure

from qcbook.scenes import surface_picture
from qclearn.benchmark.measured import read_measured
from qclearn.plane.grids import COARSE, FINE
from qclearn.plot import map_curves
from qclearn.registration.fit import fit_problem
from qclearn.registration.problem import DELTA, ETA
from qclearn.registration.report import measured_losses
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.curvature import grey_levels, mean_curvature
from qclearn.surfaces.surface import Surface

from .examples import CORTICES, cortices
from .live import Live, as_pairs
from .livefiles import cpnet_file, hemisphere_file, packed
from .liveproblems import LINE, START, as_json, as_moved, density_of, example, problems_file, unfolded, weights_of


class Tuner(Live):
    """Weights, landmarks and targets of the landmark fit, on the brain and in the disk; of the page on live tuning."""

    page = "tuner"
    # With this gamma landmarks hardly move yet: the reader's first move fits.
    initial = MappingProxyType(
        START
        | {"gamma": 1.0, "delta": DELTA, "eta": ETA, "folds": False, "shade": "mu", "kept": None, "wipe": 0.5}
        | {"turn": 0.0, "tilt": 10.0, "zoom": 1.2, "unfold": 0.6, "before": False}
        | {"solver": "exact", "mesh": "coarser", "looks": "2"}
    )
    meshes = MappingProxyType({"coarser": COARSE, "finer": FINE})
    # Of delta and eta, at which maps of folds and curves are computed beforehand, a factor of two apart.
    grid = MappingProxyType({"delta": [0.75, 1.5, 3, 6, 12], "eta": [0.875, 1.75, 3.5, 7, 14]})

    def __init__(self, folder=None):
        """folder: of `qclearn register --out folder`, whose curves and surfaces take the place of the page's
        problems."""
        self.folder = None
        if folder is not None:
            from .ownmap import OwnMap  # here, as it needs the command line

            self.folder = own = OwnMap(folder)
            self.moving, self.control, self.curves = own.moving, own.control, own.curves
            self.initial = MappingProxyType(self.initial | own.start)

    def files(self):
        """The inner loops in WebAssembly, the problems, the control surfaces, and CP-Net."""
        from qclearn.nets import load  # here, as it needs torch

        if own := self.folder:
            problem = as_json(own.example, own.pair, own.again)
            problem |= {"surface": "control.bin", "note": own.note}
            surfaces = {"control.bin": surface_file(own.drawn_control())}
            files = {"problems.json": json.dumps({"own": problem}).encode(), "cpnet.bin": cpnet_file(load("cpnet"))}
            return super().files() | files | surfaces
        # The synthetic subjects have one control.
        controls = {f"control-{'cortex' if name == 'cortex' else 'subject'}.bin": cortices(name) for name in CORTICES}
        surfaces = {file: surface_file(pair.control) for file, pair in controls.items()}
        problems = problems_file()
        files = {"problems.json": problems, "cpnet.bin": cpnet_file(load("cpnet"))}
        files |= self.fold_files(json.loads(problems), read_measured("foldgrid"))
        return super().files() | files | surfaces

    def fold_files(self, problems, grid):
        """The maps of folds and curves of a measured `grid`, and the problems with the state that shows them."""
        kept = "landmarks", "mesh", "solver", "starts", "targets", "delta", "eta"
        own = {name: self.initial[name] for name in kept} | grid["weights"]
        problems["cortex"]["folds"] = own | {"held": grid["held"]}
        return {"problems.json": json.dumps(problems).encode(), "folds.bin": packed({}, {"maps": grid["maps"]})}

    def problem(self, state):
        """The reader's problem on the browser's mesh."""
        given = self.folder.example if self.folder else example(state["problem"])
        return as_moved(given.problem, state, self.meshes[state["mesh"]])

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
        """A photograph of the unfolded control surface with the registered curves, and a description."""
        pair, problem = cortices(state["problem"]), self.problem(state)
        fit = fit_problem(problem, weights_of(state), rings=self.meshes[state["mesh"]][0])
        moving, targets = pair.sample_landmarks(LINE)
        surface = pair.control.surface
        shape = ParameterizedSurface(Surface(unfolded(surface), surface.faces), pair.control.disk)
        curves = [(shape.lift(line), "target") for line in targets]
        curves += [(shape.lift(line), "registered") for line in map_curves(problem.disk, fit.f, moving)]
        shades = grey_levels(mean_curvature(surface), surface.vertex_areas)
        figure = Figure(figsize=(6.4, 4.3), dpi=50)  # a photograph: twice the dots would be a megabyte
        pixels = surface_picture(shape.surface, shades, height=185, curves=curves)
        figure.add_axes((0, 0, 1, 1)).imshow(pixels)
        figure.axes[0].axis("off")
        ends = (pair.control.lift(points) for points in (problem.samples @ fit.f, problem.target))
        off = np.linalg.norm(np.subtract(*ends), axis=1).mean()
        return figure, (
            f"The unfolded control surface of {pair.name}: registered sulci yellow, their targets red, on average "
            f"{off:.1f} mm apart."
        )


def surface_file(control):
    """A control's `ParameterizedSurface` as the tuner reads it."""
    return hemisphere_file(control, unfolded=unfolded(control.surface), density=density_of(control))
