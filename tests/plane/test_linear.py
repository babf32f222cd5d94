"""Sparse systems: assembled, factored and solved."""

import numpy as np
import pytest

from meshes import boundary_loop, random_disk, random_mu
from qclearn.plane import linear
from qclearn.plane.beltrami import BeltramiDiskSolver, stiffness
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import Dirichlet, assemble


def test_assemble_sums_element_matrices():
    blocks = np.arange(18.0).reshape(2, 3, 3)
    matrix = assemble(np.array([[0, 1, 2], [2, 1, 3]]), blocks, 4).toarray()
    assert matrix[0].tolist() == [0, 1, 2, 0]
    assert matrix[1, 2] == blocks[0, 1, 2] + blocks[1, 1, 0] and matrix[2, 1] == blocks[0, 2, 1] + blocks[1, 0, 1]


def test_factored_problem_takes_real_complex_and_many_loads():
    z, faces = random_disk(seed=1)
    matrix = stiffness(z, faces, random_mu(np.random.default_rng(4), z, faces, 0.5))
    problem = Dirichlet(matrix, boundary_loop(faces))
    inner = matrix.toarray()[np.ix_(problem.free, problem.free)]
    rng = np.random.default_rng(0)
    load = rng.normal(size=(len(problem.free), 3)) + 1j * rng.normal(size=(len(problem.free), 3))
    load[:, 1] = 0
    np.testing.assert_allclose(problem.solve_free(load), np.linalg.solve(inner, load), atol=1e-10)
    np.testing.assert_allclose(problem.solve_free(load[:, 0]), np.linalg.solve(inner, load[:, 0]), atol=1e-10)
    np.testing.assert_allclose(problem.solve_free(load.real), np.linalg.solve(inner, load.real), atol=1e-10)


@pytest.mark.parametrize("mesh", [random_disk(5, 300), polar_disk(20, 60)], ids=["random", "polar"])
def test_a_solver_seeks_the_order_once(mesh, monkeypatch):
    mu, sought = random_mu(np.random.default_rng(0), *mesh, 0.6), []
    factorise = linear.factorise
    monkeypatch.setattr(linear, "factorise", lambda *given: sought.append(given[1]) or factorise(*given))
    exact = BeltramiDiskSolver(*mesh)
    first, again = exact.solve(mu), exact.solve(mu)
    assert sought[0] == "MMD_AT_PLUS_A" and set(sought[1:]) == {"NATURAL"}
    assert sought == ["MMD_AT_PLUS_A", "NATURAL", "NATURAL"]  # the first is the calibration's
    np.testing.assert_array_equal(again, first)  # whatever was solved before
