"""The realism metrics against closed forms, and their parts against exact cases and oracles."""

import numpy as np
import pytest

from data_synth.folding_measures import (
    facing_distance,
    fold_spectrum,
    pits_and_fundi,
    principal_curvatures,
    smooth,
    spectral_centroid,
    spectral_peak,
)
from data_synth.intersections import self_intersections
from data_synth.realism import TARGETS, mesh_metrics, realism, score, weighted_percentiles
from known_surfaces import grid_faces, icosphere, revolution, sheet, torus
from qclearn.surfaces.surface import Surface, SurfaceError


def folded():
    """An open ellipsoid with waves across it: cheap, and with sulci enough to move every metric."""
    ball = icosphere(3, -0.93)
    wave = np.sin(9 * ball.vertices).sum(1)
    return Surface(ball.vertices * [1, 1.5, 1.1] * (1 + 0.2 * wave[:, None]), ball.faces)


def test_sphere_cap_in_closed_form():
    cap = icosphere(4, -0.8)
    metrics = realism(cap)
    assert list(metrics) == list(TARGETS) and len(TARGETS) == 29
    length = np.sqrt(cap.area)
    for name in ("curvature_5", "curvature_50", "curvature_95", "curvedness_50", "curvedness_95"):
        assert metrics[name] == pytest.approx(length, rel=0.03), name
    assert metrics["gyrification_index"] == pytest.approx(2 * 1.8 / (2 * 1.8 + 0.36), rel=0.02)  # zone over zone + lid
    names = "concave_area buried_area occluded_area pits fundus_length self_intersecting_faces dihedral_flips"
    for name in (*names.split(), "degenerate_faces", "nonmanifold_edges", "saddle_area", "saddle_ridge_area"):
        assert metrics[name] == 0, name
    assert (metrics["euler_characteristic"], metrics["boundary_loops"]) == (1, 1)
    assert metrics["mean_depth"] < 1e-3 and np.isnan(metrics["sulcal_width"])


def test_metrics_have_no_unit_and_no_direction_and_an_inward_surface_none():
    surface = folded()
    metrics = realism(surface)
    assert metrics["concave_area"] > 0.2 and metrics["buried_area"] > 0.1 and metrics["pits"] > 5
    assert metrics["curvature_depth_correlation"] < -0.3
    scaled = realism(Surface(64 * surface.vertices, surface.faces))
    for name in TARGETS:
        assert scaled[name] == pytest.approx(metrics[name], rel=1e-6), name
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = realism(Surface(surface.vertices @ turn + 9, surface.faces))
    for name in ("curvature_sd", "curvedness_95", "peak_wavelength", "saddle_area", "minimum_angle_5"):
        assert turned[name] == pytest.approx(metrics[name], rel=1e-6), name
    for name in ("mean_depth", "buried_area"):  # the voxels of the depth do not turn with the surface
        assert turned[name] == pytest.approx(metrics[name], rel=0.1), name
    with pytest.raises(SurfaceError, match="inward"):
        realism(Surface(surface.vertices, surface.faces[:, ::-1]))


def test_score_marks_what_is_outside():
    metrics = {name: (low + high) / 2 for name, (low, high) in TARGETS.items()}
    rows = score(metrics | {"pits": 67, "sulcal_width": np.nan, "curvature_5": -58.0})
    assert {row.name for row in rows if not row.inside} == {"pits", "sulcal_width"} and len(rows) == 29


def test_mesh_metrics_see_what_is_wrong():
    flat, *_ = sheet(21)
    assert mesh_metrics(flat)["minimum_angle_5"] == pytest.approx(45)
    tent, _x, _y = sheet(21, height=lambda x, y: 6 * abs(x - 0.5))  # one crease of 21 edges, bent by 161 degrees
    inner_edges = len(tent.edges) - 80
    assert mesh_metrics(tent)["dihedral_flips"] == pytest.approx(20 / inner_edges)
    roof, *_ = sheet(21, height=lambda x, y: 1.3 * abs(x - 0.5))  # bent by 105 degrees
    assert mesh_metrics(roof)["dihedral_flips"] == 0
    closed = mesh_metrics(icosphere(2))
    assert (closed["euler_characteristic"], closed["boundary_loops"]) == (2, 0)


def test_self_intersection_agrees_with_exact_arithmetic():
    cgal = pytest.importorskip("igl.copyleft.cgal")
    ball = icosphere(3)
    assert len(self_intersections(ball.vertices, ball.faces)) == 0
    for noise in (0.02, 0.08):
        vertices = ball.vertices + noise * np.random.default_rng(2).normal(size=ball.vertices.shape)
        exact = np.unique(cgal.remesh_self_intersections(vertices, ball.faces, detect_only=True)[2])
        np.testing.assert_array_equal(self_intersections(vertices, ball.faces), exact)
    assert len(exact) > 20


def test_one_edge_through_one_face():
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [1, 1, -1], [1, 1, 1], [9, 9, 1.0]])
    faces = np.array([[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(self_intersections(vertices, faces), [0, 1])
    beside = vertices.copy()
    beside[3:5] += [2, 2, 0]
    assert len(self_intersections(beside, faces)) == 0


def test_principal_curvatures_of_a_torus():
    surface, exact = torus(3)
    assert surface.volume > 0
    k1, k2 = principal_curvatures(surface)
    np.testing.assert_allclose(k1, 1, atol=0.045)
    np.testing.assert_allclose(k2, exact, atol=0.01)
    inward = Surface(surface.vertices, surface.faces[:, ::-1])
    np.testing.assert_allclose(principal_curvatures(inward)[1], -k1, atol=1e-6)


def test_bending_leaves_out_what_looks_the_other_way():
    curvatures = []
    for step in (0.5, 0.25):  # a crown of 45 degrees an edge over two undercut banks, coarse or fine
        bank = 1 + np.arange(1, 8) * step * (-0.1 - 1j)
        right = np.concatenate([np.exp(1j * np.linspace(np.pi / 2, 0, 3)), bank])
        profile = np.concatenate([-right[:0:-1].conj(), right])
        points = np.stack([np.tile(profile.real, 9), np.repeat(np.arange(9) / 2, 19), np.tile(profile.imag, 9)], 1)
        curvatures.append([k[4 * 19 + 9] for k in principal_curvatures(Surface(points, grid_faces(9, 19)))])
    assert curvatures[0] == pytest.approx(curvatures[1], rel=1e-9) and curvatures[0][0] > 1


def test_shape_index_of_a_fat_torus():
    surface, k = torus(2)
    index = 2 / np.pi * np.arctan2(1 + k, 1 - k)
    share = surface.vertex_areas / surface.area
    metrics = realism(surface)
    for name, low in (("saddle_area", -1 / 9), ("saddle_ridge_area", 1 / 9)):
        exact = share[(index > low) & (index < low + 2 / 9)].sum()
        assert exact > 0.05 and metrics[name] == pytest.approx(exact, abs=0.02), name


def test_sulcal_width_of_a_shaft():
    half, mouth = 0.08, 0.11  # wider where it is not yet buried
    rim = np.arcsin(mouth)
    angle = np.linspace(rim, 2.9, 60)
    wall = np.concatenate([half + 1j * np.linspace(0.4, 0.87, 40), mouth + 1j * np.linspace(0.88, np.cos(rim), 10)])
    floor = [0.4j, half / 2 + 0.4j]
    surface = revolution(np.concatenate([floor, wall, (np.sin(angle) + 1j * np.cos(angle))[1:]]), 48)
    metrics = realism(surface)
    assert metrics["sulcal_width"] == pytest.approx(2 * half / np.sqrt(surface.area), rel=0.02)
    wall_area = 2 * np.pi * (half * 0.47 + mouth * (np.cos(rim) - 0.88))  # the floor looks out of the shaft
    assert metrics["occluded_area"] == pytest.approx(wall_area / surface.area, rel=0.1)


def test_heat_damps_a_mode_by_its_eigenvalue():
    ball = icosphere(4)
    mode, length = ball.vertices[:, 2] + 1, 0.3
    exact = 1 + ball.vertices[:, 2] / (1 + 2 * length**2 / 3) ** 3  # eigenvalue 2, three implicit steps; mean kept
    np.testing.assert_allclose(smooth(ball, mode, length), exact, atol=2e-3)


def test_facing_distance():
    ball = icosphere(3)
    assert np.isinf(facing_distance(ball, 1e-3)).all()
    inward = Surface(ball.vertices, ball.faces[:, ::-1])
    np.testing.assert_allclose(facing_distance(inward, 1e-3), 2, rtol=0.01)


@pytest.mark.parametrize("waves", [6, 9])
def test_spectrum_finds_the_wavelength(waves):
    surface, x, _y = sheet(81, width=3.0)
    values = 5 + np.cos(2 * np.pi * waves * x / 3)  # no normal derivative at the rim
    wavelengths, power = fold_spectrum(surface, values)
    assert power.sum() == pytest.approx(1)
    assert spectral_peak(wavelengths, power) == pytest.approx(1 / waves, rel=0.03)


def test_centroid_of_a_spectrum():
    wavelengths = np.geomspace(0.01, 1, 5)
    assert spectral_centroid(wavelengths, np.array([1, 2, 3, 2, 1]) / 9) == pytest.approx(0.1)


def test_pits_and_fundus_of_a_trough():
    surface, x, y = sheet(81)
    trough = np.exp(-(((y - 0.5) / 0.05) ** 2))
    depth = trough * (0.8 - 0.2 * np.cos(4 * np.pi * x)) * (x > 0.1) * (x < 0.9)  # deepest at x = 1/4 and 3/4
    assert pits_and_fundi(surface, depth, deep=0.3, persistence=0.1) == (2, pytest.approx(0.5, rel=0.05))
    assert pits_and_fundi(surface, depth, deep=0.3, persistence=0.5)[0] == 1  # the saddle is 0.4 below the peaks
    assert pits_and_fundi(surface, depth, deep=0.7, persistence=0.1) == (2, 0.0)  # not joined above 0.6
    assert pits_and_fundi(surface, -depth, deep=0.3, persistence=0.1) == (0, 0.0)


def test_weighted_percentiles_count_by_weight():
    values, weights = np.array([3.0, 1.0, 2.0]), np.array([2.0, 1.0, 1.0])
    repeated = np.sort(np.repeat(values, [200, 100, 100]))
    for percent in (20, 40, 60, 90):
        assert abs(weighted_percentiles(values, weights, percent) - np.percentile(repeated, percent)) < 0.8
    assert weighted_percentiles(np.arange(11.0), np.ones(11), 50) == 5
    assert weighted_percentiles(values, weights, 50) == pytest.approx(2 + 0.5 / 1.5)
