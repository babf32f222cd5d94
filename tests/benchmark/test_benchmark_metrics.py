"""What the benchmark's tables say of a map, against values by hand."""

import numpy as np
import pytest

from qclearn.benchmark.measures import (
    coefficient_measures,
    correspondence_measures,
    distortion_measures,
    landmark_measures,
    near_curves,
)
from qclearn.benchmark.reference_metrics import middle_distance, tails
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.surfaces.surface import Surface

FACES = np.array([[0, 1, 2], [0, 2, 3]])


def flat(z):
    return np.stack([z.real, z.imag, 0 * z.real], 1)


def test_coefficients_count_by_face_by_disk_and_by_surface():
    surface = Surface(flat(np.array([0, 2, 2 + 1j, 4j])), FACES)  # areas 1 and 4
    found = coefficient_measures(surface, Disk([0, 2, 2 + 1j, 3j], FACES), np.array([0.1j, -0.6]))  # areas 1 and 3
    assert found["mean_abs_mu"] == pytest.approx(0.35) and found["sd_abs_mu"] == pytest.approx(0.25)
    assert found["max_abs_mu"] == 0.6 and found["p95_abs_mu"] == pytest.approx(0.1 + 0.95 * 0.5)
    assert found["mean_abs_mu_disk"] == pytest.approx((0.1 + 3 * 0.6) / 4)
    assert found["mean_abs_mu_area"] == pytest.approx((0.1 + 4 * 0.6) / 5)
    assert found["sd_abs_mu_area"] == pytest.approx(np.sqrt((0.4**2 + 4 * 0.1**2) / 5))


def test_landmark_errors_have_mean_and_spread():
    found = landmark_measures(np.array([0.1, 0.2j]), np.array([0.1 + 0.1j, 0.5j]), np.array([1.0, 5.0]))
    assert list(found) == ["landmark_error", "sd_landmark_error", "landmark_error_mm", "sd_landmark_error_mm"]
    assert list(found.values()) == pytest.approx([0.2, 0.1, 3.0, 2.0])


def test_correspondence_is_measured_everywhere_and_near_sulci():
    truth = np.zeros((4, 3))
    points = np.array([[3.0, 4, 0], [0, 0, 1], [0, 2, 0], [0, 0, 0]])
    found = correspondence_measures(points, truth, np.array([True, False, True, False]))
    assert found["correspondence_mm"] == 2.0 and found["median_correspondence_mm"] == 1.5
    assert found["p95_correspondence_mm"] == pytest.approx(2 + 0.85 * 3) and found["correspondence_sulci_mm"] == 3.5


def test_nearness_is_measured_along_edges():
    z, faces = polar_disk(8, 24)
    surface = Surface(flat(z), faces)
    near = near_curves(surface, [np.array([0]), np.array([1 + 7 * 24, 2 + 7 * 24])], 0.3)
    ring = np.concatenate([[0], np.repeat(np.arange(1, 9), 24)])
    assert near[ring <= 2].all() and not near[(ring > 2) & (z.real < 0)].any()  # 0.3 is two rings of width 1/8
    assert near[1 + 7 * 24] and near[1 + 5 * 24] and not near[1 + 4 * 24]
    assert not near[abs(z + 1) < 1e-9].any()


def test_distortion_by_hand():
    surface = Surface(flat(np.array([0, 1, 1 + 1j, 1j])), FACES)
    similar = distortion_measures(surface, 3 * surface.vertices[:, [1, 2, 0]] + 5)
    assert similar == pytest.approx({"angle_distortion": 0, "area_distortion": 0}, abs=1e-9)
    # The first triangle keeps its angles (90, 45, 45); the second gets a right angle and 60, 30: 15 degrees twice.
    apex = np.sqrt(2) / 2 * np.exp(1j * np.pi / 4) + np.sqrt(2) / 2 * np.exp(1j * (np.pi / 4 + np.pi / 3))
    points = flat(np.array([0, 1, 1 + 1j, apex]))
    ratio = np.array([0.5, np.sqrt(3) / 4]) / (0.5 + np.sqrt(3) / 4) * 2
    found = distortion_measures(surface, points)
    assert found["angle_distortion"] == pytest.approx(30 / 6)
    assert found["area_distortion"] == pytest.approx(abs(np.log2(ratio)).mean())
    lost = distortion_measures(surface, flat(np.array([0, 1, 1 + 1j, 0.5 + 0.5j])))
    assert lost["area_distortion"] == pytest.approx((1 + np.log2(1e6)) / 2)
    # A flat disk, stretched by the same everywhere: areas of equal total do not change.
    z, faces = polar_disk(4, 12)
    found = tails(Surface(flat(z), faces), flat(z) * [1.3, 0.8, 1])
    assert found == pytest.approx({"areal_95": 0, "shape_95": np.log2(1.3 / 0.8)}, abs=1e-9)


def test_the_middle_of_a_curve_leaves_its_ends_out():
    line = np.stack([np.linspace(0, 10, 101), *np.zeros((2, 101))], 1)
    bent = line + np.where(abs(line[:, :1] - 5) > 4, [0.0, 2.0, 0.0], [0.0, 0.5, 0.0])
    assert middle_distance(line, bent) == pytest.approx(0.5)
    assert middle_distance(line, line[::-1]) == 0
