"""The browser's exact solver and fit, run by node, against the library: maps, fits, refusals, kernels."""

import shutil
import subprocess
import warnings
from dataclasses import replace

import numpy as np
import pytest
from reference import COARSE, CONVERGED, FINE, FINE_MESH, MODULES, fit_in_steps, numbers, pairs, request, run_engine

from qcbook.examples import example_problems
from qclearn.benchmark.methods.harmonic import harmonic
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import Disk
from qclearn.plane.grids import POWER, polar_disk
from qclearn.plane.solver import DiskSolver
from qclearn.registration.fit import report_fit
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.registration.report import measured_losses

SIZES = [COARSE, FINE, (32, 96, POWER), (48, 144, 1.0)]


def coefficient(size, rng):
    c, (a, b) = Disk(*polar_disk(*size)).centroids, rng.uniform(1, 4, 2)
    return 0.7 * np.sin(a * c.real + b) * np.exp(1j * b * c.imag)


def scattered(seed):
    """A request with landmarks anywhere and targets drawn apart at random: folds."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 24))
    p = 0.9 * np.sqrt(rng.random(count)) * np.exp(2j * np.pi * rng.random(count))
    q = p + rng.uniform(0.03, 0.1) * (rng.normal(size=count) + 1j * rng.normal(size=count))
    problem = Problem(FINE_MESH, p, q / np.maximum(1, 1.05 * abs(q)))
    return request(problem, 1.0, float(10 ** rng.uniform(-4, -2)), float(10 ** rng.uniform(3.5, 6)))


def settings():
    """Twenty requests: the live page's problems with points and sliding, and scattered ones that switch rows."""
    examples, rng = [example.problem for example in example_problems()], np.random.default_rng(3)
    made = []
    for k in range(18):
        problem = replace(examples[k % 3], sliding=k >= 12)
        alpha, beta, gamma = (float(10 ** rng.uniform(low, high)) for low, high in ((-1, 1), (-3, 0), (2, 6)))
        made.append(request(problem, alpha, beta, gamma))
    return [*made, scattered(1043), scattered(1045)]


SOME = [2, 9, 13, 18]  # of `settings`: points, sliding, and one that switches rows
OTHERS = sorted({*range(20)} - {*SOME})


@pytest.fixture(scope="module", params=[SOME, pytest.param(OTHERS, marks=pytest.mark.slow)], ids=["some", "others"])
def asked(request):
    every = settings()
    return [every[k] for k in request.param]


def fits(asked, **options):
    return run_engine("fits", coarse=COARSE, fine=FINE, fits=asked, options=options)


@pytest.fixture(scope="module")
def converged(asked):
    return fits(asked, tolerance=CONVERGED, most=60, stuck=1)


def test_maps_are_the_solvers():
    rng = np.random.default_rng(1)
    coefficients = [coefficient(size, rng) for size in SIZES]
    given = [{"size": size, "mu": pairs(mu)} for size, mu in zip(SIZES, coefficients)]
    for found, size, mu in zip(run_engine("maps", maps=given), SIZES, coefficients):
        solver = DiskSolver(Disk(*polar_disk(*size)))
        assert abs(numbers(found["f"]) - solver.solve(mu)).max() < 1e-10
        assert found["raised"] == solver.floored


def test_converged_fits_are_the_librarys(asked, converged):
    switched = []
    for one, found in zip(asked, converged):
        objective, state = fit_in_steps(one, *found["steps"])
        assert found["switched"] == state.switched
        assert found["switched"] or found["left"] < CONVERGED
        switched.append(state.switched)
        assert abs(numbers(found["f"]) - state.f).max() < 1e-5
        loss = report_fit(objective, state, ()).losses["L_CP"]
        assert abs(found["losses"]["L_CP"] / loss - 1) < 1e-6
        assert found["flipped"] == FINE_MESH.at(state.f).maybe_flipped.tolist()
    assert any(switched)


def test_the_pages_rule_ends_near_the_minimum(asked, converged):
    for found, last in zip(fits(asked), converged):
        if not last["switched"]:
            assert -1e-9 < found["left"] < 1e-3
            assert found["objective"] < 1.005 * last["objective"]


def test_a_fit_that_gets_stuck_rises_to_gamma_on_the_fine_mesh():
    """Neighbouring lines are pulled apart: the steps from the coarse mesh's map end at a loss of 45."""
    t = np.linspace(-0.4, 0.4, 9)
    lines = np.concatenate([t - 0.05j, t + 0.05j])
    problem = Problem(FINE_MESH, lines, lines + np.repeat([-0.4, 0.4], 9), np.repeat([0, 1], 9))
    (found,) = fits([request(problem, 1.0, 0.01, 1e5)])
    assert found["left"] < 0.1 and found["objective"] < 1 and not found["flipped"]


def test_measured_losses_and_folds_are_the_librarys():
    """Of harmonic maps with springs, the hardest of which fold."""
    problem = example_problems()[2].problem
    problem = Problem(FINE_MESH, problem.moving, problem.target)
    weights, asked = Weights(1.0, 1e-2, 1e4), request(problem, 1.0, 1e-2, 1e4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        maps = [harmonic(problem, weight, correct=False) for weight in (0.0, 1.0, 1e3)]
    found = run_engine("measured", fine=FINE, request=asked, maps=[pairs(f) for f in maps])
    for f, one in zip(maps, found):
        loss = measured_losses(problem, weights, FINE_MESH.coefficient(f), problem.samples @ f)["L_CP"]
        assert one["L_CP"] == pytest.approx(loss, rel=1e-9)
        assert one["flipped"] == FINE_MESH.at(f).maybe_flipped.tolist()
    assert found[2]["flipped"]


def test_bad_input_is_refused_in_the_librarys_words():
    good = {"moving": [0.1, 0.5j], "target": [0.2, 0.4j]}
    twice, outside = {"target": [0.3 - 0.25j, 0.3 - 0.25j]}, {"moving": [0.1, 1.5 + 0.5j]}
    lacking = {"target": [0.1]}, {"moving": [], "target": []}
    bad = [{"moving": [0.1, 0.1]}, twice, outside, *lacking, {"alpha": 0.0}, {"beta": -1.0}]
    given = [{"alpha": 1.0, "beta": 0.1, "gamma": 1e4} | good | one for one in bad]
    asked = [one | {side: pairs(np.array(one[side], complex)) for side in ("moving", "target")} for one in given]
    words = run_engine("refusals", requests=asked)
    for one, said in zip(given, words):
        with pytest.raises(LandmarkError) as refused:
            Weights(one["alpha"], one["beta"], one["gamma"])
            Problem(FINE_MESH, np.array(one["moving"], complex), np.array(one["target"], complex))
        if "positive" in str(refused.value):
            assert said.split(":")[1] == str(refused.value).split(":")[1]
        else:
            assert said == str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kernels", "layers"])
def test_the_binary_is_made_from_its_source(name, tmp_path):
    """Where npm can install the compiler of package-lock.json, it makes the very bytes that are committed."""
    if shutil.which("npm") is None:
        pytest.skip("NO NPM: that the .wasm files belong to their sources is NOT checked")
    for file in ("package.json", "package-lock.json", f"{name}.ts"):
        shutil.copy(MODULES / file, tmp_path)
    install = ["npm", "ci", "--no-audit", "--no-fund", "--prefer-offline"]
    if subprocess.run(install, cwd=tmp_path, capture_output=True, check=False, timeout=120).returncode:
        pytest.skip("npm cannot install the compiler: that the .wasm files belong to their sources is NOT checked")
    subprocess.run(["npm", "run", name], cwd=tmp_path, capture_output=True, check=True)
    assert (tmp_path / f"{name}.wasm").read_bytes() == (MODULES / f"{name}.wasm").read_bytes()


@pytest.mark.parametrize("path", sorted(MODULES.glob("*.[jt]s")), ids=lambda path: path.name)
def test_a_module_is_short(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 300 and max(map(len, lines)) <= 130
