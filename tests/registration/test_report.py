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


def test_the_losses_are_those_that_networks_are_trained_with():
    """Which test_losses.py holds to closed forms."""
    rng, weights = np.random.default_rng(0), Weights(2.0, 0.1, 1e4)
    mu = 0.3 * np.exp(1j * rng.uniform(0, 6, len(FACES))) * rng.uniform(0, 1, len(FACES))
    mapped = POINTS + 0.01 * rng.normal(size=3)
    mesh, shares = losses.LossMesh(DISK, torch.float64), torch.from_numpy(DISK.areas / np.pi)
    mu_there, *points = given = [torch.from_numpy(array)[None] for array in (mu, mapped, POINTS)]
    expected = {"L_mu": losses.L_mu(mu_there, shares), "L_grad_mu": losses.L_grad_mu(mesh, mu_there, shares)}
    expected |= {"L_Landmark": losses.L_Landmark(*points), "L_CP": losses.L_CP(mesh, *given, weights, shares=shares)}
    found = measured_losses(Problem(DISK, POINTS, POINTS), weights, mu, mapped)
    assert found == {name: pytest.approx(loss.item(), rel=1e-12) for name, loss in expected.items()}


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
