"""CoefficientRefinement: its first step is the fit's, two end where it does, each is one exact map, none too long."""

from itertools import pairwise

import numpy as np
import pytest

from qclearn.nets import refinement
from qclearn.nets.refinement import CoefficientRefinement
from qclearn.plane.disk import Disk
from qclearn.plane.grids import Spectrum, polar_disk, square_disk
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.plane.solver import CoefficientMesh
from qclearn.registration.fit import exact_map, fit_problem
from qclearn.registration.gauss_newton import GaussNewtonObjective
from qclearn.registration.problem import Problem, Weights
from qclearn.registration.report import measured_losses


@pytest.fixture(scope="module")
def spectrum():
    return Spectrum(12, 36)


@pytest.fixture(scope="module")
def coefficient_mesh(spectrum):
    return CoefficientMesh(Disk(*polar_disk(16, 48, 1.4)), spectrum.mesh)


def twisted(turn):
    """Two curves of six points and where a twist takes them."""
    t = np.linspace(-1, 1, 6)
    p = np.concatenate([0.4 + 0.25j * t, -0.3 - 0.1j + 0.25 * t])
    return p, p * np.exp(1j * turn * (1 - abs(p) ** 2)) + 0.02


def test_fields_and_their_coefficients(spectrum):
    rng = np.random.default_rng(0)
    c = rng.normal(size=(36 * 12, 2)) @ [1, 1j]
    nu = spectrum.field(c)
    np.testing.assert_allclose(spectrum.coefficients(nu), c, atol=1e-12)
    assert abs(nu[0] - nu[1:37].mean()) < 1e-14
    assert abs((spectrum.areas * abs(nu[1:]) ** 2).sum() / np.pi - (abs(c) ** 2).sum()) < 1e-9
    g = rng.normal(size=(3, len(nu), 2)) @ [1, 1j]  # gradients: Re conj(g) nu = Re conj(E^* g) c
    np.testing.assert_allclose((g.conj() @ nu).real, (spectrum.gradients(g).conj() @ c).real, atol=1e-10)


def test_the_first_step_is_that_of_the_fit(spectrum):
    p, q = twisted(0.25)
    q = mobius(q, *best_mobius(q, p))
    coefficient_mesh = CoefficientMesh(spectrum.mesh, spectrum.mesh)
    problem = Problem(Disk(*polar_disk(12, 36, 1.4)), p, q)
    newton = GaussNewtonObjective(problem, coefficient_mesh, Weights(1.0, 0.1), on_nu_mesh=True)
    change, *_ = newton.linearise(newton.at(np.zeros(len(spectrum.mesh.z), complex), (0j, 0.0)), 1e3).propose()
    nu, wanted, left = CoefficientRefinement(coefficient_mesh, spectrum, (p, q), 0.1, 1e3).born()
    assert abs(nu - change)[1:].max() < 0.1 * abs(change).max()
    assert np.linalg.norm(left) < 0.8 * np.linalg.norm(wanted)
    assert abs(wanted - (q - p)).max() < 0.01


@pytest.mark.parametrize("turn, beta, gamma", [(0.25, 0.1, 1e3), (0.5, 1e-2, 1e4)])
def test_two_iterations_end_where_the_fit_does(coefficient_mesh, spectrum, monkeypatch, turn, beta, gamma):
    p, q = twisted(turn)
    problem, weights = Problem(coefficient_mesh.disk, p, q), Weights(1.0, beta, gamma)
    fit, solve, solved = fit_problem(problem, weights), coefficient_mesh.solver.solve, []
    monkeypatch.setattr(coefficient_mesh.solver, "solve", lambda mu: solved.append(mu) or solve(mu))
    stages = list(CoefficientRefinement(coefficient_mesh, spectrum, (p, q), beta, gamma).run(None, 2))
    assert len(solved) == 2  # one exact map per iteration, and no fit
    found = [fit, *(exact_map(problem, coefficient_mesh.coefficient(proposal.nu)) for proposal, _ in stages)]
    best, first, _, last = (measured_losses(problem, weights, x.mu, problem.samples @ x.f)["L_CP"] for x in found)
    assert last < 1.03 * best and first > 1.02 * last


def test_no_step_is_longer_than_allowed_and_none_is_kept_that_raises_the_objective(coefficient_mesh, spectrum):
    """Curves that are to change their places: no bijection is near, and the whole step would be of size 100."""
    p, _ = twisted(0.0)
    stages = list(CoefficientRefinement(coefficient_mesh, spectrum, (p, np.roll(p, 6)), 1e-3, 1e5).run(None, 4))
    best = [iterate.objective for _, iterate in stages]
    assert all(after < refinement.RISE * before for before, after in pairwise(best))
    assert all(np.isfinite(proposal.nu).all() for proposal, _ in stages)
    assert stages[0][0].cut and abs(stages[0][0].nu).max() <= refinement.MOST


def test_what_raises_the_objective_is_taken_back(coefficient_mesh, spectrum):
    p, q = twisted(0.25)
    found = CoefficientRefinement(coefficient_mesh, spectrum, (p, q), 0.1, 1e3)
    bad = 1.2 * np.exp(3j * spectrum.mesh.z.real)
    (start, before), (taken, after) = found.run(bad, 1)
    assert after is before and taken.cut  # nu = 0 was better
    np.testing.assert_allclose(taken.x, refinement.BACK * start.x)


@pytest.mark.parametrize("count", [1, 2])
def test_few_landmarks_need_no_map(coefficient_mesh, spectrum, count):
    p, q = (points[:count] for points in twisted(0.3))
    q = mobius(p, 0.1 + 0.2j, 0.4)
    for proposal, _ in CoefficientRefinement(coefficient_mesh, spectrum, (p, q), 1e-2, 1e5).run(None, 1):
        assert abs(proposal.nu).max() < 1e-3


def test_the_answer_hardly_depends_on_the_mesh(spectrum):
    p, q = twisted(0.25)
    meshes = (CoefficientMesh(Disk(*mesh), spectrum.mesh) for mesh in (polar_disk(16, 48, 1.4), square_disk(32)))
    runs = (CoefficientRefinement(mesh, spectrum, (p, q), 0.1, 1e3).run(None, 1) for mesh in meshes)
    one, other = (proposal.nu for (_, (proposal, _)) in runs)
    assert abs(one - other).max() < 0.1 * abs(one).max()
