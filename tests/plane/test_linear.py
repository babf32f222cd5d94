"""Sparse systems: assembled, factored and solved."""

import numpy as np
import pytest
from scipy import sparse

from meshes import boundary_loop, random_disk, random_mu
from qclearn.plane import linear
from qclearn.plane.beltrami import BeltramiDiskSolver, stiffness
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import Dirichlet


def test_factored_problem_takes_real_complex_and_many_loads():
    z, faces = random_disk(seed=1)
    matrix = stiffness(z, faces, random_mu(np.random.default_rng(4), z, faces, 0.5))
    problem = Dirichlet(matrix, boundary_loop(faces))
    inner = matrix.toarray()[np.ix_(problem.free, problem.free)]
    rng = np.random.default_rng(0)
    load = rng.normal(size=(len(problem.free), 3)) + 1j * rng.normal(size=(len(problem.free), 3))
    load[:, 1] = 0
    for one in (load, load[:, 0], load.real):
        np.testing.assert_allclose(problem.solve_free(one), np.linalg.solve(inner, one), atol=1e-10)


@pytest.mark.parametrize("mesh", [random_disk(5, 300), polar_disk(20, 60)], ids=["random", "polar"])
def test_a_solver_finds_the_same_map_in_whichever_order(mesh, monkeypatch):
    """By CHOLMOD; and by SuperLU, whose second system has the order of the first."""
    mu = random_mu(np.random.default_rng(0), *mesh, 0.6)
    maps = [BeltramiDiskSolver(*mesh).solve(mu)]
    monkeypatch.setattr(linear, "HAS_CHOLMOD", False)
    exact = BeltramiDiskSolver(*mesh)
    np.testing.assert_allclose([exact.solve(mu), exact.solve(mu)], 2 * maps, atol=1e-11)


def four_problems():
    """A random mesh, one with a strong coefficient, a graded polar mesh, and heat flow on one."""
    rng = np.random.default_rng(2)
    for z, faces in (random_disk(seed=1), random_disk(seed=2), polar_disk(20, 60)):
        yield stiffness(z, faces, random_mu(rng, z, faces, 0.7)), boundary_loop(faces)
    z, faces = polar_disk(12, 36)
    matrix = stiffness(z, faces, np.zeros(len(faces), complex))
    yield matrix + sparse.eye_array(len(z)), np.zeros(0, int)


@pytest.mark.parametrize("number", range(4))
def test_cholmod_and_superlu_agree(number, monkeypatch):
    pytest.importorskip("cvxopt")
    matrix, pinned = list(four_problems())[number]
    by_cholmod = Dirichlet(matrix, pinned)
    monkeypatch.setattr(linear, "HAS_CHOLMOD", False)
    by_superlu = Dirichlet(matrix, pinned)
    assert isinstance(by_cholmod.factors, linear.Cholesky) and not isinstance(by_superlu.factors, linear.Cholesky)
    load = np.random.default_rng(0).normal(size=(len(by_cholmod.free), 3)) * (1 + 1j)
    answers = [problem.solve_free(load) for problem in (by_cholmod, by_superlu)]
    np.testing.assert_allclose(*answers, atol=1e-9 * abs(answers[1]).max())


def test_factors_of_one_pattern_are_solved_in_turn():
    pytest.importorskip("cvxopt")
    z, faces = random_disk(seed=3)
    rng = np.random.default_rng(3)
    inner = np.setdiff1d(np.arange(len(z)), boundary_loop(faces))
    matrices = [stiffness(z, faces, random_mu(rng, z, faces, 0.7))[inner][:, inner] for _ in range(2)]
    one = linear.factorise(matrices[0])
    two = linear.factorise(matrices[1], pattern=one.pattern)
    load = rng.normal(size=len(inner))
    for matrix, factors in (*zip(matrices, (one, two)), (matrices[0], one)):
        np.testing.assert_allclose(matrix @ factors.solve(load), load, atol=1e-11)
    indefinite = linear.factorise(matrices[0] - 100 * sparse.eye_array(len(inner)), pattern=one.pattern)
    assert not isinstance(indefinite, linear.Cholesky)
    np.testing.assert_allclose(matrices[1] @ two.solve(load), load, atol=1e-11)


def test_a_matrix_that_cholmod_cannot_factor_goes_to_superlu():
    indefinite = sparse.diags_array([1.0, -1.0, 2.0])
    np.testing.assert_allclose(linear.factorise(indefinite).solve(np.ones(3)), [1, -1, 0.5])
    one_sided = sparse.csc_array(np.array([[1.0, 0.2], [0.0, 1.0]]))
    assert not isinstance(linear.factorise(one_sided), linear.Cholesky)
    with pytest.raises(linear.BeltramiError, match="cannot be solved"):
        linear.factorise(sparse.csc_array((2, 2)))
