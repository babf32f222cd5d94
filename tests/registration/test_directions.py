"""The start by crude spheres: places in space lay two surfaces on each other, wherever they were cut."""

import numpy as np
import pytest

import qclearn as qc
from qclearn.io.fsaverage import fsaverage5, whole_fsaverage5
from qclearn.registration import diagnose, start
from qclearn.registration.diagnose import astray, differing_walls, with_folds
from qclearn.registration.start import SurfacePair, crude_sphere
from qclearn.surfaces.conformal import parameterize
from qclearn.surfaces.opening import open_surface

LEFT = fsaverage5("left")
WHOLE = whole_fsaverage5("left", "pial")


@pytest.fixture(scope="module")
def wide():
    """The left side cut 8 mm beyond its medial wall."""
    rim = WHOLE.vertices[LEFT.original_vertices[LEFT.boundary]]
    near = np.linalg.norm(WHOLE.vertices[:, None] - rim, axis=2).min(1) < 8
    wall = ~np.isin(np.arange(len(WHOLE.vertices)), LEFT.original_vertices)
    opened, kept = open_surface(WHOLE, near | wall)
    return qc.Surface(opened.vertices, opened.faces, original_vertices=kept)


def test_a_crude_sphere_does_not_hang_on_the_cut(wide):
    both, here, there = np.intersect1d(LEFT.original_vertices, wide.original_vertices, return_indices=True)
    off = np.linalg.norm(crude_sphere(LEFT)[here] - crude_sphere(wide)[there], axis=1)
    assert len(both) > 8000 and off.mean() < 0.05 and np.allclose(np.linalg.norm(crude_sphere(wide), axis=1), 1)


def test_nor_on_the_unit_and_the_axes_and_a_flat_surface_and_a_rim_that_no_fan_can_close_have_one(monkeypatch):
    """Such as a slit that runs through its own middle: faces of the fan would have no area."""
    closed, moved = crude_sphere(LEFT), qc.Surface(1e-3 * LEFT.vertices + 7.0, LEFT.faces)
    np.testing.assert_allclose(crude_sphere(moved), closed, atol=1e-6)
    z, faces = qc.polar_disk(6, 24)
    assert np.isfinite(crude_sphere(qc.Surface(np.stack([z.real, z.imag, 0 * z.real], axis=1), faces))).all()
    monkeypatch.setattr(start, "degenerate_faces", lambda *mesh: np.arange(1))
    assert 0 < np.linalg.norm(crude_sphere(LEFT) - closed, axis=1).mean() < 0.2


def test_two_cuts_of_one_brain_find_each_other(wide):
    """The truth is known: both are the same mesh."""
    result = qc.register(wide, LEFT, [])
    off = np.linalg.norm(result.points - wide.vertices, axis=1)
    assert result.report["suspect"] == [] and result.report["bijective"]
    assert np.median(off) < 1.0 and off.mean() < 2.0


def test_a_patch_of_a_hemisphere_is_told_of_its_walls_before_its_hand():
    """The occipital fifth: folds of so different surfaces may fit a mirrored one better by chance."""
    y = WHOLE.vertices[:, 1]
    patch, _ = open_surface(WHOLE, y > np.quantile(y, 0.2))
    report = qc.register(patch, LEFT, []).report
    assert report["bijective"] and report["suspect"][0].startswith("walls: ")


def test_folds_alone_between_walls_cut_by_different_rules_are_suspect():
    """The same brain, where folds alone lose the way and everything else that is measured looks good."""
    report = qc.register(fsaverage5("left", wall="thickness"), LEFT, []).report
    assert [reason.split(":")[0] for reason in report["suspect"]] == ["walls", "features"]


def test_walls_cut_by_different_rules_are_told(wide):
    """Whose gap is larger, on the side that has it; not where folds alone make the area larger."""
    narrow = fsaverage5("left", wall="thickness")
    (message,) = differing_walls(narrow, LEFT)
    assert message.startswith("walls: the gap at the medial wall is 1.6 times as large on the control")
    (message,) = differing_walls(wide, narrow)
    assert "on the moving as on the control side" in message
    folded = qc.Surface(fsaverage5("left", "white").vertices, LEFT.faces)
    assert not list(differing_walls(LEFT, folded)) and not list(differing_walls(LEFT, qc.mirror(fsaverage5("right"))))
    unit = qc.Surface(narrow.vertices / 50, narrow.faces)  # of no hemisphere's length
    assert not list(differing_walls(unit, LEFT))


def test_a_map_that_lies_elsewhere_is_told_and_one_whose_folds_agree_is_right_wherever_the_axes_point(monkeypatch):
    turned = qc.Surface(LEFT.vertices[:, [1, 2, 0]], LEFT.faces)
    pair, elsewhere = (with_folds(SurfacePair(parameterize(one), parameterize(LEFT), [], [])) for one in (LEFT, turned))
    z = pair.moving.disk.z
    assert list(astray(pair, z)) == list(astray(elsewhere, elsewhere.moving.disk.z)) == []
    (reason,) = astray(pair, z * np.exp(0.7j))
    assert reason.startswith("features: the map takes the surface") and "landmark curve" in reason
    monkeypatch.setattr(diagnose, "SURE_R", 1.1)
    assert len(list(astray(elsewhere, elsewhere.moving.disk.z))) == 1
