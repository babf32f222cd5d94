"""Möbius maps of the disk: group laws, the best map between point sets, and the centring gauge."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exactmaps import moebius
from meshes import random_disk
from qclearn.plane.mobius import best_mobius, centring_mobius, compose_mobius, mobius, mobius_inverse, nearest_mobius

in_disk = st.builds(lambda r, t: r * np.exp(1j * t), st.floats(0, 0.9), st.floats(0, 2 * np.pi))
angles = st.floats(-np.pi, np.pi)
POINTS = random_disk(seed=2)[0]


@settings(max_examples=50, deadline=None)
@given(in_disk, angles)
def test_moves_a_to_zero_keeps_the_circle_and_has_an_inverse(a, theta):
    assert abs(mobius(a, a, theta)) < 1e-15
    np.testing.assert_allclose(abs(mobius(np.exp(1j * np.arange(7)), a, theta)), 1, rtol=1e-13)
    np.testing.assert_allclose(mobius_inverse(mobius(POINTS, a, theta), a, theta), POINTS, atol=1e-12)
    np.testing.assert_allclose(mobius(POINTS, a, theta), moebius(a, theta)(POINTS), atol=1e-13)


@settings(max_examples=50, deadline=None)
@given(in_disk, angles, in_disk, angles)
def test_composition_is_a_mobius_map(a, theta, b, phi):
    first, second = (a, theta), (b, phi)
    expected = mobius(mobius(POINTS, *first), *second)
    np.testing.assert_allclose(mobius(POINTS, *compose_mobius(first, second)), expected, atol=1e-11)


@settings(max_examples=10, deadline=None)
@given(in_disk, angles)
def test_best_map_finds_the_exact_one(a, theta):
    p = POINTS[::20]
    found = best_mobius(p, mobius(p, a, theta))
    np.testing.assert_allclose(mobius(p, *found), mobius(p, a, theta), atol=1e-7)


def test_best_map_is_stationary_and_beats_its_neighbours():
    rng = np.random.default_rng(0)
    p = POINTS[::10]
    q = mobius(p, 0.4j, 2.5) + 0.05 * (rng.normal(size=len(p)) + 1j * rng.normal(size=len(p)))
    a, theta = best_mobius(p, q)

    def cost(a, theta):
        return np.mean(abs(mobius(p, a, theta) - q) ** 2)

    best, step = cost(a, theta), 1e-3
    assert best < 0.01
    for change in [(step, 0), (-step, 0), (1j * step, 0), (-1j * step, 0), (0, step), (0, -step)]:
        assert cost(a + change[0], theta + change[1]) > best


@pytest.mark.parametrize("apart", [0.3, 1.5, 3.0])
def test_of_maps_that_fit_alike_rounding_does_not_choose(apart):
    """Two points on the rim go to any two others exactly, by maps that lie on a line; the one that moves 0 the
    least has 1 - |a| = 2 / (1 + s), s the ratio of the tangents of a quarter of the arcs."""
    for seed in range(4):
        jitter = np.exp(1e-15j * np.random.default_rng(seed).normal(size=4))
        sides = jitter[:2] * np.exp([0, 0.15j]), jitter[2:] * np.exp([2j, 2j + 1j * apart])
        for p, q in (sides, sides[::-1]):
            expected = 2 / (1 + np.tan(apart / 4) / np.tan(0.15 / 4))
            assert 1 - abs(best_mobius(p, q)[0]) == pytest.approx(expected, rel=1e-5)


TWO_ENDS = np.concatenate([0.02 * POINTS, mobius_inverse(0.02 * POINTS, -0.9999)])


@pytest.mark.parametrize("points", [mobius_inverse(spread * POINTS, 0.9 * np.exp(2j), 0) for spread in (1, 0.3, 1e-2)]
                         + [mobius_inverse(TWO_ENDS, 0.999)])  # fmt: skip
def test_centring_brings_the_weighted_centroid_to_zero(points):
    """Also of points crowded together near the circle, and near both ends of a diameter, as in the map of a strip."""
    weights = np.linspace(1, 3, len(points))
    a = centring_mobius(points, weights)
    assert abs(a) < 1
    assert abs(weights @ mobius(points, a)) < 1e-13 * weights.sum()


def test_misfits_of_many_point_sets_are_those_of_their_best_maps():
    """Points moved by large Möbius maps, with noise; by nothing; and with targets that have nothing to do with them."""
    rng = np.random.default_rng(5)
    p = 0.6 * np.sqrt(rng.uniform(size=(12, 9))) * np.exp(2j * np.pi * rng.uniform(size=(12, 9)))
    q = np.concatenate([mobius(p[:4], 0.7 - 0.2j, 3.0) + 0.05 * rng.normal(size=(4, 9)), p[4:8], p[8:, ::-1].conj()])
    expected = [abs(mobius(a, *best_mobius(a, b)) - b) for a, b in zip(p, q)]
    _, found = nearest_mobius(p, q)
    np.testing.assert_allclose(found[:8], expected[:8], atol=1e-4)
    np.testing.assert_allclose((found**2).mean(1), np.mean(np.square(expected), axis=1), rtol=1e-4, atol=1e-12)
    assert found[4:8].max() < 1e-12 and np.mean(expected[8:], axis=1).min() > 0.2
