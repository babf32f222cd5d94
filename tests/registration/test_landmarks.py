"""Landmark curves: sampling by arc length in space, and sulci as shortest paths in the fundus metric."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from known_surfaces import distance_to_floor, grooved_sphere, icosphere, longitudes, sheet
from qclearn.registration.curves import detect_curves, equally_spaced, fundus_metric, fundus_path, sample_curve
from qclearn.registration.problem import LandmarkError
from qclearn.surfaces.surface import Surface


@pytest.fixture(scope="module")
def groove():
    return grooved_sphere()


def test_samples_of_any_field_are_those_at_the_same_places_of_the_path():
    """Twenty-three points over 60 unequal segments, against interpolation over the length along the path."""
    surface = sheet(61, 1.0, lambda x, y: 0.3 * np.sin(9 * x) * np.cos(7 * y))[0]
    path = np.array([k + 61 * (k % 3) for k in range(61)])
    matrix = sample_curve(surface, path, 23)
    points = surface.vertices[path]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    field = np.exp(5j * np.arange(61 * 61))
    expected = np.interp(np.linspace(0, along[-1], 23), along, field[path])
    np.testing.assert_allclose(matrix @ field, expected, atol=1e-12)
    assert matrix.shape == (23, 61 * 61) and matrix.data.min() >= 0
    np.testing.assert_allclose(matrix.sum(1), 1)


def test_a_curve_without_length_is_refused():
    with pytest.raises(LandmarkError, match="no length.*give its endpoints apart"):
        equally_spaced(np.ones((2, 3)), 10)


def edge_lengths(surface):
    return np.linalg.norm(np.diff(surface.vertices[surface.edges], axis=1)[:, 0], axis=1)


def test_the_metric_is_short_on_the_floor_and_long_on_the_rims(groove):
    surface, _ = groove
    factor, ends = fundus_metric(surface) / edge_lengths(surface), surface.vertices[surface.edges]
    away = np.stack([distance_to_floor(ends[:, 0]), distance_to_floor(ends[:, 1])])
    between = (abs(longitudes(ends[:, 0])) < 1.4) & (ends[:, 0, 0] > 0)
    floor, rim = (away < 0.04).all(0) & between, ((away > 0.18) & (away < 0.26)).all(0) & between
    # floor: the cheapest depth, exp(-3), times the cheapest curvature, exp(-1)
    assert factor[floor].max() < 0.05 and np.median(factor[rim]) > 1
    assert factor.min() >= np.exp(-4) * (1 - 1e-12) and factor.max() <= np.exp(1) * (1 + 1e-12)


def test_the_metric_scales_with_the_surface_and_needs_no_folds(groove):
    surface, _ = groove
    grown = Surface(10 * surface.vertices, surface.faces)
    np.testing.assert_allclose(fundus_metric(grown), 10 * fundus_metric(surface), rtol=1e-6)
    metric = fundus_metric(icosphere(3, -0.6))
    assert np.isfinite(metric).all() and metric.min() > 0


def test_the_path_follows_the_groove_and_not_the_short_way_wherever_the_surface_lies(groove, monkeypatch):
    """A turn changes depth, of voxels, but not where the floor is; depth alone and curvature alone find it."""
    surface, ends = groove
    direct = fundus_path(surface, *ends, edge_lengths(surface))
    assert distance_to_floor(surface.vertices[direct]).max() > 0.5
    turn = Rotation.from_euler("xyz", [0.3, 1, 2]).as_matrix()
    paths = [fundus_path(surface, *ends), fundus_path(Surface(surface.vertices @ turn.T + 5, surface.faces), *ends)]
    for dropped in ("sulcal_depth", "mean_curvature"):
        with monkeypatch.context() as patch:
            patch.setattr(f"qclearn.registration.curves.{dropped}", lambda surface: np.zeros(len(surface.vertices)))
            paths.append(fundus_path(surface, *ends))
    for path in paths:
        assert (path[0], path[-1]) == tuple(ends)
        assert distance_to_floor(surface.vertices[path]).max() < 0.077  # the mean length of an edge


def test_a_path_is_a_chain_of_edges_and_the_same_both_ways_also_in_the_disk(groove):
    surface, ends = groove
    path, z = fundus_path(surface, *ends), surface.vertices[:, 0] + 1j * surface.vertices[:, 1]
    steps = np.sort(np.stack([path[:-1], path[1:]], axis=1), axis=1)
    assert {tuple(step) for step in steps.tolist()} <= {tuple(edge) for edge in surface.edges.tolist()}
    there, back = detect_curves(surface, z, np.array([ends, ends[::-1]]))
    np.testing.assert_array_equal(there, z[path])
    np.testing.assert_array_equal(back, z[path[::-1]])


def test_with_a_given_metric_the_path_is_shortest_in_it():
    surface, x, y = sheet(21)
    length = edge_lengths(surface)
    np.testing.assert_array_equal(fundus_path(surface, 0, 20, length), np.arange(21))
    middle = surface.vertices[surface.edges].mean(1)
    walled = length * np.where((abs(middle[:, 0] - 0.5) < 0.1) & (middle[:, 1] < 0.4), 1e3, 1)
    around = fundus_path(surface, 0, 20, walled)
    assert y[around][abs(x[around] - 0.5) < 0.1].min() >= 0.4 - 1 / 20


def test_endpoints_must_be_two_vertices(groove):
    surface, ends = groove
    with pytest.raises(LandmarkError, match=f"repeats vertex {ends[0]}"):
        fundus_path(surface, ends[0], ends[0])
    with pytest.raises(LandmarkError, match="out of range"):
        fundus_path(surface, ends[0], len(surface.vertices))
