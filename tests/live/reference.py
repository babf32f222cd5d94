"""What the book's browser modules are held against: node to run them in, and the library's own answers."""

import functools
import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from qcbook.live import GIVEN, given
from qclearn.plane.grids import POWER, polar
from qclearn.plane.solver import CoefficientMesh, on_itself
from qclearn.registration import gauss_newton
from qclearn.registration.gauss_newton import GaussNewtonObjective
from qclearn.registration.levels import FIRST_GAMMA
from qclearn.registration.problem import Problem, Weights

ROOT = Path(__file__).resolve().parents[2]
MODULES = ROOT / "book" / "_assets" / "live"
COARSE, FINE = (12, 36, POWER), (24, 72, POWER)
COARSE_MESH, FINE_MESH = polar(12), polar(24)
CONVERGED = 1e-6  # of the objective: what the last step promised


@functools.cache
def engine_folder():
    """The browser's modules with the one that the library writes, as the site has them."""
    folder = tempfile.TemporaryDirectory()
    shutil.copytree(MODULES, folder.name, dirs_exist_ok=True)
    (Path(folder.name) / GIVEN).write_text(given(), encoding="utf-8")
    return folder


def run_engine(task, **asked):
    """The answer of tests/live/engine.mjs to a task; skips where there is no node."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("NO NODE: the browser's engine is NOT compared with the library. On Debian: apt-get install nodejs")
    command = [node, Path(__file__).with_name("engine.mjs"), engine_folder().name, task]
    found = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


def pairs(z):
    """Complex numbers as JSON has them."""
    return np.stack([np.real(z), np.imag(z)], -1).tolist()


def numbers(found):
    """And back."""
    return np.asarray(found) @ [1, 1j]


def request(problem, alpha, beta, gamma):
    """A problem with weights as the browser gets it."""
    points = {"moving": pairs(problem.moving), "target": pairs(problem.target), "curve": problem.curve.tolist()}
    return points | {"sliding": problem.sliding, "alpha": alpha, "beta": beta, "gamma": gamma}


class WholeSteps(GaussNewtonObjective):
    """The browser solves a step's equations to the last digit, with no bound on its work; the library stops earlier."""

    spent = False

    @patch.multiple(gauss_newton, SMALL_GAIN=0.0, FORCING=1e-14)
    def step(self, state, gamma):
        return super().step(state, gamma) or state


def fit_in_steps(asked, on_coarse, on_fine):
    """(objective, state) of so many of the library's Gauss-Newton steps on either mesh for a `request`: at the minimum
    rounding decides whether one more is taken, and its promise says no more."""
    points = numbers(asked["moving"]), numbers(asked["target"])
    problem = Problem(FINE_MESH, *points, np.array(asked["curve"]), asked["sliding"])
    weights = Weights(asked["alpha"], asked["beta"], asked["gamma"])
    coarse = WholeSteps(problem, on_itself(polar(12)), weights, on_nu_mesh=True)
    state, gamma = (coarse.at(np.zeros(len(COARSE_MESH.z), complex), problem.mobius), weights.gamma / 10)
    levels = 10.0 ** np.arange(np.log10(min(FIRST_GAMMA, gamma)), np.log10(gamma) - 1e-9)
    for one in [*levels, *[gamma] * (on_coarse - len(levels))]:
        state = coarse.step(state, one)
    fine = WholeSteps(problem, CoefficientMesh(FINE_MESH, FINE_MESH), weights, on_nu_mesh=False)
    nu = COARSE_MESH.interpolation(FINE_MESH.z) @ state.nu
    state = fine.at(nu, state.mobius)
    for _ in range(on_fine):
        state = fine.step(state, weights.gamma)
    return fine, state
