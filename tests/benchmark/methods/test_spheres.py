"""Maps of spheres: surfaces closed and turned, the best rotation, and how such maps are judged."""

import sys
import textwrap
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from known_surfaces import icosphere
from qclearn.benchmark import Run
from qclearn.benchmark.methods import METHODS
from qclearn.benchmark.methods.spheres import Sphere, SphereError, closed, facing, inflated, inward
from qclearn.benchmark.pairs import Pair, mapped
from qclearn.benchmark.reference_metrics import middle_distance, quantile, tails
from qclearn.benchmark.trial import trial
from qclearn.io.meshes import write_surface
from qclearn.io.values import read_map
from qclearn.registration.curves import fundus_path
from qclearn.surfaces.opening import open_surface
from qclearn.surfaces.surface import Surface
from workbench import workbench

pytestmark = pytest.mark.usefixtures("once")
TURN = Rotation.from_euler("xyz", [9, -6, 11], degrees=True)


def bumpy(level=4):
    """A whole ball of 60 mm with folds, its opened part and its sphere's points; the opened part's
    vertices first."""
    ball = icosphere(level)
    p = ball.vertices
    folds = 0.1 * np.sin(12 * p[:, 0] + 2) * np.cos(10 * p[:, 1]) + 0.05 * np.sin(14 * p[:, 2] + 4 * p[:, 0])
    kept = open_surface(ball, p[:, 2] < -0.8)[1]
    order = np.append(kept, np.setdiff1d(np.arange(len(p)), kept))
    whole = Surface((60 * p * (1 + folds)[:, None])[order], np.argsort(order)[ball.faces])
    part = whole.faces[(whole.faces < len(kept)).all(1)]
    ends = {f"curve {k}": (np.argmin(p[kept] @ a), np.argmin(p[kept] @ b)) for k, (a, b) in enumerate(LINES)}
    opened = Surface(whole.vertices[: len(kept)], part)
    return (
        Surface(opened.vertices, part, {name: fundus_path(opened, *pair) for name, pair in ends.items()}),
        whole,
        p[order],
    )


LINES = np.array([[[1, 0, 0.2], [0.4, 1, 0]], [[-1, 0.2, 0], [-0.3, 0.2, -1]], [[0, -1, -0.4], [0.6, -0.6, 0]]])


def side_of(parts, turn=None):
    """The `Mapped` of these parts, in space turned by `turn`: its sphere follows, as each points as
    its brain does."""
    surface, whole, points = parts
    if turn is not None:
        surface = Surface(turn.apply(surface.vertices.copy()), surface.faces, surface.curves)
        whole = Surface(turn.apply(whole.vertices.copy()), whole.faces)
    return mapped(surface, (whole, points))


@pytest.fixture(scope="module")
def parts():
    return bumpy()


@pytest.fixture(scope="module")
def pair(parts):
    """A ball turned in space onto itself: vertices of the same number correspond; one curve is held
    out."""
    moving, control = side_of(parts, TURN), side_of(parts)
    names = list(control.surface.curves)
    curves = [{"name": name, **dict.fromkeys(("moving", "control"), control.surface.curves[name])} for name in names]
    truth = control.surface.vertices, control.disk.z
    return Pair(moving, control, tuple(curves[:2]), *truth, held=(curves[2],), there_and_back=True)


# Spheres


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
    folded = replace(
        pair.moving, sphere=Sphere(pair.moving.surface, (pair.moving.sphere.whole, -pair.moving.sphere.points))
    )
    row = trial(replace(pair, moving=folded), Run("a", "rotation"), METHODS["rotation"])
    assert row["status"] == "failed" and "looks inward" in row["message"]
    without = replace(pair, control=replace(pair.control, sphere=None), there_and_back=False)
    row = trial(without, Run("a", "rotation"), METHODS["rotation"])
    assert row["status"] == "failed" and "come without: give each `ParameterizedSurface` a `sphere`" in row["message"]
    row = trial(without, Run("a", "mobius_only"), METHODS["mobius_only"])
    assert row["status"] == "done" and row["reversed_on_sphere"] is None


# Maps of spheres, judged as the others


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


def test_a_map_of_another_sphere_is_refused(pair):
    row = trial(pair, Run("bad", "bad"), lambda problem: problem.pair.moving.sphere.points[:9])
    assert "returned an array of shape (9, 3)" in row["message"] and "one point of the sphere" in row["message"]


def test_the_middle_of_a_curve_leaves_its_ends_out():
    line = np.stack([np.linspace(0, 10, 101), *np.zeros((2, 101))], 1)
    bent = line + np.where(abs(line[:, :1] - 5) > 4, [0.0, 2.0, 0.0], [0.0, 0.5, 0.0])
    assert middle_distance(line, bent) == pytest.approx(0.5)
    assert middle_distance(line, line[::-1]) == 0


def test_distortion_is_workbenchs(tmp_path, pair):
    moving, p = pair.moving.surface, pair.control.surface.vertices
    there = Surface(p * [1.3, 0.8, 1] + 5 * np.sin(p / 20), moving.faces)
    points = there.vertices
    write_surface(tmp_path / "a.surf.gii", moving)
    write_surface(tmp_path / "b.surf.gii", Surface(points * np.sqrt(moving.area / there.area), moving.faces))
    paths = [tmp_path / name for name in ("a.surf.gii", "b.surf.gii", "d.func.gii")]
    workbench("-surface-distortion", *paths, "-local-affine-method", "-log2")
    theirs = abs(np.asarray(read_map(paths[2]).values)).T
    shares, ours = moving.vertex_areas / moving.area, tails(moving, points)
    assert [quantile(one, shares) for one in theirs] == pytest.approx([ours["areal_95"], ours["shape_95"]], abs=0.01)
    assert ours["areal_95"] > 0.3 and ours["shape_95"] > 0.3


# Spheres that cat-surf makes

STAND_IN = """
    import nibabel, numpy as np
    def read_surface(path):
        return tuple(array.data for array in nibabel.load(path).darrays)
    def write_surface(path, points, faces):
        kinds = zip((points.astype("f4"), faces.astype("i4")), ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"))
        arrays = [nibabel.gifti.GiftiDataArray(data, intent) for data, intent in kinds]
        nibabel.save(nibabel.gifti.GiftiImage(darrays=arrays), path)
    def surf_to_sphere(points, faces, stop_at, relax):
        assert len(points) > 1000, "no licence"
        out = points - points.mean(0)
        return 100 * out / np.linalg.norm(out, axis=1, keepdims=True), faces
"""


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """A module in cat_surf's place, for this process to find and for the program to load."""
    (tmp_path / "cat_surf.py").write_text(textwrap.dedent(STAND_IN))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def test_a_sphere_comes_from_the_program_beside_us_or_the_row_says_why_not(pair, stand_in):
    own = replace(pair.moving, sphere=Sphere(pair.moving.surface))
    row = trial(replace(pair, moving=own, there_and_back=False), Run("rotation", "rotation"), METHODS["rotation"])
    assert row["status"] == "done" and row["reversed_on_sphere"] == 0, row
    assert row["correspondence_mm"] < 5  # the stand-in makes another sphere than the ball's own
    coarse = icosphere(2)
    with pytest.raises(SphereError, match="cat_surf ended with 1, without a sphere: AssertionError: no licence"):
        inflated(Surface(coarse.vertices, coarse.faces))
    assert "cat_surf" not in sys.modules
