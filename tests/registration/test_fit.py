"""The landmark fit: its Jacobian and step against brute force, and maps that must be found again."""

import pickle
from dataclasses import fields

import numpy as np
import pytest
from scipy.sparse.linalg import splu

from exactmaps import TWIST
from meshes import bowl, random_disk, random_mu
from qclearn import disk_conformal_map, mirror
from qclearn.plane import linear
from qclearn.plane.beltrami import beltrami_coefficient, locate, signed_areas, solve_beltrami_disk
from qclearn.plane.bijectivity import check_bijective
from qclearn.plane.checks import BeltramiError
from qclearn.plane.coefficients import bounded
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import best_mobius, compose_mobius, mobius, mobius_inverse
from qclearn.plane.solver import CoefficientMesh
from qclearn.registration import levels as levels_module
from qclearn.registration.fit import fit_landmarks, fit_problem
from qclearn.registration.gauss_newton import MOBIUS_PRIOR, GaussNewtonObjective, conjugate_gradients, corrected
from qclearn.registration.levels import MultiresolutionFit, landmark_levels, start_field
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.registration.residuals import TANGENTIAL_WEIGHT, LandmarkTerm


def complex_normal(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def smooth_problem(seed, count=60):
    """Landmarks (count,) and their images under a smooth random map of the disk with a Möbius part."""
    rng = np.random.default_rng(seed)
    z, faces = polar_disk(48, 144)
    smooth = solve_beltrami_disk(z, faces, random_mu(rng, z, faces, 0.45))
    f = mobius(smooth, 0.08 * complex_normal(rng)[()], 0.15 * rng.normal())
    p = np.sqrt(rng.uniform(0, 0.8, count)) * np.exp(2j * np.pi * rng.uniform(size=count))
    return p, Disk(z, faces).interpolation(p) @ f


SMALL = square_disk(20)
MESH = Disk(*SMALL)


def lines(shift=0.0):
    """Two straight curves of nine landmarks, their inner points moved along them by at most `shift`; labels."""
    t = np.linspace(-1, 1, 9)
    moved = 0.5 * (t + shift * (1 - t**2))
    return np.concatenate([moved + 0.25j, -moved - 0.25j]), np.repeat([0, 1], 9)


# The prior and the residual


def test_the_prior_is_the_mean_of_mu_and_of_its_gradient():
    """For nu = a z + b conj(z): mean|nu|^2 = (|a|^2 + |b|^2)/2 over the disk, |grad nu|^2 = 2 (|a|^2 + |b|^2)."""
    z, faces = polar_disk(40, 160)
    a, b, alpha, beta = 0.3 - 0.2j, 0.1 + 0.4j, 0.7, 0.05
    mesh = Disk(z, faces)
    weights, problem = Weights(alpha, beta), Problem(MESH, z[:3], z[:3])
    newton = GaussNewtonObjective(problem, CoefficientMesh(mesh, mesh), weights, on_nu_mesh=True)
    size = abs(a) ** 2 + abs(b) ** 2
    assert newton.prior(a * z + b * z.conj()) == pytest.approx(alpha * size / 2 + beta * 2 * size, rel=2e-3)


def test_only_inner_points_slide_and_only_along_the_target():
    target, labels = lines()
    landmarks = LandmarkTerm(target * np.exp(0.4j), labels, True)
    moved = (landmarks.target + turn * np.exp(0.4j) for turn in (1, 1j))
    along, across = ((landmarks.residual(points, 18.0) ** 2).reshape(2, 18).sum(0) for points in moved)
    np.testing.assert_allclose(across, 1)
    ends = np.isin(np.arange(18), [0, 8, 9, 17])
    np.testing.assert_allclose(along, np.where(ends, 1, TANGENTIAL_WEIGHT**2))


# The step


def small_newton(sliding, seed=3):
    rng = np.random.default_rng(seed)
    mesh = Disk(*polar_disk(4, 10))
    labels = np.repeat([0, 1], 4)
    moving, target = (0.6 * np.exp(2j * np.pi * rng.uniform(size=8)) * rng.uniform(0.3, 1, 8) for _ in range(2))
    problem = Problem(MESH, moving, target, labels, sliding)
    newton = GaussNewtonObjective(problem, CoefficientMesh(mesh, mesh), Weights(1.0, 0.02), on_nu_mesh=True)
    return newton, 0.3 * complex_normal(rng, len(mesh.z)), rng


def residual(newton, nu, parameters, gamma):
    return newton.landmarks.residual(newton.at(nu, parameters).points, gamma)


@pytest.mark.parametrize("sliding", [False, True])
def test_the_dual_step_is_the_gauss_newton_step(sliding):
    """Against the normal equations in all real unknowns, with the residual's derivatives by finite differences."""
    newton, nu, _ = small_newton(sliding)
    parameters, gamma, step, n = (0.2 - 0.1j, 0.3), 50.0, 1e-5, len(nu)

    def at(x):
        moved = compose_mobius(parameters, (complex(x[2 * n], x[2 * n + 1]), x[2 * n + 2]))
        return residual(newton, nu + x[:n] + 1j * x[n : 2 * n], moved, gamma)

    J = np.stack([(at(step * unit) - at(-step * unit)) / (2 * step) for unit in np.eye(2 * n + 3)], axis=1)
    W = newton.W.toarray()
    prior = np.zeros((2 * n + 3, 2 * n + 3))
    prior[:n, :n] = prior[n : 2 * n, n : 2 * n] = W
    prior[2 * n :, 2 * n :] = MOBIUS_PRIOR * np.eye(3)
    pull = np.concatenate([W @ nu.real, W @ nu.imag, np.zeros(3)]) + J.T @ at(np.zeros(2 * n + 3))
    expected = -np.linalg.solve(J.T @ J + prior, pull)

    state = newton.at(nu, parameters)
    change, da, dtheta, promised = newton.linearise(state, gamma).propose()
    scale = abs(expected).max()
    np.testing.assert_allclose(change, expected[:n] + 1j * expected[n : 2 * n], atol=1e-5 * scale)
    np.testing.assert_allclose([da.real, da.imag, dtheta], expected[2 * n :], atol=1e-5 * scale)
    model = at(np.zeros(2 * n + 3)) + J @ expected
    least = newton.prior(nu + change) + model @ model + MOBIUS_PRIOR * (expected[2 * n :] ** 2).sum()
    assert promised == pytest.approx(least, rel=1e-5)


@pytest.mark.parametrize("seed, gamma, exact, most", [(6, 1e4, 0.0219274, 125), (2, 1e5, 0.0160866, 160)])
def test_steps_without_a_jacobian_end_where_exact_ones_do_and_cost_few_solves(seed, gamma, exact, most, monkeypatch):
    """exact: the end of steps by adjoint solves for each landmark; most: solves on the mesh.

    Equations that nothing preconditions take 2,500 and more, and those that are solved in three
    products end at nine times the least.
    """
    solves = []

    class Counted:
        def __init__(self, *given, **options):
            self.factors = splu(*given, **options)
            self.perm_c = self.factors.perm_c

        def solve(self, load):
            solves.append(self.factors.shape[0])
            return self.factors.solve(load)

    monkeypatch.setattr(linear, "HAS_CHOLMOD", False)
    monkeypatch.setattr(linear, "splu", Counted)
    p, q = smooth_problem(seed)
    fit = fit_landmarks(*SMALL, p, q, gamma=gamma)
    assert fit.losses["L_CP"] == pytest.approx(exact, rel=2e-3)
    inner = len(SMALL[0]) - 80  # vertices off the rim
    assert sum(fit.steps) <= 9 and 0 < solves.count(inner) <= most


def test_what_is_learnt_of_repeated_directions_stays_positive():
    """Conjugate gradients that rounding lets go on beyond as many steps as there are unknowns."""
    p, q = smooth_problem(6, count=12)
    mesh, gamma = CoefficientMesh(MESH, Disk(*polar_disk(8, 24))), 1e5
    objective = GaussNewtonObjective(Problem(MESH, p, q), mesh, Weights(), on_nu_mesh=False)
    first = objective.linearise(objective.at(np.zeros(len(mesh.mesh.z), complex), (0j, 0.0)), gamma).learnt
    rng = np.random.default_rng(0)
    root, few = rng.normal(size=(24, 24)), rng.normal(size=(24, 8))
    exact, noise = gamma * root @ root.T, 1e-9 * rng.normal(size=(2, 60, 24))
    directions = (few @ rng.normal(size=(8, 60))).T + noise[0]
    gram = corrected(first, [(y, exact @ y + gamma * e) for y, e in zip(directions, noise[1])], gamma)
    np.testing.assert_allclose(gamma * gram @ few, exact @ few, atol=1e-6 * abs(exact).max())
    assert np.linalg.eigvalsh(np.eye(24) + gamma * gram)[0] > 0.5


def test_where_the_line_search_fails_a_damped_step_leads_on():
    """Two spokes whose order a mirrored bowl turns round: without damped steps the larger gamma ends far above."""
    moving, control = mirror(bowl(0.6)), bowl(0.9)
    z, w = disk_conformal_map(moving), disk_conformal_map(control)
    p, q = (z[[*range(1, 145, 24), *range(7, 151, 24)]], w[[*range(2, 146, 24), *range(6, 150, 24)]])
    losses = {gamma: fit_landmarks(z, moving.faces, p, q, gamma=gamma).losses["L_CP"] for gamma in (1e3, 1e5)}
    assert losses[1e3] < losses[1e5] < 1.1 * losses[1e3]


def test_the_fit_ends_within_a_thousandth_of_the_least_objective():
    """Two neighbours that part. A rule that stops at steps of larger promise, of a third say, ends a tenth above; one
    that goes on until nothing is gained any more takes twenty steps on the mesh."""
    p = np.concatenate([[0.02, -0.02], 0.5 * np.exp(2j * np.pi * np.arange(8) / 8)])
    q = np.concatenate([[0.05j, -0.05j], p[2:] * np.exp(0.1j)])
    least = 0.0764218  # where twenty steps end
    fit = fit_landmarks(*SMALL, p, q, gamma=1e5)
    assert fit.losses["L_CP"] < 1.002 * least and fit.steps[1] <= 15


# Maps found again


@pytest.mark.parametrize("seed, mesh", [(0, 32), (3, 32), (6, 32), (2, 62), (3, random_disk(5, 64))])
def test_random_smooth_maps_are_met(seed, mesh):
    z, faces = square_disk(mesh) if isinstance(mesh, int) else mesh
    p, q = smooth_problem(seed)
    fit = fit_landmarks(z, faces, p, q, gamma=1e5)
    assert 0.08 < abs(p - q).mean() < 0.22 and abs(mobius(p, *best_mobius(p, q)) - q).mean() > 0.03
    face, weights = locate(z, faces, p)
    mapped = (weights * fit.f[faces[face]]).sum(1)
    assert abs(mapped - q).mean() <= 1e-4  # the goal is 2e-3
    assert fit.landmark_error == pytest.approx(abs(mapped - q).mean())
    assert sum(fit.steps) <= 10
    assert signed_areas(fit.f, faces).min() > 0 and fit.bijective and len(fit.flipped) == 0 and fit.fallbacks == ()
    assert check_bijective(z, faces, fit.f).bijective and abs(fit.mu).max() < 0.6
    np.testing.assert_allclose(abs(fit.f[abs(z) > 1 - 1e-9]), 1, atol=1e-12)


def test_the_result_is_measured_and_its_mobius_part_is_reported():
    z, faces = SMALL
    p, q = smooth_problem(3, 30)
    fit = fit_landmarks(z, faces, p, q)
    np.testing.assert_array_equal(fit.mu, beltrami_coefficient(z, faces, fit.f))
    before = mobius_inverse(fit.f, *fit.mobius)
    assert abs(before[np.argmin(abs(z))]) < 1e-9 and abs(before[np.argmin(abs(z - 1))] - 1) < 1e-9
    np.testing.assert_allclose(before, solve_beltrami_disk(z, faces, fit.mu), atol=0.02)


def test_a_landmark_on_the_circle_slides_along_it():
    p, q = np.array([1, 1j, -1, 0.3]), np.array([np.exp(0.3j), 1j * np.exp(-0.1j), -1, 0.2 + 0.1j])
    fit = fit_landmarks(*SMALL, p, q)
    assert fit.landmark_error < 1e-3 and fit.bijective


# What the weights mean


def test_the_losses_are_the_papers():
    z, faces = square_disk(40)
    p, q = smooth_problem(6)
    alpha, beta, gamma = 0.5, 0.02, 3e3
    fit = fit_landmarks(z, faces, p, q, alpha, beta, gamma)
    areas = signed_areas(z, faces)
    assert fit.losses["L_mu"] == pytest.approx(areas @ abs(fit.mu) ** 2 / areas.sum(), rel=0.05)
    face, weights = locate(z, faces, p)
    mismatch = (abs((weights * fit.f[faces[face]]).sum(1) - q) ** 2).mean()
    assert fit.losses["L_Landmark"] == pytest.approx(mismatch)
    total = alpha * fit.losses["L_mu"] + beta * fit.losses["L_grad_mu"] + gamma * mismatch
    assert fit.losses["L_CP"] == pytest.approx(total)


def test_sliding_frees_the_residual_along_the_curve_only():
    """The targets are the same two lines with their points spaced anew: as curves they lie right already."""
    (p, labels), (q, _) = lines(), lines(0.3)
    points, curves = (fit_landmarks(*SMALL, p, q, 1.0, 1e-2, 1e3, labels, sliding) for sliding in (False, True))
    left = MESH.interpolation(p) @ curves.f - q
    assert abs(left.imag).max() < 0.01 and abs(left.real).max() > 0.02
    assert points.landmark_error < curves.landmark_error
    assert curves.losses["L_mu"] < 0.7 * points.losses["L_mu"]


# Start


def test_a_start_is_carried_to_the_polar_mesh():
    disk, grid = Disk(*square_disk(60)), Disk(*polar_disk(6, 18))
    start = start_field(disk, TWIST.on_faces(disk), grid)
    np.testing.assert_allclose(bounded(start), TWIST.mu(grid.z), atol=0.05)


@pytest.mark.digits
def test_a_multiresolution_fit_is_run_again_with_other_weights(monkeypatch):
    """As a new one is, to the last bit, whatever the fits before have computed; its mesh is not looked at again."""
    levels, weights = landmark_levels(MESH, 8), Weights(2.0, 0.1, 10.0)
    resumed = MultiresolutionFit(Problem(MESH, *smooth_problem(3)))
    resumed.run(levels, Weights(gamma=1e5))
    _, new, _ = MultiresolutionFit(Problem(Disk(*SMALL), *smooth_problem(3))).run(levels, weights)
    monkeypatch.setattr(levels_module, "CoefficientMesh", None)
    assert np.array_equal(resumed.run(levels, weights)[1].f, new.f)


@pytest.mark.digits
def test_a_problem_that_was_fitted_holds_no_objective_and_goes_to_other_processes():
    problem = Problem(Disk(*SMALL), *smooth_problem(3))
    fit = fit_problem(problem, Weights())
    assert set(vars(problem)) == {field.name for field in fields(Problem)} | {"samples", "mobius"}
    sent = pickle.loads(pickle.dumps(problem))
    assert np.array_equal(fit_problem(sent, Weights()).f, fit.f)


def test_starting_from_mu_ends_at_the_same_map():
    p, q = smooth_problem(6)
    first = fit_landmarks(*SMALL, p, q)
    again = fit_landmarks(*SMALL, p, q, start=first.mu)
    assert sum(again.steps) <= sum(first.steps)
    np.testing.assert_allclose(again.f, first.f, atol=5e-3)


def test_a_start_must_be_a_coefficient_on_the_faces():
    for start in (np.zeros(3), np.full(len(SMALL[1]), 1.5), np.full(len(SMALL[1]), np.nan)):
        with pytest.raises(BeltramiError):
            fit_landmarks(*SMALL, *smooth_problem(3, 30), start=start)


def test_a_fit_ends_on_the_mesh_once_the_error_is_small_enough():
    p, q = smooth_problem(6)
    settled = fit_landmarks(*SMALL, p, q, gamma=1e5)
    early = fit_landmarks(*SMALL, p, q, gamma=1e5, enough=5e-4)
    assert settled.landmark_error < early.landmark_error < 5e-4
    assert early.steps[1] < settled.steps[1] and early.bijective
    assert fit_landmarks(*SMALL, p, q, gamma=1e5, enough=1.0).steps[1] == 0


GOOD = np.array([0.1, 0.2j, -0.3])
OUTSIDE = "not in the closed unit disk"
BAD = [
    ({"target": [0.1]}, "give one target a landmark"), ({"moving": [], "target": []}, "give one target a landmark"),
    ({"moving": [[0.1, 0.2]], "target": [[0.1, 0.2]]}, "give one target a landmark"),
    ({"target": [0.1, np.nan, 0.2]}, rf"target landmarks \[1\] are {OUTSIDE}"),
    ({"moving": [0.1, 0.2, 1.2j]}, rf"moving landmarks \[2\] are {OUTSIDE} \(0\+1.2j\); map them"),
    ({"moving": [0.1, np.inf, 0.2]}, rf"moving landmarks \[1\] are {OUTSIDE}"),
    ({"moving": [0.1, 0.2, 0.1]}, "moving landmarks 0 and 2 coincide at 0.1.*drop one"),
    ({"target": [0.5, 0.2j, 0.2j]}, "target landmarks 1 and 2 coincide"),
    ({"sliding": True}, "need the curve each belongs to"), ({"curve": [0, 1]}, r"\(2,\) curve labels for 3 landmarks"),
    *[({"curve": labels}, "labels") for labels in (["a", "b", "c"], [[1], [1, 2], [3]])],
    *[({"rings": rings}, f"rings = {rings}: give an integer") for rings in (-5, 8.5)],
    *[({side: text}, side) for side in ("moving", "target") for text in ("0.1", ["a", "b", "c"])],
]  # fmt: skip


@pytest.mark.parametrize("wrong, message", BAD)
def test_what_cannot_be_fitted_is_refused(wrong, message):
    with pytest.raises(LandmarkError, match=message):
        fit_landmarks(*SMALL, **{"moving": GOOD, "target": GOOD} | wrong)


def test_conjugate_gradients_end_after_as_many_steps_as_unknowns():
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.standard_normal((40, 40)))[0]
    A = (Q * np.logspace(0, 6, 40)) @ Q.T
    x, rest, directions = conjugate_gradients(A.__matmul__, np.copy, A @ np.ones(40), 40, lambda *_: False)
    assert abs(x - 1).max() < 1e-6  # 0.8 where directions are conjugate to the last one alone
    np.testing.assert_allclose(rest, A @ (1 - x), atol=1e-8)
    assert len(directions) == 40
