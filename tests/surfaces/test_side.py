"""`ParameterizedSurface`: a surface laid out on its disk, moved by Möbius maps, and what lies on it."""

import numpy as np
import pytest

from known_surfaces import sheet
from meshes import bowl
from qclearn.plane.disk import Disk
from qclearn.plane.mobius import mobius
from qclearn.surfaces.conformal import apply_mobius, disk_conformal_map, parameterize, repair_folds
from qclearn.surfaces.surface import Surface

MOVE = (0.3 - 0.2j, 0.7)


@pytest.fixture(scope="module")
def side():
    return parameterize(bowl(0.6, lean=0.3))


@pytest.mark.digits
def test_a_surface_is_laid_out_in_its_conformal_map(side):
    np.testing.assert_array_equal(side.disk.z, disk_conformal_map(side.surface))


def test_a_surface_laid_out_says_what_was_repaired(side, recwarn):
    assert side.disk.certificate.bijective and side.messages == ()
    np.testing.assert_array_equal(side.disk.loop, side.surface.boundary)
    surface, x, y = sheet(12)
    vertices = surface.vertices.copy()
    vertices[np.hypot(x - 0.5, y - 0.5) < 0.2, 1] *= 1e-4  # slivers
    found = parameterize(Surface(vertices, surface.faces))
    assert len(found.messages) == 1 and "rows switched" in found.messages[0] and found.disk.certificate.bijective
    assert not [one for one in recwarn if "rows switched" in str(one.message)]


def test_moving_gives_another_side_and_leaves_the_first(side):
    before = side.disk.z.copy()
    there = apply_mobius(side, MOVE)
    assert there is not side and there.surface is side.surface and there.disk.certificate.bijective
    np.testing.assert_array_equal(side.disk.z, before)
    np.testing.assert_allclose(there.disk.z, mobius(before, *MOVE), atol=1e-15)
    np.testing.assert_allclose(abs(there.disk.z[there.disk.loop]), 1, rtol=1e-15)


def test_folds_that_a_move_leaves_are_mended(side):
    folded = side.disk.z.copy()
    folded[side.disk.faces[0, 0]] = 0.9
    assert len(Disk(folded, side.surface.faces).maybe_flipped)
    assert repair_folds(side.surface, folded).certificate.bijective


def test_points_are_lifted_to_the_surface(side):
    some = np.setdiff1d(np.arange(len(side.disk.z)), side.disk.loop)[::7]
    np.testing.assert_allclose(side.lift(side.disk.z[some]), side.surface.vertices[some], atol=1e-12)
    middle = side.surface.vertices[side.surface.faces[40]].mean(0)
    np.testing.assert_allclose(side.lift(side.disk.centroids[[40]]), [middle], atol=1e-12)
