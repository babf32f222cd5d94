"""Sparse systems: assembled, factored and solved, and an order of elimination that saves work and
changes nothing."""

import numpy as np
import pytest
from known_surfaces import grooved_sphere
from meshes import random_disk, random_mu

from qclearn.plane import disk, linear
from qclearn.plane.beltrami import BeltramiDiskSolver, stiffness
from qclearn.plane.disk import boundary_loop
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import Dirichlet, assemble, elimination_order
from qclearn.surfaces import surface as surfaces
from qclearn.surfaces.conformal import disk_conformal_map


def test_assemble_sums_element_matrices():
    blocks = np.arange(18.0).reshape(2, 3, 3)
    matrix = assemble(np.array([[0, 1, 2], [2, 1, 3]]), blocks, 4).toarray()
    assert matrix[0].tolist() == [0, 1, 2, 0]
    assert (
        matrix[1, 2] == blocks[0, 1, 2] + blocks[1, 1, 0]
        and matrix[2, 1] == blocks[0, 2, 1] + blocks[1, 0, 1]
    )


def test_factored_problem_takes_real_complex_and_many_loads():
    z, faces = random_disk(seed=1)
    matrix = stiffness(z, faces, random_mu(np.random.default_rng(4), z, faces, 0.5))
    problem = Dirichlet(matrix, boundary_loop(faces))
    inner = matrix.toarray()[np.ix_(problem.free, problem.free)]
    rng = np.random.default_rng(0)
    load = rng.normal(size=(len(problem.free), 3)) + 1j * rng.normal(size=(len(problem.free), 3))
    load[:, 1] = 0
    np.testing.assert_allclose(problem.solve_free(load), np.linalg.solve(inner, load), atol=1e-10)
    np.testing.assert_allclose(
        problem.solve_free(load[:, 0]), np.linalg.solve(inner, load[:, 0]), atol=1e-10
    )
    np.testing.assert_allclose(
        problem.solve_free(load.real), np.linalg.solve(inner, load.real), atol=1e-10
    )


# The order of elimination.


@pytest.mark.parametrize(
    "mesh", [random_disk(2, 200), polar_disk(40, 120)], ids=["random", "polar"]
)
def test_it_is_a_permutation_with_fewer_entries_in_the_factors_than_the_order_of_the_vertices(mesh):
    z, faces = mesh
    matrix, loop = stiffness(z, faces, np.zeros(len(faces))), boundary_loop(faces)
    order = elimination_order(matrix, z, loop)
    inner = np.setdiff1d(np.arange(len(z)), loop)
    np.testing.assert_array_equal(np.sort(order), inner)
    shuffled = np.random.default_rng(0).permutation(inner)
    entries = [
        problem.factors.L.nnz
        for problem in (
            Dirichlet(matrix, loop, order),
            Dirichlet(matrix, loop),
            Dirichlet(matrix, loop, shuffled),
        )
    ]
    assert entries[0] < 1.4 * entries[1] and entries[0] < 0.3 * entries[2]


def test_the_solution_is_that_of_any_other_order():
    z, faces = random_disk(3, 80)
    matrix, loop = (
        stiffness(z, faces, random_mu(np.random.default_rng(0), z, faces, 0.6)),
        boundary_loop(faces),
    )
    usual, ordered = (
        Dirichlet(matrix, loop),
        Dirichlet(matrix, loop, elimination_order(matrix, z, loop)),
    )
    np.testing.assert_allclose(ordered.solve(z[loop] ** 2), usual.solve(z[loop] ** 2), atol=1e-13)
    np.testing.assert_allclose(
        matrix @ ordered.solve(z[loop]), matrix @ usual.solve(z[loop]), atol=1e-12
    )


def test_large_meshes_are_solved_and_differentiated_as_small_ones_are(monkeypatch):
    z, faces = random_disk(4, 60)
    rng = np.random.default_rng(1)
    mu, grad = random_mu(rng, z, faces, 0.5), rng.normal(size=len(z)) + 1j * rng.normal(size=len(z))
    surface, _ = grooved_sphere()
    small, flat = BeltramiDiskSolver(z, faces), disk_conformal_map(surface)
    usual = small.solve(mu), small.pullback(grad)
    for module in (disk, surfaces):
        monkeypatch.setattr(module, "LARGE", 0)
    large = BeltramiDiskSolver(z, faces)
    np.testing.assert_allclose(large.solve(mu), usual[0], atol=1e-12)
    np.testing.assert_allclose(large.pullback(grad), usual[1], atol=1e-10 * abs(usual[1]).max())
    assert sorted(large.order) == sorted(small.order) and list(large.order) != list(small.order)
    again = surfaces.Surface(surface.vertices, surface.faces)  # which has sought no order yet
    np.testing.assert_allclose(disk_conformal_map(again), flat, atol=1e-9)
    assert (
        len(again.order) == len(surface.vertices) - len(surface.boundary) and surface.order is None
    )


@pytest.mark.parametrize("mesh", [random_disk(5, 300), polar_disk(20, 60)], ids=["random", "polar"])
def test_a_solver_seeks_the_order_once(mesh, monkeypatch):
    mu, sought = random_mu(np.random.default_rng(0), *mesh, 0.6), []
    factorise = linear.factorise
    monkeypatch.setattr(
        linear, "factorise", lambda *given: sought.append(given[1]) or factorise(*given)
    )
    exact = BeltramiDiskSolver(*mesh)
    first, again = exact.solve(mu), exact.solve(mu)
    assert sought[0] == "MMD_AT_PLUS_A" and set(sought[1:]) == {"NATURAL"}
    assert sought == ["MMD_AT_PLUS_A", "NATURAL", "NATURAL"]  # the first is the calibration's
    np.testing.assert_array_equal(again, first)  # whatever was solved before
