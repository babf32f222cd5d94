"""The paper's losses: zero where they should be, the gradient they claim to be, the printed one's collapse."""

import numpy as np
import pytest
import torch

from exactmaps import DISK_MAPS
from meshes import random_disk, random_mu
from qclearn.nets.losses import (
    L_CP,
    L_LBS,
    L_LD,
    L_Boundary,
    L_DBSNet,
    L_Energy,
    L_grad_mu,
    L_Landmark,
    L_LBS_printed,
    L_lost,
    L_mu,
    LossMesh,
    area,
    energy,
)
from qclearn.plane.beltrami import solve_beltrami
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import mobius
from qclearn.plane.solver import DiskSolver
from qclearn.registration.problem import Weights

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def problem():
    """A random mesh, a coefficient and its exact map as tensors of one sample."""
    disk = Disk(*random_disk(0))
    mu = random_mu(np.random.default_rng(1), disk.z, disk.faces, 0.5)
    f = DiskSolver(disk).solve(mu)
    return LossMesh(disk, torch.float64), *(torch.from_numpy(x)[None] for x in (mu, f)), disk


def test_losses_are_those_of_the_assembled_matrix_the_gradient_and_the_energy(problem):
    mesh, mu, f, disk = problem
    noise = np.random.default_rng(2).normal(size=(2, *f.shape))
    w = (f + 0.05 * torch.from_numpy(noise[0] + 1j * noise[1])).requires_grad_()
    expected = disk.stiffness(mu[0].numpy()) @ w[0].detach().numpy()
    np.testing.assert_allclose(mesh.apply(mu, w)[0].detach(), expected, atol=1e-12)
    both = energy(mesh, mu, w), energy(mesh, mu, w) - area(mesh, w)
    for loss, whole in zip((L_LBS_printed, L_LBS), both):
        (gradient,) = torch.autograd.grad(whole.sum(), w)
        size = 0.5 * (gradient.real.abs() + gradient.imag.abs()).mean(1)
        torch.testing.assert_close(loss(mesh, mu, w.detach()), size)
    torch.testing.assert_close(L_Energy(mesh, mu, w), both[1])
    assert 0 < L_Energy(mesh, mu, f).item() < 0.1 * L_Energy(mesh, mu, w).item()


@pytest.mark.parametrize("exact", DISK_MAPS, ids=lambda m: m.name)
def test_losses_of_exact_maps_fall_with_the_mesh(exact):
    """Rows: order h^2, the error two more, on the printed boundary h. The energy: h^2, and blind to Möbius maps."""
    sizes = []
    for n in (16, 32):
        disk = Disk(*square_disk(n))
        mu, f = (torch.from_numpy(x)[None] for x in (exact.on_faces(disk), exact(disk.z)))
        mesh, moved = LossMesh(disk, torch.float64), torch.from_numpy(mobius(f.numpy(), 0.3 + 0.2j, 1.0))
        losses = L_LBS(mesh, mu, f), L_LBS_printed(mesh, mu, f), L_Energy(mesh, mu, f), L_Energy(mesh, mu, moved)
        sizes.append([loss.item() for loss in losses])
    rows, printed, energies, turned = np.divide(*sizes)
    assert rows > 10 and printed < 5 and energies > 3 and turned > 3
    assert sizes[1][0] < 0.05 * sizes[1][1]  # the printed loss does not vanish at the right map


def test_printed_loss_allows_the_collapse_and_the_corrected_one_does_not():
    """All boundary angles but one shrink, positive and of sum 2 pi, 1 is fixed, the interior solved exactly."""
    z, faces = square_disk(32)
    disk = Disk(z, faces)
    mu = DISK_MAPS[1].on_faces(disk)
    mesh, given = LossMesh(disk, torch.float64), torch.from_numpy(mu)[None]
    loop = mesh.loop.numpy()
    angle = np.angle(DISK_MAPS[1](z[loop]))
    maps = [solve_beltrami(z, faces, mu, loop, np.exp(1j * share * angle)) for share in (1.0, 0.3, 0.1, 0.01)]
    printed = [L_LBS_printed(mesh, given, torch.from_numpy(f)[None]).item() for f in maps]
    assert sorted(printed, reverse=True) == printed and printed[-1] < 0.05 * printed[0]
    for f in maps:
        f[abs(z).argmin()] = 0  # the other point that the corrected loss holds
    corrected = [L_LBS(mesh, given, torch.from_numpy(f)[None]).item() for f in maps]
    assert min(corrected[1:]) > 20 * corrected[0], (printed, corrected)


def test_boundary_loss_is_least_for_equal_angles():
    n = 12
    equal = torch.full((1, n), 2 * np.pi / n, dtype=torch.float64)
    tilted = equal + torch.linspace(-0.1, 0.1, n, dtype=torch.float64)
    least, more = (L_Boundary(angles).item() for angles in (equal, tilted))
    assert more == pytest.approx((1 / tilted).sum().item()) and more > least == pytest.approx(n**2 / (2 * np.pi))


def test_point_losses_are_the_printed_sums():
    x, y = torch.tensor([[1 + 1j, 2.0], [0, 0]]), torch.tensor([[1, 2j], [3, 0]])
    assert L_LD(x, y).tolist() == [1 + 8, 9]
    assert L_Landmark(x, y).tolist() == [4.5, 4.5]
    assert L_mu(x).tolist() == [3, 0] and L_mu(x, torch.tensor([0.0, 1.0])).tolist() == [4, 0]


def test_gradient_of_a_linear_coefficient_is_exact():
    """`mu = (1 + 2i) x + i y` has |grad mu|^2 = 5 + 1, where the vertex means do not see the boundary."""
    disk = Disk(*polar_disk(24, 72))
    centre = disk.centroids
    mesh, mu = (LossMesh(disk, torch.float64), torch.from_numpy((1 + 2j) * centre.real + 1j * centre.imag)[None])
    inside = (abs(centre) > 0.2) & (abs(centre) < 0.8)
    assert L_grad_mu(mesh, mu, torch.from_numpy(inside / inside.sum())).item() == pytest.approx(6, rel=0.02)


@pytest.mark.parametrize("checks", [False, True])
def test_what_averages_lose_is_nearly_all_of_stripes_and_little_of_a_linear_field(checks):
    disk = Disk(*square_disk(16))
    mesh, (row, column) = LossMesh(disk, torch.float64), np.indices((16, 16))
    stripes, linear = (-1.0) ** (row + checks * column), (column + 1j * row) / 8
    both = (torch.from_numpy(image.ravel().astype(complex)).repeat(2)[None] for image in (stripes, linear))
    (seen, lost), (kept, left) = ((L_grad_mu(mesh, mu).item(), L_lost(mesh, mu).item()) for mu in both)
    assert lost == pytest.approx((4 / disk.areas).mean(), rel=0.2) and lost > 8 * seen
    assert 0 < left < 0.5 * kept and L_lost(mesh, torch.full((1, 512), 0.3 + 0.1j)).item() < 1e-20


def test_losses_weigh_their_parts(problem):
    mesh, mu, f, *_ = problem
    points, target = f[:, :4], f[:, 4:8]
    parts = 2 * L_mu(mu) + 3 * L_grad_mu(mesh, mu) + 5 * L_Landmark(points, target)
    torch.testing.assert_close(L_CP(mesh, mu, points, target, Weights(2.0, 3.0, 5.0)), parts)
    angles = torch.rand(1, 5, dtype=torch.float64) + 0.1
    for equation in (L_LBS, L_LBS_printed):
        expected = 2 * equation(mesh, mu, f) + 0.1 * L_Boundary(angles)
        torch.testing.assert_close(L_DBSNet(mesh, mu, f, angles, 2.0, 0.1, equation), expected)
