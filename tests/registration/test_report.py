"""What reports say of a map: means that are known in closed form, and the losses by a second route."""

import numpy as np
import pytest
import torch

from qclearn.nets import losses
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.registration.problem import Problem, Weights
from qclearn.registration.report import log2_distortions, measured_losses
from qclearn.surfaces.surface import Surface

Z, FACES = polar_disk(24, 72)
DISK, CENTRES = Disk(Z, FACES), Z[FACES].mean(1)
POINTS = np.array([0.1, 0.2j, -0.3])


def measured(mu, mapped=POINTS, weights=(1.0, 1.0, 1.0)):
    return measured_losses(Problem(DISK, POINTS, POINTS), Weights(*weights), mu, mapped)


def test_linear_coefficients_have_the_gradient_of_their_slope():
    """|grad (a z + b conj z)|^2 = 2 |a|^2 + 2 |b|^2 and the mean of |z|^2 over the disk is 1/2; a constant has none."""
    for mu, slope in ((0.5 * CENTRES, 0.5), (0.3j * CENTRES.conj(), 0.3)):
        found = measured(mu)
        assert found["L_grad_mu"] == pytest.approx(2 * slope**2, rel=0.03)  # the averages at the rim lie inwards
        assert found["L_mu"] == pytest.approx(slope**2 / 2, rel=5e-3)
    found = measured(np.full(len(FACES), 0.3 - 0.4j))
    assert found["L_mu"] == pytest.approx(0.25, rel=2e-3) and found["L_grad_mu"] < 1e-12 and found["L_Landmark"] == 0


def test_the_sum_is_weighted_and_landmarks_count_by_their_squared_distance():
    mu, off = 0.4 * np.sin(3 * CENTRES.real) + 0.2j * CENTRES.imag, np.array([0.01, 0.02j, 0.03])
    one, weighted = measured(mu, POINTS + off), measured(mu, POINTS + off, (2.0, 0.1, 1e4))
    assert one["L_Landmark"] == pytest.approx(np.mean(abs(off) ** 2))
    assert one["L_CP"] == pytest.approx(one["L_mu"] + one["L_grad_mu"] + one["L_Landmark"])
    assert weighted["L_CP"] == pytest.approx(2 * one["L_mu"] + 0.1 * one["L_grad_mu"] + 1e4 * one["L_Landmark"])


def test_the_losses_are_those_that_networks_are_trained_with():
    rng, weights = np.random.default_rng(0), (2.0, 0.1, 1e4)
    mu = 0.3 * np.exp(1j * rng.uniform(0, 6, len(FACES))) * rng.uniform(0, 1, len(FACES))
    mapped = POINTS + 0.01 * rng.normal(size=3)
    mesh, shares = losses.LossMesh(DISK, torch.float64), torch.from_numpy(DISK.areas / np.pi)
    given = (torch.from_numpy(array)[None] for array in (mu, mapped, POINTS))
    (loss,) = losses.L_CP(mesh, *given, Weights(*weights), shares=shares)
    assert measured(mu, mapped, weights)["L_CP"] == pytest.approx(float(loss), rel=1e-12)


def test_a_stretch_is_told_apart_into_area_and_shape():
    """One half of a flat disk stretched by 2 along x; then all of it by 3: only ratios to the whole count."""
    flat = Surface(np.stack([Z.real, Z.imag, 0 * Z.real], axis=1), FACES)
    found = log2_distortions(flat, 3 * flat.vertices[:, [2, 0, 1]])
    assert found == {key: [pytest.approx(0, abs=1e-12)] * 2 for key in ("log2_area", "log2_shape")}
    stretched = log2_distortions(flat, flat.vertices * [2.0, 0.5, 1.0])
    assert stretched["log2_area"] == [pytest.approx(0, abs=1e-12)] * 2
    assert stretched["log2_shape"] == [pytest.approx(2)] * 2
    half = flat.vertices * np.where(Z.real > 0, 2.0, 1.0)[:, None] ** [1, 0, 0]
    found, share = log2_distortions(flat, half), flat.face_areas[CENTRES.real > 0].sum() / flat.area
    assert found["log2_shape"] == [pytest.approx(share, rel=0.02), pytest.approx(1)]
    grown, rest = np.log2(2 / (1 + share)), np.log2(1 + share)
    assert found["log2_area"][0] == pytest.approx(share * grown + (1 - share) * rest, rel=0.02)
