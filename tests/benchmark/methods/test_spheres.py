"""Maps of spheres: surfaces closed and turned, the best rotation, and how such maps are judged."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from catsurf import put_in_place_of_cat_surf
from known_surfaces import icosphere
from qclearn.benchmark import Run
from qclearn.benchmark.methods import METHODS
from qclearn.benchmark.methods.spheres import Sphere, SphereError, closed, facing, inflated, inward
from qclearn.benchmark.pairs import Pair, mapped
from qclearn.benchmark.trial import trial
from qclearn.registration.curves import curves_of_both, fundus_path
from qclearn.surfaces.opening import open_surface
from qclearn.surfaces.surface import Surface

pytestmark = pytest.mark.usefixtures("once")
TURN = Rotation.from_euler("xyz", [9, -6, 11], degrees=True)


LINES = np.array([[[1, 0, 0.2], [0.4, 1, 0]], [[-1, 0.2, 0], [-0.3, 0.2, -1]], [[0, -1, -0.4], [0.6, -0.6, 0]]])


@pytest.fixture(scope="module")
def parts():
    """A folded ball of 60 mm, its opened part (vertices first) with three curves, and its sphere's points."""
    ball = icosphere(4)
    p = ball.vertices
    folds = 0.1 * np.sin(12 * p[:, 0] + 2) * np.cos(10 * p[:, 1]) + 0.05 * np.sin(14 * p[:, 2] + 4 * p[:, 0])
    kept = open_surface(ball, p[:, 2] < -0.8)[1]
    order = np.append(kept, np.setdiff1d(np.arange(len(p)), kept))
    whole = Surface((60 * p * (1 + folds)[:, None])[order], np.argsort(order)[ball.faces])
    part = whole.faces[(whole.faces < len(kept)).all(1)]
    opened = Surface(whole.vertices[: len(kept)], part)
    ends = [[np.argmin(p[kept] @ end) for end in line] for line in LINES]
    curves = {f"curve {k}": fundus_path(opened, *pair) for k, pair in enumerate(ends)}
    return Surface(opened.vertices, part, curves), whole, p[order]


@pytest.fixture(scope="module")
def pair(parts):
    """A ball turned in space onto itself: vertices of the same number correspond; one curve is held out."""
    opened, whole, points = parts
    turned, turned_whole = (Surface(TURN.apply(one.vertices.copy()), one.faces, one.curves) for one in (opened, whole))
    moving, control = mapped(turned, (turned_whole, points)), mapped(opened, (whole, points))
    curves = tuple(curves_of_both(turned, opened))
    truth = opened.vertices, control.disk.z
    return Pair(moving, control, curves[:2], *truth, held=curves[2:], there_and_back=True)


def test_a_closed_surface_has_a_patch_over_its_hole(parts):
    opened, whole, _ = parts
    found = closed(opened)
    assert found.euler_characteristic == 2 and not found.boundary_loops
    np.testing.assert_array_equal(found.vertices[: len(opened.vertices)], opened.vertices)
    np.testing.assert_array_equal(found.faces[: len(opened.faces)], opened.faces)
    rim, patch = opened.vertices[opened.boundary], found.vertices[len(opened.vertices) :]
    assert (patch.min(0) > rim.min(0)).all() and (patch.max(0) < rim.max(0)).all()  # harmonic: within its values
    assert 0.8 * whole.volume < found.volume < whole.volume  # outward, and without the cap


def test_a_sphere_points_as_its_brain_does(parts):
    _, whole, points = parts
    np.testing.assert_allclose(facing(whole, 100 * TURN.apply(points)), facing(whole, points), atol=1e-9)
    assert np.linalg.norm(facing(whole, points) - points, axis=1).max() < 0.05  # up to what the folds do to the mean


def test_what_is_no_sphere_is_named(parts):
    _, whole, points = parts
    folded, long = points.copy(), points.copy()
    folded[7], long[3] = -points[7], 3 * points[3]
    faults = [
        (folded, r"is folded: \d+ of its faces look inward"),
        (long, "none around 0: its vertices lie 1 to 3 from it"),
        (points * np.nan, "none around 0"),
        (points[1:], "has 2,561 vertices, where its surface has 2,562"),
        (-points, "looks inward"),
    ]
    for given, message in faults:
        with pytest.raises(SphereError, match=message):
            _ = Sphere(whole, (whole, given)).points


def test_a_bad_sphere_is_a_row_and_a_method_of_the_disk_goes_on(pair):
    def of(name, pair):
        row = trial(replace(pair, there_and_back=False), Run("a", name), METHODS[name])
        return row.get("message", row.get("reversed_on_sphere"))

    sphere = pair.moving.sphere
    folded = replace(pair.moving, sphere=Sphere(pair.moving.surface, (sphere.whole, -sphere.points)))
    assert "looks inward" in of("rotation", replace(pair, moving=folded))
    without = replace(pair, control=replace(pair.control, sphere=None))
    assert "come without: give each `ParameterizedSurface` a `sphere`" in of("rotation", without)
    assert of("mobius_only", without) is None
    row = trial(pair, Run("bad", "bad"), lambda problem: sphere.points[:9])
    assert "returned an array of shape (9, 3)" in row["message"] and "one point of the sphere" in row["message"]


def test_the_best_rotation_turns_the_ball_back(pair):
    row = trial(pair, Run("rotation", "rotation"), METHODS["rotation"])
    as_is = trial(pair, Run("as it is", "as_is"), lambda problem: problem.pair.moving.sphere.points)
    assert row["status"] == as_is["status"] == "done", (row, as_is)
    edge = pair.control.surface.edge_lengths.mean()  # half of it: judges look at the nearest vertex
    assert row["correspondence_mm"] < edge / 2 < 3 < 8 < as_is["correspondence_mm"]
    assert row["held_out_mm"] < edge / 2 < 3 < as_is["held_out_mm"] and row["held_out_middle_mm"] < row["held_out_mm"]
    assert row["r_curvature"] > 0.9 > 0.7 > as_is["r_curvature"]
    assert row["certified"] and row["reversed_on_sphere"] == row["flipped"] == 0
    assert row["there_and_back_mm"] < edge / 2 and as_is["there_and_back_mm"] < 0.1
    assert row["mean_abs_mu"] is None and np.isnan(row["landmark_error"]) and 0 < row["landmark_error_mm"] < edge / 2


def test_the_same_map_has_the_same_figures_in_the_disk_and_on_the_sphere(pair):
    there = replace(pair, there_and_back=False)
    disk = trial(there, Run("disk", "disk"), lambda problem: pair.control.disk.z)
    ball = trial(there, Run("ball", "ball"), lambda problem: pair.control.sphere.points)
    for name in ("correspondence_mm", "held_out_mm", "held_out_middle_mm", "landmark_error_mm", "areal_95", "shape_95"):
        assert ball[name] == pytest.approx(disk[name], abs=0.02), name
    for name in ("r_depth", "r_curvature"):
        assert ball[name] == pytest.approx(disk[name], abs=0.01) and ball[name] > 0.8, name
    assert disk["reversed_on_sphere"] == 0


def test_faces_that_are_turned_over_are_counted_on_the_sphere(pair):
    def torn(problem):
        points = pair.control.sphere.points.copy()
        points[:40] = points[40:80]
        return points

    row = trial(replace(pair, there_and_back=False), Run("torn", "torn"), torn)
    turned = inward(torn(None)[pair.moving.surface.faces])
    assert row["reversed_on_sphere"] == turned > 20 and row["flipped"] >= turned and not row["certified"]


def test_a_sphere_comes_from_the_program_beside_us_or_the_row_says_why_not(pair, tmp_path, monkeypatch):
    put_in_place_of_cat_surf(tmp_path, monkeypatch)
    own = replace(pair.moving, sphere=Sphere(pair.moving.surface))
    row = trial(replace(pair, moving=own, there_and_back=False), Run("rotation", "rotation"), METHODS["rotation"])
    assert row["status"] == "done" and row["reversed_on_sphere"] == 0, row
    assert row["correspondence_mm"] < 5  # the stand-in makes another sphere than the ball's own
    coarse = icosphere(2)
    with pytest.raises(SphereError, match="cat_surf ended with 1, without a sphere: AssertionError: no licence"):
        inflated(Surface(coarse.vertices, coarse.faces))
    assert "cat_surf" not in sys.modules
