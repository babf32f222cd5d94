"""Nested dissection: an order of elimination that saves work and changes nothing."""

import numpy as np

from book.studies.elimination import elimination_order
from meshes import boundary_loop, random_mu
from qclearn.plane import linear
from qclearn.plane.beltrami import stiffness
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import Dirichlet


def test_it_is_a_permutation_that_fills_less_and_solves_the_same(monkeypatch):
    monkeypatch.setattr(linear, "HAS_CHOLMOD", False)
    z, faces = polar_disk(24, 72)
    loop = boundary_loop(faces)
    matrix = stiffness(z, faces, random_mu(np.random.default_rng(0), z, faces, 0.6))
    order, inner = elimination_order(matrix, z, loop), np.setdiff1d(np.arange(len(z)), loop)
    np.testing.assert_array_equal(np.sort(order), inner)
    shuffled = np.random.default_rng(0).permutation(inner)
    ordered, usual, other = (Dirichlet(matrix, loop, *given) for given in ([order], [], [shuffled]))
    ordered_fill, usual_fill, other_fill = (one.factors.L.nnz for one in (ordered, usual, other))
    assert ordered_fill < 1.4 * usual_fill and ordered_fill < 0.4 * other_fill
    np.testing.assert_allclose(ordered.solve(z[loop] ** 2), usual.solve(z[loop] ** 2), atol=1e-12)
