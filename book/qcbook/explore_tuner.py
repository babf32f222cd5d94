"""The explorable of the landmark fit, the registration tuner: what Python knows of it."""

import time
from types import MappingProxyType

from qclearn.plane.grids import COARSE, FINE
from qclearn.registration.fit import fit_problem
from qclearn.registration.report import measured_losses

from .fitstates import describe, fit_state, states_figure
from .live import Live, as_pairs
from .livefiles import cpnet_file
from .liveproblems import START, as_moved, example, problems_file, weights_of


class Tuner(Live):
    """Weights, landmarks and targets of the landmark fit, of the page on live tuning."""

    page = "tuner"
    # With this gamma landmarks hardly move yet: the reader's first move fits.
    initial = MappingProxyType(
        START | {"gamma": 1.0, "solver": "exact", "mesh": "coarser", "looks": "2", "lambda": 10.0}
    )
    meshes = MappingProxyType({"coarser": COARSE, "finer": FINE})

    def files(self):
        """The inner loops in WebAssembly, the problems, and CP-Net."""
        from qclearn.nets import load  # here, as it needs torch

        return super().files() | {"problems.json": problems_file(), "cpnet.bin": cpnet_file(load("cpnet"))}

    def problem(self, state):
        """The reader's problem on the browser's mesh."""
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
        """The library's figure of the fit, and a description."""
        given = example(state["problem"])
        found = {"reference fit": fit_state(given, tuple(state[name] for name in ("alpha", "beta", "gamma")))}
        words = f"Landmarks, deformed grid, |μ| and its histogram for {given.name}. {describe(found['reference fit'])}"
        return states_figure(given, found), words
