"""Fourier compression of Beltrami coefficients: two routes, exact cases, the way to a square and back."""

import numpy as np
import pytest

from qclearn.plane.checks import BeltramiError
from qclearn.plane.disk import Disk
from qclearn.plane.fourier import (
    coefficient_count,
    compress,
    compression_effect,
    fourier_coefficients,
    fourier_matrix,
    frequencies,
    from_coefficients,
    from_square,
    to_square,
)
from qclearn.plane.grids import pixel_centres, polar_disk, square_disk


@pytest.fixture(params=[16, 17])
def image(request):
    rng = np.random.default_rng(request.param)
    return rng.normal(size=(request.param,) * 2) + 1j * rng.normal(size=(request.param,) * 2)


def test_all_frequencies_give_the_image_back(image):
    for k in (8, 100):
        np.testing.assert_allclose(compress(image, k), image, atol=1e-13)
        assert coefficient_count(len(image), k) == image.size
    assert coefficient_count(128, 5) == 121


def test_parseval(image):
    assert (abs(fourier_coefficients(image, 8)) ** 2).sum() == pytest.approx((abs(image) ** 2).mean(), rel=1e-12)


def test_error_falls_with_each_frequency(image):
    errors = [np.linalg.norm(compress(image, k) - image) for k in range(9)]
    assert (np.diff(errors) < 0).all() and errors[-1] < 1e-12 < errors[-2]


def test_matrix_products_are_the_truncated_transform(image):
    m = fourier_matrix(len(image), 3)
    np.testing.assert_allclose(m @ image @ m.T, fourier_coefficients(image, 3), atol=1e-14)
    # straight from the paper's double sum
    n = len(image)
    p, q = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    term = (image * np.exp(-2j * np.pi * (p * 2 - q) / n)).sum() / n**2
    row, column = (np.flatnonzero(frequencies(n, 3) == 2)[0], np.flatnonzero(frequencies(n, 3) == -1)[0])
    assert fourier_coefficients(image, 3)[row, column] == pytest.approx(term)


def test_band_limited_field_is_kept():
    n, (p, q) = 32, np.meshgrid(np.arange(32), np.arange(32), indexing="ij")
    field = 0.1 + 0.3 * np.cos(2 * np.pi * (3 * p + q) / n) + 0.2j * np.sin(2 * np.pi * 2 * q / n)
    np.testing.assert_allclose(compress(field, 3), field, atol=1e-14)
    lost = compress(field, 2)  # only the cosine goes
    np.testing.assert_allclose(lost, field - 0.3 * np.cos(2 * np.pi * (3 * p + q) / n), atol=1e-14)
    np.testing.assert_allclose(from_coefficients(fourier_coefficients(field, 3), n), field, atol=1e-14)


@pytest.mark.parametrize("disk", [Disk(*polar_disk(24, 72)), Disk(*square_disk(40))])
def test_to_the_square_and_back(disk):
    mu = 0.4 * disk.centroids.real - 0.3j * disk.centroids.imag
    image = to_square(disk, mu, 64)
    w = pixel_centres(64)
    shrink = np.maximum(abs(w.real), abs(w.imag)) / abs(w)  # the inverse of the paper's disk-to-square formula
    np.testing.assert_allclose(image, 0.4 * (w * shrink).real - 0.3j * (w * shrink).imag, atol=0.02)
    np.testing.assert_allclose(from_square(image, disk), mu, atol=0.02)
    constant = from_square(to_square(disk, np.full(len(mu), 0.2 - 0.1j), 16), disk)
    np.testing.assert_allclose(constant, 0.2 - 0.1j, rtol=1e-12)


def test_effect_on_the_map():
    disk = Disk(*square_disk(32))
    mu = 0.4 * np.exp(-4 * abs(disk.centroids - 0.2) ** 2) * np.exp(1j * disk.centroids.real)
    rows = compression_effect(disk, mu, (0, 2, 5, 16), size=64)
    assert [row["coefficients"] for row in rows] == [1, 25, 121, 1089]
    for key in ("image_error", "mu_error", "map_error"):
        assert (np.diff([row[key] for row in rows]) < 0).all(), key
    assert rows[0]["map_error"] > 0.02 and rows[2]["map_error"] < 4e-3


def test_bad_input():
    with pytest.raises(ValueError, match="square"):
        compress(np.zeros((4, 5)), 1)
    with pytest.raises(ValueError, match="frequency"):
        compress(np.zeros((4, 4)), -1)
    disk = Disk(*square_disk(16))
    jump = np.where(abs(disk.centroids) < 0.5, 0.95, 0)
    with pytest.raises(BeltramiError, match="mu"):
        compression_effect(disk, jump, [6], 32)
