"""DBS-Net: what holds by construction, the exact maps it starts from, learns from and goes on to,
and bad input."""

import numpy as np
import pytest
import torch

import exactmaps
from data_synth.fields import KINDS, random_coefficient
from meshes import random_mu
from qclearn.nets import load
from qclearn.nets.dbsnet import BestDBSNet, BestDBSNetConfig, PaperDBSNet, derivative_error, position_error
from qclearn.nets.dbsnet_paper import FourierLayer, PaperDBSNetConfig, poisson_matrix
from qclearn.nets.gauges import gauge_errors
from qclearn.nets.layers import PolarPad
from qclearn.nets.polar import two_steps
from qclearn.plane.fourier import fourier_coefficients
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius

pytestmark = pytest.mark.usefixtures("one_thread")

SMALL = {
    "best": (BestDBSNet, BestDBSNetConfig(rings=8, spokes=16, channels=(8, 16), blocks=1)),
    "paper": (PaperDBSNet, PaperDBSNetConfig(size=8, frequencies=2)),
}


def network(preset):
    """A small network whose last layers are not zero, so that it is far from the identity."""
    torch.manual_seed(0)
    net = SMALL[preset][0](SMALL[preset][1])
    for parameter in net.parameters():
        if not parameter.any():
            torch.nn.init.normal_(parameter, std=0.1)
    return net.eval()


def batch(net, count=4, largest=0.5):
    rng = np.random.default_rng(0)
    if net.config.preset == "paper":
        mu = rng.uniform(-0.35, 0.35, (2, count, net.config.size, net.config.size))
        return torch.from_numpy(mu[0] + 1j * mu[1]).to(torch.complex64) * largest / 0.5
    mu = [random_mu(rng, net.solver.mesh.z, net.solver.mesh.faces, largest) for _ in range(count)]
    return torch.from_numpy(np.array(mu)).to(torch.complex64)


# By construction.


def test_best_maps_keep_the_circle_before_anything_is_put_right():
    net = network("best")
    boundary = net(batch(net))[:, -16:]
    assert (boundary.abs() - 1).abs().max() < 1e-6 and (boundary[:, 0] - 1).abs().max() < 1e-6


def test_potentials_turn_with_the_coefficient_and_so_does_what_the_network_adds():
    """A turn by whole cells of the coarsest grid: mu'(z) = exp(2ia) mu(z exp(-ia)), U'(z) = U(z
    exp(-ia))."""
    net, shift = network("best"), 2
    mu = batch(net)
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


def test_paper_routes():
    net = network("paper")
    f, angles = net(batch(net))
    z = net.mesh.z
    assert angles.min() > 0
    torch.testing.assert_close(angles.sum(1), torch.full((4,), 2 * torch.pi))
    steps = torch.angle(f[:, net.loop].roll(-1, 1) / f[:, net.loop])
    torch.testing.assert_close(f[:, net.loop].abs(), torch.ones(4, 32))
    torch.testing.assert_close(steps.sum(1), torch.full((4,), 2 * torch.pi))
    assert f[:, z.abs().argmin()].abs().max() < 1e-6 and (f[:, net.loop[0]] - 1).abs().max() < 1e-6


def test_paper_takes_the_mobius_map_after_it_away():
    net = network("paper")
    f = net(batch(net))[0].detach()
    moved = mobius(f.numpy(), np.array([[0.3j], [0.2], [-0.6], [0]]), np.array([[1.0], [0], [4], [2]]))
    torch.testing.assert_close(net.normalised(torch.from_numpy(moved).to(f)), f, atol=1e-5, rtol=0)
    beyond = torch.full_like(f, 1.5)  # f(0) off the disk: still finite, and the circle does not turn over
    assert net.normalised(beyond).isfinite().all()


def test_paper_starts_at_the_identity_without_its_last_layers():
    torch.manual_seed(0)
    net = PaperDBSNet(SMALL["paper"][1])
    torch.testing.assert_close(net(batch(net))[0], net.mesh.z.repeat(4, 1), atol=1e-6, rtol=0)


def test_fourier_layer_starts_as_the_truncated_transform():
    rng, layer = np.random.default_rng(0), FourierLayer(12, 3)
    image = rng.normal(size=(12, 12)) + 1j * rng.normal(size=(12, 12))
    given = torch.from_numpy(image).to(torch.complex64)[None]
    np.testing.assert_allclose(layer(given)[0].detach(), fourier_coefficients(image, 3), atol=1e-6)


def test_poisson_matrix_extends_harmonically():
    angle = 2 * np.pi * np.arange(64) / 64
    z = np.array([0, 0.5, 0.3j, -0.6 + 0.2j])
    np.testing.assert_allclose(
        np.cos(3 * angle + 1) @ poisson_matrix(z, np.exp(1j * angle)), (z**3 * np.exp(1j)).real, atol=1e-6
    )


# Against the exact solver.


def test_gauges_of_the_identity_of_a_moved_map_and_of_half_the_way():
    z, _ = polar_disk(6, 24)
    f = exactmaps.DISK_MAPS[1](z)[None]
    assert gauge_errors(z[None], f, z) == pytest.approx({"comes": 1, "mobius": 1})
    moved = gauge_errors(mobius(f, 0.2, 1.0), f, z)
    assert moved["comes"] > 1 and moved["mobius"] < 1e-6
    assert gauge_errors((f + z) / 2, f, z)["comes"] == pytest.approx(0.5)


def test_start_is_of_second_order():
    """Halving mu divides the errors of the two approximations by 4 and by 8."""
    net, errors = BestDBSNet(BestDBSNetConfig(rings=16, spokes=32, channels=(8, 16))), []
    net.solver.tables(torch.zeros(1, dtype=torch.float64))
    for largest in (0.2, 0.1):
        mu = batch(net, 3, largest).to(torch.complex128)
        exact = net.solver.solve(mu, 1e-12)
        maps, _, _ = two_steps(net.solver, mu)
        errors.append([(f - exact).abs().mean().item() for f in maps])
    first, second, beyond = np.divide(*errors)
    assert 3 < first < 5.5 and 6 < second < 12 and beyond > 6, (first, second, beyond)


def test_augmentation_is_drawn_from_the_generator_and_within_bounds():
    net = network("best")
    mu = batch(net)
    one, again, other = (net.rescale(mu, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert torch.equal(one, again) and not torch.equal(one, other) and torch.equal(net.rescale(mu, None), mu)
    size = torch.cat([one, other]).abs().amax(1)
    assert size.min() >= 0.05 and size.max() <= 0.6 + 1e-6


def test_solver_goes_on_from_a_map():
    net = network("best")
    mu = batch(net)
    exact = net.solver.solve(mu, 1e-6)
    start = net(mu)
    z = net.z.flatten()
    errors = [position_error(net.refine(mu, steps), exact, z).mean().item() for steps in (0, 1, 2, 4)]
    assert sorted(errors, reverse=True) == errors and errors[-1] < 0.05 * errors[0]
    torch.testing.assert_close(net.solver.solve(mu, 1e-6, start=start), exact, atol=1e-5, rtol=0)
    warm = net.solver.iterations
    net.solver.solve(mu, 1e-6)
    assert (warm < net.solver.iterations).all()
    z, faces = net.solver.mesh.z, net.solver.mesh.faces
    np.testing.assert_allclose(net.solve(z, faces, mu[0].numpy(), steps=8), exact[0], atol=1e-4)


def test_derivative_error_is_one_where_a_face_may_fold():
    net = network("best")
    mu = batch(net, 1)
    exact = net.solver.solve(mu, 1e-6)
    f = exact + 0.02 * torch.from_numpy(np.random.default_rng(0).normal(size=exact.shape))
    mesh = net.solver.mesh
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
    errors = {}
    for name, net in (("best", best), ("paper", paper)):
        maps = torch.from_numpy(np.array([net.solve(mesh.z, mesh.faces, one) for one in mu]))
        errors[name] = position_error(maps, exact, best.z.flatten())
    identity = position_error(torch.tensor(mesh.z).repeat(2, 1), exact, best.z.flatten())
    assert errors["best"].max() < 0.05 and (errors["best"] < 0.5 * start).all(), (errors, start)
    assert errors["paper"].mean() < identity.mean()
