"""DBS-Net: what holds by construction, the exact maps it starts from, learns from and goes on to, and bad input."""

import numpy as np
import pytest
import torch
from test_networks import batch, network

import exactmaps
from data_synth.fields import KINDS, random_coefficient
from meshes import random_mu
from qclearn.nets import load
from qclearn.nets.dbsnet import PaperDBSNet, derivative_error, position_error
from qclearn.nets.dbsnet_paper import FourierLayer, poisson_matrix
from qclearn.nets.gauges import gauge_errors
from qclearn.nets.layers import PolarPad
from qclearn.nets.losses import L_Maps
from qclearn.nets.polar import PolarSolver, two_steps
from qclearn.plane.fourier import fourier_coefficients
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def best():
    """A small network far from the identity, and four coefficients."""
    return network("dbsnet-best"), *batch("dbsnet-best")


@pytest.fixture
def paper():
    return network("dbsnet-paper"), *batch("dbsnet-paper")


def test_best_maps_keep_the_circle_before_anything_is_put_right(best):
    net, mu = best
    boundary = net(mu)[:, -16:]
    assert (boundary.abs() - 1).abs().max() < 1e-6 and (boundary[:, 0] - 1).abs().max() < 1e-6


def test_potentials_turn_with_the_coefficient_and_so_does_what_the_network_adds(best):
    """A turn by whole cells of the coarsest grid: mu'(z) = exp(2ia) mu(z exp(-ia)), U'(z) = U(z exp(-ia))."""
    (net, mu), shift = best, 2
    turned = mu.view(4, -1, 16).roll(shift, -1).flatten(1) * np.exp(4j * np.pi * shift / 16)
    for U, V in zip(two_steps(net.solver, mu)[1], two_steps(net.solver, turned)[1]):
        torch.testing.assert_close(V, U.roll(shift, -1), atol=1e-5, rtol=0)
    x = torch.randn(1, 14, 8, 16)
    torch.testing.assert_close(net.unet(x.roll(shift, -1)), net.unet(x).roll(shift, -1), atol=1e-5, rtol=0)


def test_polar_pad_finds_the_neighbours_of_the_disk():
    x = torch.randn(2, 3, 4, 6, dtype=torch.float64, requires_grad=True)
    wide = PolarPad.apply(x)
    assert torch.equal(wide[..., 1:-1, 0], x[..., -1]) and torch.equal(wide[..., 0, 1], x[..., 0, 3])
    assert torch.equal(wide[..., -1, 1:-1], x[..., -1, :]) and torch.equal(wide[..., 0, 0], x[..., 0, 2])
    assert torch.autograd.gradcheck(PolarPad.apply, (x,))


def test_paper_routes(paper):
    net, mu = paper
    (f, angles), z = net(mu), net.mesh.z
    assert angles.min() > 0
    torch.testing.assert_close(angles.sum(1), torch.full((4,), 2 * torch.pi))
    steps = torch.angle(f[:, net.loop].roll(-1, 1) / f[:, net.loop])
    torch.testing.assert_close(f[:, net.loop].abs(), torch.ones(4, 32))
    torch.testing.assert_close(steps.sum(1), torch.full((4,), 2 * torch.pi))
    assert f[:, z.abs().argmin()].abs().max() < 1e-6 and (f[:, net.loop[0]] - 1).abs().max() < 1e-6


def test_paper_takes_the_mobius_map_after_it_away(paper):
    net, mu = paper
    f = net(mu)[0].detach()
    moved = mobius(f.numpy(), np.array([[0.3j], [0.2], [-0.6], [0]]), np.array([[1.0], [0], [4], [2]]))
    torch.testing.assert_close(net.normalised(torch.from_numpy(moved).to(f)), f, atol=1e-5, rtol=0)
    beyond = torch.full_like(f, 1.5)  # f(0) off the disk: still finite, and the circle does not turn over
    assert net.normalised(beyond).isfinite().all()


def test_paper_starts_at_the_identity_without_its_last_layers(paper):
    net = PaperDBSNet(paper[0].config)
    torch.testing.assert_close(net(paper[1])[0], net.mesh.z.repeat(4, 1), atol=1e-6, rtol=0)


def test_fourier_layer_starts_as_the_truncated_transform():
    rng, layer = np.random.default_rng(0), FourierLayer(12, 3)
    image = rng.normal(size=(12, 12)) + 1j * rng.normal(size=(12, 12))
    given = torch.from_numpy(image).to(torch.complex64)[None]
    np.testing.assert_allclose(layer(given)[0].detach(), fourier_coefficients(image, 3), atol=1e-6)


def test_poisson_matrix_extends_harmonically():
    angle = 2 * np.pi * np.arange(64) / 64
    z = np.array([0, 0.5, 0.3j, -0.6 + 0.2j])
    extended = np.cos(3 * angle + 1) @ poisson_matrix(z, np.exp(1j * angle))
    np.testing.assert_allclose(extended, (z**3 * np.exp(1j)).real, atol=1e-6)


def test_gauges_of_the_identity_of_a_moved_map_and_of_half_the_way():
    z, _ = polar_disk(6, 24)
    f = exactmaps.DISK_MAPS[1](z)[None]
    assert gauge_errors(z[None], f, z) == pytest.approx({"comes": 1, "mobius": 1})
    moved = gauge_errors(mobius(f, 0.2, 1.0), f, z)
    assert moved["comes"] > 1 and moved["mobius"] < 1e-6
    half = (f + z) / 2
    assert gauge_errors(half, f, z)["comes"] == pytest.approx(0.5)
    assert L_Maps(*(torch.from_numpy(x) for x in (half, f, z))).item() == pytest.approx(0.5)


def test_start_is_of_second_order():
    """Halving mu divides the errors of the two approximations by 4 and by 8."""
    solver, errors, rng = PolarSolver(16, 32), [], np.random.default_rng(0)
    mu = torch.from_numpy(np.array([random_mu(rng, solver.mesh.z, solver.mesh.faces, 0.2) for _ in range(3)]))
    for share in (1, 0.5):
        exact = solver.solve(share * mu, 1e-12)
        errors.append([(f - exact).abs().mean().item() for f in two_steps(solver, share * mu)[0]])
    first, second, beyond = np.divide(*errors)
    assert 3 < first < 5.5 and 6 < second < 12 and beyond > 6, (first, second, beyond)


def test_augmentation_is_drawn_from_the_generator_and_within_bounds(best):
    net, mu = best
    one, again, other = (net.rescale(mu, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert torch.equal(one, again) and not torch.equal(one, other) and torch.equal(net.rescale(mu, None), mu)
    size = torch.cat([one, other]).abs().amax(1)
    assert size.min() >= 0.05 and size.max() <= 0.6 + 1e-6


def test_solver_goes_on_from_a_map(best):
    net, mu = best
    exact, z = net.solver.solve(mu, 1e-6), net.z.flatten()
    errors = [position_error(net.refine(mu, steps), exact, z).mean().item() for steps in (0, 1, 2, 4)]
    assert sorted(errors, reverse=True) == errors and errors[-1] < 0.05 * errors[0]
    torch.testing.assert_close(net.solver.solve(mu, 1e-6, start=net(mu)), exact, atol=1e-5, rtol=0)
    warm = net.solver.iterations
    net.solver.solve(mu, 1e-6)
    assert (warm < net.solver.iterations).all()
    mesh = net.solver.mesh
    np.testing.assert_allclose(net.solve(mesh.z, mesh.faces, mu[0].numpy(), steps=8), exact[0], atol=1e-4)


def test_derivative_error_is_one_where_a_face_may_fold(best):
    net, mu = best
    mesh, exact = net.solver.mesh, net.solver.solve(mu[:1], 1e-6)
    f = exact + 0.02 * torch.from_numpy(np.random.default_rng(0).normal(size=exact.shape))
    (e_z, e_zbar), (f_z, f_zbar) = (mesh.wirtinger(x[0].numpy()) for x in (f - exact, exact))
    d = (abs(e_z) + abs(e_zbar)) / np.maximum(abs(f_z) - abs(f_zbar), 0.05)
    size, excess = derivative_error(net.mesh, f.to(exact), exact)
    assert size.item() == pytest.approx(np.sqrt(np.mean(d**2)), rel=1e-3)
    assert excess.item() == pytest.approx(np.mean(np.maximum(d - 0.5, 0) ** 2), rel=1e-2)
    folded = mesh.at(f[0].numpy()).maybe_flipped
    assert len(folded) and (d[folded] >= 1 - 1e-5).all()


def test_shipped_networks_on_coefficients_they_have_not_seen():
    """Preset `best` well below what it starts from; `paper` at least nearer than the identity."""
    best, paper = (load("dbsnet", preset) for preset in ("best", "paper"))
    mesh = best.solver.mesh
    mu = [random_coefficient(mesh, np.random.default_rng([8, k]), kind, (0.5, 0.5)) for k, kind in enumerate(KINDS)]
    given = torch.from_numpy(np.array(mu)).to(torch.complex64)
    exact = best.solver.solve(given, 1e-6)
    start = position_error(two_steps(best.solver, given)[0][1], exact, best.z.flatten())
    maps = [np.array([net.solve(mesh.z, mesh.faces, one) for one in mu]) for net in (best, paper)]
    maps.append(np.tile(mesh.z, (2, 1)))
    good, fair, identity = (position_error(torch.from_numpy(f), exact, best.z.flatten()) for f in maps)
    assert good.max() < 0.05 and (good < 0.5 * start).all(), (good, start)
    assert fair.mean() < identity.mean()
