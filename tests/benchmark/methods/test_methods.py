"""The registration methods on problems whose answer is known, and the solver that several of them share."""

from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from exactmaps import moebius
from meshes import random_disk, random_mu
from qclearn.benchmark.methods import METHODS, networks
from qclearn.benchmark.methods.harmonic import harmonic, smoothed
from qclearn.benchmark.methods.qc_iteration import qc_iteration
from qclearn.benchmark.methods.solver import HARD, LandmarkSolver, truncated
from qclearn.benchmark.methods.teichmuller import extremal
from qclearn.benchmark.methods.thin_plate import thin_plate
from qclearn.plane.beltrami import solve_beltrami_disk
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.solver import DiskSolver
from qclearn.registration import Problem
from qclearn.registration.fit import fit_landmarks
from qclearn.surfaces.conformal import disk_conformal_map
from qclearn.surfaces.surface import Surface

MOVED = moebius(0.2 - 0.1j, 0.7)
NETWORK_METHODS = sorted(name for name, method in METHODS.items() if method.__module__.endswith(".networks"))
# By landmarks alone, and without networks; those that look at folds are in test_real_cortex.py and test_spheres.py.
CLASSICAL = sorted(set(METHODS) - {*NETWORK_METHODS, "hybrid", "dense", "landmark_free", "rotation"})
MET = {"thin_plate": 1e-3, "teichmuller": 1e-4, "qc_iteration": 1e-4}  # landmarks that are held are met so closely


def four_curves(count=8):
    """Landmarks (4 count,) on four segments in the disk, and their labels."""
    along = 0.12 * np.linspace(-1, 1, count)
    segments = [(0.3, 0.2), (-0.4 + 0.2j, 1.0), (-0.1 - 0.5j, 2.0), (0.1 + 0.5j, 0.0)]
    return np.concatenate([centre + np.exp(1j * turn) * along for centre, turn in segments]), np.repeat(range(4), count)


@pytest.fixture(scope="module")
def mesh():
    return Disk(*random_disk(3, 96))


@pytest.fixture(scope="module")
def moved(mesh):
    """A problem whose targets come from a known map of |mu| up to 0.4, found on a finer mesh than the problem's."""
    fine = Disk(*polar_disk(24, 72))
    f = DiskSolver(fine).solve(random_mu(np.random.default_rng(0), fine.z, fine.faces, 0.4))
    p, curve = four_curves()
    return Problem(mesh, p, fine.interpolation(p) @ f, curve)


def error(problem, f):
    return abs(problem.samples @ f - problem.target).mean()


# Of the Teichmüller iteration, whose mean |mu| creeps, and of a fit to landmarks that a Möbius map takes where they go.
SAID = ("not settled after", "that map is returned")
pytestmark = [pytest.mark.filterwarnings(f"ignore:.*{words}:qclearn.plane.bijectivity.RepairWarning") for words in SAID]


@pytest.mark.parametrize("name", ["mobius_only", "harmonic", "thin_plate", "gauss_newton"])
def test_landmarks_matched_by_a_mobius_map_give_it(name, mesh):
    p, curve = four_curves()
    f = METHODS[name](Problem(mesh, p, MOVED(p), curve))
    # Between the vertices of a mesh of this width (0.065) the Möbius map is off its linear interpolant by up to 4e-3.
    np.testing.assert_allclose(f, MOVED(mesh.z), atol=8e-3)
    assert mesh.certify(f).bijective


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_known_map_is_approached_turns_with_the_targets_and_keeps_the_circle(name, moved):
    f, floor = METHODS[name](moved), error(moved, METHODS["mobius_only"](moved))
    assert 0.02 < floor < 0.04
    assert name == "mobius_only" or error(moved, f) < MET.get(name, 0.5 * floor)
    turned = Problem(moved.disk, moved.moving, 1j * moved.target, moved.curve)
    np.testing.assert_allclose(METHODS[name](turned), 1j * f, atol=1e-4)
    if name != "thin_plate":
        np.testing.assert_allclose(abs(f[moved.disk.loop]), 1, atol=1e-12)


def test_the_solution_has_the_least_energy(moved):
    solver, weight, rng = LandmarkSolver(moved), 0.7, np.random.default_rng(1)
    mu = random_mu(rng, moved.disk.z, moved.disk.faces, 0.3)
    K = moved.disk.stiffness(mu)

    def energy(f, target):
        return ((f.conj() @ (K @ f)).real + weight * (abs(moved.samples @ f - target) ** 2).sum()) / 2

    f = solver.solve(mu, weight)
    step = 1e-3 * (rng.normal(size=len(f)) + 1j * rng.normal(size=len(f)))
    step[moved.disk.loop] = 0
    for sign in (1, -1):  # to first order nothing changes, to second what the quadratic form says
        change = energy(f + sign * step, moved.target) - energy(f, moved.target)
        assert change == pytest.approx(energy(step, 0), rel=1e-6)


def test_truncation_keeps_the_direction_and_the_small():
    mu = np.array([0.5j, 3 - 4j, np.inf, np.nan, 0])
    np.testing.assert_allclose(truncated(mu), [0.5j, 0.594 - 0.792j, 0, 0, 0])


def crossing(mesh, shift):
    """Two short curves that turn by a share `shift` of the circle among landmarks that stay; uncorrected maps fold."""
    along, circle = 0.1j * np.linspace(-1, 1, 6), 0.9 * np.exp(1j * np.arange(8) * np.pi / 4)
    p, turn = np.concatenate([along - 0.15, along + 0.15]), np.exp(2j * np.pi * shift)
    target = np.concatenate([turn * p, circle])
    return Problem(mesh, np.concatenate([p, circle]), target, np.repeat([0, 1, 2], [6, 6, 8]))


def test_a_heavier_weight_brings_landmarks_nearer_and_distorts_more(moved):
    maps = [harmonic(moved, weight) for weight in (0.1, 0.5, 1.0, 5.0)]
    errors = [error(moved, f) for f in maps]
    sizes = [abs(moved.disk.coefficient(f)).mean() for f in maps]
    assert errors == sorted(errors, reverse=True) and sizes == sorted(sizes)
    np.testing.assert_allclose(harmonic(moved, 0.0), METHODS["mobius_only"](moved), atol=2e-3)
    with pytest.raises(ValueError, match="weight = -1: give a number from 0"):
        harmonic(moved, -1)


def test_overlap_correction_unfolds(mesh, monkeypatch):
    problem = crossing(mesh, 0.2)
    folded = harmonic(problem, 50.0, correct=False)
    assert len(mesh.at(folded).maybe_flipped) > 0
    with pytest.warns(RepairWarning, match="faces flipped, 0 after"):
        f = harmonic(problem, 50.0)
    assert mesh.certify(f).bijective
    assert error(problem, f) < 0.7 * error(problem, METHODS["mobius_only"](problem))
    module = import_module("qclearn.benchmark.methods.harmonic")  # not the function of that name
    monkeypatch.setattr(module, "MOST_ROUNDS", 0)
    with pytest.warns(RepairWarning, match=r"(\d+) faces flipped, \1 after 0 rounds"):
        harmonic(problem, 50.0)


@pytest.mark.digits
def test_overlap_correction_leaves_what_does_not_fold(moved):
    np.testing.assert_array_equal(harmonic(moved, 1.0), harmonic(moved, 1.0, correct=False))


def test_smoothing_keeps_the_argument_and_evens_the_modulus(moved):
    solver = LandmarkSolver(moved)
    even = np.full(len(moved.disk.faces), 0.3 * np.exp(0.4j))
    np.testing.assert_allclose(smoothed(solver, even, 2.0), even / 1.5, rtol=1e-9)
    rough = even * np.random.default_rng(3).uniform(0.5, 1.5, len(even))
    soft = smoothed(solver, rough, 2.0)
    np.testing.assert_allclose(np.angle(soft), 0.4, atol=1e-9)
    assert abs(soft).std() < 0.5 * abs(moved.disk.to_vertices @ rough)[moved.disk.faces].mean(1).std()


def test_quasi_conformal_iteration_is_smoother_than_one_solve(moved):
    def roughness(f):
        """`int |grad mu|^2` of a map's coefficient, made piecewise linear."""
        nodal = disk.to_vertices @ disk.coefficient(f)
        return (nodal.conj() @ (disk.laplace @ nodal)).real

    disk = Disk(*random_disk(3, 160))  # finer than the landmarks' spacing
    problem = Problem(disk, moved.moving[::2], moved.target[::2])
    once = LandmarkSolver(problem).solve(np.zeros(len(disk.faces), complex), HARD)
    assert roughness(qc_iteration(problem)) < 0.5 * roughness(once)


def test_quasi_conformal_iteration_lets_landmarks_go_where_they_fold(mesh):
    problem = crossing(mesh, 0.5)
    with pytest.warns(RepairWarning, match="landmarks held; let go"):
        f = qc_iteration(problem)
    assert error(problem, f) > 1e-4


def displacement(rings):
    """Teichmüller's displacement problem on an ellipse, carried to the disk: (solver, mu's modulus).

    With `w = R e^it + e^-it / R` the affine map that swaps the ellipse's axes, seen through `w^2` (shifted by 2 before
    and after), is the map of the ellipse with semi-axes `R^2 + R^-2`, `R^2 - R^-2` that holds its boundary and takes
    one focus to the other: constant `|mu| = 2 / (R^2 + R^-2)`, and extremal.
    """
    R = 2.5
    long, short = R**2 + R**-2, R**2 - R**-2
    z, faces = polar_disk(rings, 3 * rings)
    ellipse = np.stack([long * z.real, short * z.imag, 0 * z.real], 1)
    disk = Disk(disk_conformal_map(Surface(ellipse, faces)), faces)
    foci = Disk((ellipse @ [1, 1j, 0]) / long, faces).interpolation(np.array([-2, 2]) / long) @ disk.z
    solver = LandmarkSolver(Problem(disk, foci[:1], foci[1:]))
    solver.boundary = disk.z[disk.loop]
    return solver, 2 / long


def test_a_teichmuller_iteration_that_does_not_settle_says_so(moved):
    with pytest.warns(RepairWarning, match="not settled after 60 rounds .the mean .mu. still changes by"):
        METHODS["teichmuller"](moved)


def test_teichmullers_displacement_is_found_with_its_constant():
    spreads = []
    for rings in (16, 32):
        solver, k = displacement(rings)
        f = extremal(solver)
        size, areas = abs(solver.disk.coefficient(f)), solver.disk.areas
        mean = areas @ size / areas.sum()
        assert mean == pytest.approx(k, rel=0.03)
        assert abs(solver.samples @ f - solver.target).mean() < 1e-4 and solver.disk.certify(f).bijective
        spreads.append(np.sqrt(areas @ (size - mean) ** 2 / areas.sum()) / mean)
    assert spreads[1] < 0.7 * spreads[0] < 0.03


def test_thin_plates_reproduce_affine_maps_which_leave_the_circle(mesh):
    p = np.concatenate([r * np.exp(1j * np.pi / 4 * np.arange(8)) for r in (0.3, 0.6)])  # the best Möbius map is none
    f = thin_plate(Problem(mesh, p, 0.6 * p + 0.2 * p.conj()))
    np.testing.assert_allclose(f, 0.6 * mesh.z + 0.2 * mesh.z.conj(), atol=1e-6)
    assert abs(f).max() < 0.81


def test_smoothing_lets_thin_plates_bend_less(moved):
    exact, soft = (error(moved, thin_plate(moved, smoothing)) for smoothing in (0.0, 1e-1))
    assert exact < 0.6 * soft


def twins(monkeypatch, quality):
    """Puts exact answers, a fit's mu shrunk by `quality` and the exact solver, for the networks: list of calls."""

    def network(*words):
        asked.append(words)
        return SimpleNamespace(predict=predict, solve=solve_beltrami_disk)

    def predict(*given, **more):
        return quality * fit_landmarks(*given, **more).mu

    asked = []
    monkeypatch.setattr(networks, "network", network)
    return asked


@pytest.mark.parametrize("name", [*NETWORK_METHODS, "coarse_steps"])
def test_perfect_networks_and_their_exact_counterpart_give_the_fits_map(name, moved, monkeypatch):
    twins(monkeypatch, 1.0)
    fit, f = METHODS["gauss_newton"](moved), METHODS[name](moved)
    assert abs(f - fit).max() < 0.02 and error(moved, f) < 2e-3
    np.testing.assert_allclose(abs(f[moved.disk.loop]), 1, atol=1e-12)


def test_steps_bring_a_poor_start_nearer(moved, monkeypatch):
    twins(monkeypatch, 0.6)
    errors = [error(moved, METHODS["cpnet_exact"](moved))]
    errors += [error(moved, METHODS["cpnet_steps"](moved, steps=steps)) for steps in (1, 2)]
    assert errors[1] < 0.3 * errors[0] and errors[2] < errors[0]


def test_the_guard_refines_a_poor_answer_and_says_so(moved, monkeypatch):
    twins(monkeypatch, 0.6)
    assert error(moved, METHODS["cpnet_dbsnet"](moved)) > networks.TIGHT_TOLERANCE
    with pytest.warns(RepairWarning, match="Gauss-Newton steps, to"):
        f = METHODS["guarded"](moved)
    assert error(moved, f) < networks.TIGHT_TOLERANCE


def test_presets_and_weights_reach_the_networks(moved, monkeypatch):
    asked = twins(monkeypatch, 1.0)
    METHODS["cpnet_dbsnet"](moved, preset="paper", alpha=1.0, beta=1.0, gamma=1e4)
    assert asked == [("cpnet", "paper", 1e4), ("dbsnet", "paper")]
