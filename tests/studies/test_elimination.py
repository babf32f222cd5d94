"""Nested dissection: an order of elimination that saves work and changes nothing."""

import numpy as np
import pytest

from book.studies.elimination import elimination_order
from meshes import boundary_loop, random_disk, random_mu
from qclearn.plane import linear
from qclearn.plane.beltrami import stiffness
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import Dirichlet


@pytest.mark.parametrize("mesh", [random_disk(2, 200), polar_disk(40, 120)], ids=["random", "polar"])
def test_it_is_a_permutation_with_fewer_entries_in_the_factors_than_the_order_of_the_vertices(mesh, monkeypatch):
    monkeypatch.setattr(linear, "has_cholmod", lambda: False)
    z, faces = mesh
    matrix, loop = stiffness(z, faces, np.zeros(len(faces))), boundary_loop(faces)
    order = elimination_order(matrix, z, loop)
    inner = np.setdiff1d(np.arange(len(z)), loop)
    np.testing.assert_array_equal(np.sort(order), inner)
    shuffled = np.random.default_rng(0).permutation(inner)
    entries = [
        problem.factors.L.nnz
        for problem in (Dirichlet(matrix, loop, order), Dirichlet(matrix, loop), Dirichlet(matrix, loop, shuffled))
    ]
    assert entries[0] < 1.4 * entries[1] and entries[0] < 0.3 * entries[2]


def test_the_solution_is_that_of_any_other_order():
    z, faces = random_disk(3, 80)
    matrix, loop = (stiffness(z, faces, random_mu(np.random.default_rng(0), z, faces, 0.6)), boundary_loop(faces))
    usual, ordered = (Dirichlet(matrix, loop), Dirichlet(matrix, loop, elimination_order(matrix, z, loop)))
    np.testing.assert_allclose(ordered.solve(z[loop] ** 2), usual.solve(z[loop] ** 2), atol=1e-13)
    np.testing.assert_allclose(matrix @ ordered.solve(z[loop]), matrix @ usual.solve(z[loop]), atol=1e-12)
