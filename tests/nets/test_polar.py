"""The batched solver on polar meshes: the same map and adjoint as the factored one, its stopping, its gauge."""

import numpy as np
import pytest
import torch

from exactmaps import DISK_MAPS
from meshes import random_mu
from qclearn.nets.polar import PolarSolver
from qclearn.plane.checks import BeltramiError
from qclearn.plane.solver import DiskSolver

pytestmark = pytest.mark.usefixtures("one_thread")

SIZES = {"least": (2, 3, 1), "small": (3, 7, 1), "even": (8, 24, 1), "odd": (13, 29, 1), "graded": (12, 30, 1.5)}
DEVICES = ["cpu"] + ["cuda"] * torch.cuda.is_available()


@pytest.fixture(params=SIZES.values(), ids=SIZES)
def solver(request):
    return PolarSolver(*request.param)


def coefficients(solver, *largest):
    """One random smooth coefficient for each given max|mu|, (B, F)."""
    rng, mesh = np.random.default_rng(0), solver.mesh
    return torch.from_numpy(np.stack([random_mu(rng, mesh.z, mesh.faces, k) for k in largest]))


def assert_same_as_factored(solver, mu):
    """Map, raised steps and pullback of a batch mu (B, F) against SuperLU, sample by sample."""
    mu.requires_grad_()
    f = solver.solve(mu, tolerance=1e-13)
    floored, grad_f = solver.floored.tolist(), torch.randn(f.shape, generator=torch.manual_seed(1), dtype=f.dtype)
    f.backward(grad_f)
    factored = DiskSolver(solver.mesh)
    for k, one in enumerate(mu.detach().numpy()):
        np.testing.assert_allclose(f[k].detach().numpy(), factored.solve(one), atol=1e-11)
        assert floored[k] == factored.floored
        expected = factored.pullback(grad_f[k].numpy())
        np.testing.assert_allclose(mu.grad[k].numpy(), expected, atol=1e-10 * abs(expected).max())
    return floored


def test_map_and_gradient_equal_the_factored_solver(solver):
    assert_same_as_factored(solver, coefficients(solver, 0.5, 0.0, 0.8))
    solver = PolarSolver(*SIZES["graded"])
    assert assert_same_as_factored(solver, coefficients(solver, 0.3, 0.0, 0.8)) == [0, 0, 1]  # one raised step


def test_small_positive_steps_are_left_alone():
    solver, rng = PolarSolver(2, 6), np.random.default_rng(2234)
    mu = 0.9 * np.exp(2j * np.pi * rng.uniform(size=(1, len(solver.mesh.faces))))
    assert assert_same_as_factored(solver, torch.from_numpy(mu)) == [0]
    boundary = solver.solve(torch.from_numpy(mu[0]), tolerance=1e-13)[7:]
    assert 0 < (boundary.roll(-1) / boundary).angle().min() < 1e-3 * 2 * np.pi / 6


def test_hopeless_coefficient_equals_the_factored_solver():
    """|mu| up to 0.9999, jumping from face to face: 0 leaves the disk, rounding must not outgrow the residual."""
    solver, rng = PolarSolver(2, 6), np.random.default_rng(3)
    size = rng.choice([0.3, 0.9, 0.99, 0.9999], size=len(solver.mesh.faces))
    mu = size * np.exp(2j * np.pi * rng.uniform(size=len(size)))
    f = solver.solve(torch.from_numpy(mu), tolerance=1e-13).numpy()
    assert abs(f[0]) > 1 and solver.iterations.max() <= 30
    factored = DiskSolver(solver.mesh)
    np.testing.assert_allclose(f, factored.solve(mu), atol=1e-9)
    assert solver.floored.tolist() == [factored.floored] == [3]


# Of the DISK_MAPS by the flux form when the method was worked out: 32 x 96 and 64 x 192.
MEASURED = [(1.2e-4, 3.1e-5), (2.5e-4, 6.3e-5), (7.7e-4, 1.9e-4), (1.1e-3, 2.9e-4)]


@pytest.mark.parametrize("exact, largest", list(zip(DISK_MAPS, MEASURED)), ids=[exact.name for exact in DISK_MAPS])
def test_error_and_rate_against_closed_forms(exact, largest):
    errors = []
    for nr in (32, 64):
        solver = PolarSolver(nr, 3 * nr)
        f = solver.solve(torch.from_numpy(exact.on_faces(solver.mesh)))
        errors.append(abs(f.numpy() - exact(solver.mesh.z)).max())
    assert (np.array(errors) <= 1.05 * np.array(largest)).all(), errors
    assert np.log2(errors[0] / errors[1]) >= 1.9, errors


@pytest.mark.parametrize("dtype", [torch.complex64, torch.complex128], ids=str)
@pytest.mark.parametrize("device", DEVICES)
def test_zero_and_one_are_held_exactly_in_the_precision_and_on_the_device_of_mu(dtype, device):
    solver = PolarSolver(24, 72, 1.3)
    mu = coefficients(solver, 0.2, 0.6)
    given = mu.to(device=device, dtype=dtype).requires_grad_()
    f = solver.solve(given)
    f.real.sum().backward()
    assert f.dtype == given.grad.dtype == dtype and f.device == given.grad.device == given.device
    one = 1 + 23 * 72
    assert (f[:, 0] == 0).all() and (f[:, one] == 1).all()
    assert (f[:, one:].abs() - 1).abs().max() < 4 * torch.finfo(dtype).eps
    exact = solver.solve(mu, tolerance=1e-12)
    assert (f.detach().cpu() - exact).abs().max() < 3e-5


def test_no_coefficient_needs_no_iteration(solver):
    """The preconditioner is the inverse at mu = 0: one step for U, which starts at 0, and none for f."""
    solver.solve(torch.zeros(len(solver.mesh.faces), dtype=torch.complex128))
    assert solver.iterations.tolist() == [[1, 0, 0]]


def test_iterations_do_not_grow_with_the_mesh():
    """Nor beyond the bound of conjugate gradients at the condition number ((1 + k)/(1 - k))^2 = 9."""
    counts = []
    for nr in (16, 64):
        solver = PolarSolver(nr, 3 * nr)
        solver.solve(coefficients(solver, 0.5))
        counts.append(solver.iterations)
    assert (counts[1] - counts[0]).abs().max() <= 2 and max(c.max() for c in counts) <= 12, counts


def test_error_follows_the_tolerance_and_the_limit():
    solver = PolarSolver(16, 48)
    mu = coefficients(solver, 0.6)
    exact, counts, errors = solver.solve(mu, tolerance=1e-13), [], []
    for tolerance in (1e-3, 1e-6, 1e-9):
        error = (solver.solve(mu, tolerance) - exact).abs().max()
        assert tolerance / 100 < error < 5 * tolerance
        counts.append(solver.iterations)
    assert (counts[0] < counts[1]).all() and (counts[1] < counts[2]).all()
    for limit in (2, 4):
        errors.append((solver.solve(mu, 1e-12, limit) - exact).abs().max())
        assert solver.iterations.tolist() == [[limit] * 3]
    assert errors[1] < errors[0] / 2


def test_samples_stop_alone():
    solver = PolarSolver(12, 36)
    mu = coefficients(solver, 0.7, 0.0, 0.2)
    together, counts = solver.solve(mu), solver.iterations
    assert counts[0].min() > counts[2].max() > counts[1].max()
    for k in range(3):
        torch.testing.assert_close(solver.solve(mu[k]), together[k], rtol=0, atol=1e-12)
        assert torch.equal(solver.iterations[0], counts[k])


@pytest.mark.parametrize("value", [1.0, -1.5j, complex("nan"), complex("inf")])
def test_unusable_coefficient(value):
    solver = PolarSolver(4, 12)
    mu = torch.zeros(3, len(solver.mesh.faces), dtype=torch.complex64)
    mu[1, 17] = value
    with pytest.raises(BeltramiError, match="first: sample 1, face 17"):
        solver.solve(mu)


@pytest.mark.parametrize("shape", [(49,), (2, 49), (1, 2, 84), (84,)], ids=str)
def test_one_complex_value_a_face(shape):
    with pytest.raises(BeltramiError, match="one value a face"):
        PolarSolver(4, 12).solve(torch.zeros(shape, dtype=torch.complex64 if len(shape) > 1 else torch.float32))


def test_mesh_without_an_inner_ring():
    with pytest.raises(ValueError, match="at least 2 rings; got 1"):
        PolarSolver(1, 12)
