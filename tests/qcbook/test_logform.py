"""The log form: the same maps by a second route, and its exact mean of 1/L."""

import numpy as np
import pytest

from exactmaps import DISK_MAPS, after, assert_accuracy, errors, moebius, normalised, sliding, twist
from meshes import boundary_loop, random_disk, random_mu
from qcbook.logform import mean_reciprocal, solve_beltrami_disk_log
from qclearn.plane.beltrami import solve_beltrami_disk
from qclearn.plane.checks import BeltramiError
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius

MEASURED = {  # largest error over the vertices: square grid 32 and 64, polar 32 x 96 and 64 x 192
    "radial stretch": (1.7e-4, 5.7e-5, 1.1e-4, 3.6e-5),
    "twist": (1.8e-3, 5.8e-4, 2.7e-4, 6.8e-5),
    "sliding": (7.4e-4, 2.3e-4, 4.3e-4, 1.1e-4),
    "sliding 3": (8.2e-4, 2.3e-4, 2.8e-4, 7.1e-5),
}


@pytest.mark.parametrize("exact", DISK_MAPS, ids=lambda exact: exact.name)
def test_error_and_rate_against_closed_forms(exact):
    assert_accuracy(solve_beltrami_disk_log, exact, MEASURED[exact.name], 1.5)


def bend(z):
    """A smooth coefficient without a closed form for its map, |mu| up to 0.61."""
    return 0.5 * np.sin(2 * z.real + 1) + 0.35j * np.cos(3 * z.imag - z.real)


@pytest.mark.parametrize("solve", [solve_beltrami_disk, solve_beltrami_disk_log])
def test_error_estimate_by_refinement_holds_on_an_exact_map(solve):
    """The estimate that the next test relies on: a third of the change from one grid to the next
    finer one."""
    exact = sliding(0.5)
    estimate = refined(solve, exact.mu, 32)[1]
    assert estimate == pytest.approx(errors(solve, exact, polar_disk(32, 96))[0] / 4, rel=0.3)


def refined(solve, coefficient, nr):
    """The map on the polar mesh 2 nr x 6 nr at the vertices of nr x 3 nr, and an estimate of its
    largest error."""
    maps = []
    for n in (nr, 2 * nr):
        z, faces = polar_disk(n, 3 * n)
        maps.append(solve(z, faces, coefficient(z[faces].mean(1))))
    rings = 1 + (2 * np.arange(1, nr + 1) - 1) * 6 * nr  # every second ring, every second spoke
    coarse = np.concatenate([[0], (rings[:, None] + 2 * np.arange(3 * nr)).ravel()])
    return maps[1][coarse], abs(maps[1][coarse] - maps[0]).max() / 3


def test_both_routes_agree_within_the_sum_of_their_errors():
    flux, flux_error = refined(solve_beltrami_disk, bend, 32)
    log, log_error = refined(solve_beltrami_disk_log, bend, 32)
    assert max(flux_error, log_error) < 4e-3
    assert abs(flux - log).max() <= flux_error + log_error


@pytest.mark.parametrize("seed", [3, 4])
def test_both_routes_agree_where_zero_and_one_are_no_vertices(seed):
    z, faces = random_disk(seed, n_boundary=160)
    mu = random_mu(np.random.default_rng(seed), z, faces, 0.6)
    flux, log = solve_beltrami_disk(z, faces, mu), solve_beltrami_disk_log(z, faces, mu)
    assert abs(flux - log).max() < 3e-3
    np.testing.assert_allclose(abs(log[boundary_loop(faces)]), 1, rtol=1e-14)


def test_error_with_the_pole_anywhere():
    """On a mesh moved by a Möbius map, and a map whose coefficient does not vanish at 0."""
    exact = normalised(after(twist(0.6), moebius(0.3 + 0.2j, 0.8)))
    z, faces = polar_disk(32, 96)
    assert abs(exact.mu(np.array([1e-6 + 0j]))[0]) > 0.05
    assert errors(solve_beltrami_disk_log, exact, (mobius(z, 0.2 - 0.1j, 0.5), faces)) < 2.5e-3


def test_mean_reciprocal_against_subdivision():
    z, faces = random_disk(seed=1, n_boundary=24)
    L = z - (0.03 + 0.02j) + (0.3 - 0.4j) * np.conj(z - (0.03 + 0.02j))
    far = abs(L[faces]).min(1) > 0.3
    weights = (
        np.array(
            [[i + 1 / 3, j + 1 / 3, 64 - i - j - 2 / 3] for i in range(64) for j in range(64 - i)]
            + [[i + 2 / 3, j + 2 / 3, 64 - i - j - 4 / 3] for i in range(63) for j in range(63 - i)]
        )
        / 64
    )
    expected = (1 / (L[faces[far]] @ weights.T)).mean(1)
    np.testing.assert_allclose(mean_reciprocal(Disk(L, faces))[far], expected, rtol=1e-5)


@pytest.mark.parametrize("corner", [0, 1, 2])
def test_mean_reciprocal_with_a_corner_at_the_pole(corner):
    """For L = z on the triangle 0, 1, i: the integral of 1/L over it is (pi/4)(1 - i)."""
    L, faces = np.array([0, 1, 1j]), np.roll([[0, 1, 2]], corner, axis=1)
    assert mean_reciprocal(Disk(L, faces))[0] == pytest.approx(np.pi / 2 * (1 - 1j), rel=1e-14)


def test_unusable_input():
    z, faces = polar_disk(4, 12)
    with pytest.raises(BeltramiError, match=r"first: \[0, 1, 2, 3, 4\]"):
        solve_beltrami_disk_log(z, faces, np.ones(len(faces)))
    with pytest.raises(BeltramiError, match="one value a face"):
        solve_beltrami_disk_log(z, faces, np.zeros(3))
