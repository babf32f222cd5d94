"""CP-Net: what its correction is told, its symmetries, what holds by construction, its training set, bad input."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from test_networks import CPNET, batch, network
from test_refinement import twisted

from data_synth.training import ControlPairs
from qclearn.nets import load
from qclearn.nets.born import Born
from qclearn.nets.cpnet import BestCPNet
from qclearn.nets.cpnet_paper import LOSSES, PaperCPNet, PaperCPNetConfig
from qclearn.nets.losses import L_grad_mu, L_Landmark, L_lost, L_mu
from qclearn.nets.polar import PolarSolver
from qclearn.nets.polargrid import PolarGrid, PolarMesh
from qclearn.nets.torchplane import bounded, fit_mobius
from qclearn.plane.disk import Disk
from qclearn.plane.grids import POWER, polar_disk, ring_tables, square_disk
from qclearn.plane.mobius import best_mobius, mobius, mobius_fields, mobius_slope
from qclearn.registration.fit import exact_map, fit_landmarks, fit_problem
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.registration.report import measured_losses

pytestmark = pytest.mark.usefixtures("one_thread")

LANDMARKS = twisted(0.25)
PAPER = PaperCPNetConfig(curves=2, points=4, size=8, widths=(8, 8, 8))


@pytest.fixture(scope="module")
def grid():
    return PolarGrid(12, 36, modes=12 * 36)


@pytest.fixture(scope="module")
def net():
    """As before training: the head is 0."""
    torch.manual_seed(0)
    return BestCPNet(CPNET).eval()


@pytest.fixture(scope="module")
def stirred():
    return network("cpnet-best")


def tensors(*arrays):
    kinds = {"c": torch.complex64, "f": torch.float32}
    return [torch.tensor(array).to(kinds[array.dtype.kind])[None] for array in arrays]


def test_points_are_located_in_closed_form_and_loads_shared_out_by_the_same_weights():
    mesh, rng = PolarMesh(5, 12), np.random.default_rng(0)
    z = mesh.mesh.z
    points = np.sqrt(rng.random(200)) * np.exp(2j * np.pi * rng.random(200)) * 0.96  # within the chords
    (located,) = tensors(points)
    corners, weights = mesh.locate(located)
    np.testing.assert_allclose((z[corners[0]] * weights[0].numpy()).sum(-1), points, atol=1e-6)
    assert weights.min() > -1e-6
    rim = mesh.sample(*tensors(z), mesh.locate(torch.tensor([[1.0, 1j, np.exp(1.3j)]]).to(torch.complex64)))
    np.testing.assert_allclose(rim[0, :2].numpy(), [1, 1j], atol=1e-6)
    assert abs(np.angle(rim[0, 2].item()) - 1.3) < 0.02
    values, loads = (torch.from_numpy(rng.normal(size=(1, *shape))).float() for shape in ((len(z),), (1, 200)))
    sampled, spread = mesh.sample(values, (corners, weights)), mesh.splat(loads, (corners, weights))
    torch.testing.assert_close((sampled * loads[:, 0]).sum(), (spread[:, 0] * values).sum())  # the transpose


def test_the_prior_is_diagonal_in_the_coefficients(grid):
    c = np.random.default_rng(0).normal(size=(432, 2)) @ [1, 1j]
    spectrum, (_, spokes, arcs) = grid.spectrum, ring_tables(grid.mesh, 36)
    nu = spectrum.field(c)[1:].reshape(12, 36)
    (on_rings,) = tensors(nu)
    kept = torch.tensor(c[grid.selected.numpy()]).to(torch.complex64)[None]
    torch.testing.assert_close(grid.coefficients(on_rings), kept, rtol=1e-3, atol=1e-3)
    assert grid.mean_square(on_rings).item() == pytest.approx((abs(c) ** 2).sum(), rel=1e-3)
    slope = spokes @ (abs(np.diff(nu, axis=0)) ** 2).sum(1) + arcs @ (abs(nu - np.roll(nu, 1, 1)) ** 2).sum(1)
    assert slope / np.pi == pytest.approx((spectrum.values * abs(c) ** 2).sum(), rel=1e-3)


def test_displacements_are_those_of_the_exact_map(grid):
    rng, c = np.random.default_rng(1), np.zeros(432, complex)
    c[grid.selected[:40].numpy()] = (rng.normal(size=(40, 2)) @ [1, 1j]) * 3e-4
    nu, solver = grid.spectrum.field(c), PolarSolver(12, 36, 1.4)
    given = bounded(torch.tensor(grid.mesh.to_faces @ nu))[None]
    exact = solver.solve(given, 1e-9) - torch.tensor(solver.mesh.z)
    columns = torch.view_as_real(torch.from_numpy(mobius_fields(grid.mesh.z[1:]))[None]).mT.flatten(1, 2)
    moved = Born(grid).moved(*tensors(nu[1:].reshape(12, 36)))
    both = torch.stack([moved.flatten(1).to(exact), exact[:, 1:]], -1)
    both = torch.view_as_real(both).transpose(2, 3).flatten(1, 2)
    both = both - columns @ torch.linalg.lstsq(columns, both).solution  # f(0) = 0, f(1) = 1 is another gauge
    assert (both[..., 0] - both[..., 1]).norm() < 0.02 * both[..., 1].norm()


def test_fit_mobius_is_best_mobius():
    p, _ = LANDMARKS
    for a, theta in ((0.3 - 0.2j, 2.0), (0.6j, -1.0)):
        q = mobius(p, a, theta) + 0.01 * p**2
        found = (parameter.item() for parameter in fit_mobius(*tensors(p, q)))
        np.testing.assert_allclose(mobius(p, *found), mobius(p, *best_mobius(p, q)), atol=1e-4)


@pytest.mark.digits
def test_an_untrained_network_starts_at_the_born_step(net):
    mesh = polar_disk(12, 36, POWER)
    problem, weights = Problem(Disk(*mesh), *LANDMARKS), Weights(1.0, 0.1, 1e3)
    answers = net.answers(problem, weights, looks=2)
    np.testing.assert_allclose(answers["CP-Net, no look"], answers["Born step"], atol=1e-6)
    np.testing.assert_allclose(answers["CP-Net, 2 looks"], answers["Born step, 2 looks"], atol=1e-5)
    np.testing.assert_array_equal(net.predict(*mesh, *LANDMARKS, 1.0, 0.1, 1e3), answers["CP-Net, 2 looks"])
    fit = fit_landmarks(*mesh, *LANDMARKS, 1.0, 0.1, 1e3).landmark_error
    off = [abs(exact_map(problem, mu).landmark_error - fit) for mu in answers.values()]
    assert off[2] < 0.1 * fit and off[1] < off[0]


@pytest.mark.digits
def test_stiff_weights_have_a_finer_grid_and_more_looks_from_the_born_step_on(stirred):
    net, mesh, close = stirred, polar_disk(16, 48, 1.4), [np.append(points, points[0] + 0.01) for points in LANDMARKS]
    assert net.rings(*close, Weights()) == 16  # close landmarks have a finer grid, too
    assert abs(net.predict(*square_disk(10), *close, looks=1)).max() < 1
    for gamma, rings, looks, start in ((0.99e4, 12, 2, "CP-Net"), (1e4, 20, 7, "Born step")):
        weights = Weights(gamma=gamma)
        assert net.rings(*LANDMARKS, weights) == rings and net.looks_at(weights) == looks
        problem = Problem(Disk(*mesh), *LANDMARKS)
        answers = net.answers(problem, weights, looks)
        np.testing.assert_array_equal(net.predict(*mesh, *LANDMARKS, gamma=gamma), answers[f"{start}, {looks} looks"])
        assert abs(answers["CP-Net, no look"] - answers["Born step"]).max() > 1e-6
        if looks > 2:  # the best that was looked at: never worse for another look
            found = [
                measured_losses(problem, weights, mu, problem.samples @ exact_map(problem, mu).f)["L_CP"]
                for mu in (answers[f"{start}, {k} looks"] for k in range(2, looks + 1))
            ]
            assert (np.diff(found) < 0.05 * np.array(found[:-1])).all()


def test_a_turn_of_the_disk_turns_the_answer(net, stirred):
    (p, q), (z, faces) = LANDMARKS, polar_disk(12, 36, 1.4)
    turn = np.exp(2j * np.pi * 5 / 36)  # by whole spokes
    for model in (net, stirred):
        straight, turned = (model.predict(x * z, faces, x * p, x * q, 1.0, 0.1, 1e3) for x in (1, turn))
        np.testing.assert_allclose(turned, straight * turn**2, atol=0.02 * abs(straight).max())


def test_absent_landmarks_change_nothing(stirred):
    *points, logs, born, _ = (tensor[:1] for tensor in batch("cpnet-best"))
    cut = [x[:, : int(points[-1].sum())] for x in points]
    torch.testing.assert_close(stirred(*points, logs, born), stirred(*cut, logs, born))


def test_only_ratios_of_the_weights_count_and_few_landmarks_are_enough(stirred):
    for mesh in (square_disk(10), polar_disk(9, 20)):
        mu, other = (stirred.predict(*mesh, *LANDMARKS, *weights) for weights in ((), (10.0, 0.1, 1e4)))
        np.testing.assert_allclose(other, mu, atol=1e-5)
    for count in (1, 2):
        assert np.isfinite(stirred.predict(*mesh, *(x[:count] for x in LANDMARKS))).all()
    two = LANDMARKS[0][:2]
    assert abs(stirred.predict(*mesh, two, mobius(two, 0.1, 0.5))).max() < 5e-3  # float32


MANY = np.linspace(-0.5, 0.5, 129)
BAD = [(3 * MANY[:5], MANY[:5], 1, "closed unit disk"), (MANY, MANY, 1, "at most 128"), (*LANDMARKS, -1, "gamma")]


@pytest.mark.parametrize("moving, target, gamma, message", BAD)
def test_bad_input_is_refused(net, moving, target, gamma, message):
    with pytest.raises(LandmarkError, match=message):
        net.predict(*square_disk(8), moving, target, gamma=gamma)


def test_training_problems_are_masked_inside_and_solved():
    p, wanted, left, mask, logs, born, nu = batch("cpnet-best")
    assert p.shape == mask.shape == (4, 128) and born.shape == nu.shape == (4, 12, 36)
    assert p.abs().max() < 1 and (p[mask == 0] == 0).all() and mask.sum(1).min() >= 4
    assert (logs[:, 0] >= -4).all() and (logs[:, 0] <= 1).all() and (logs[:, 1] >= 0).all() and (logs[:, 1] <= 6).all()
    assert ((left.abs() ** 2).sum(1) < (wanted.abs() ** 2).sum(1)).all() and nu.abs().max() < 1.6


def test_turns_and_mirrors_of_training_problems_are_problems(net):
    """The displacement that a turned or mirrored field makes is the turned or mirrored one."""
    given = batch("cpnet-best")
    before = net.born.moved(given[-1])
    for seed in range(3):
        drawn = net.draw(given, torch.Generator().manual_seed(seed))
        after = net.born.moved(drawn[-1])
        torch.testing.assert_close(drawn[0].abs(), given[0][:, : drawn[0].shape[1]].abs())
        torch.testing.assert_close(after.abs().mean((1, 2)), before.abs().mean((1, 2)), rtol=1e-3, atol=1e-6)
        there, here = (
            net.grid.sample(net.grid.with_centre(field), net.grid.locate(points)).abs()
            for field, points in ((after, drawn[0]), (before, given[0]))
        )
        torch.testing.assert_close(there * drawn[3], (here * given[3])[:, : there.shape[1]], rtol=0.05, atol=2e-3)


@pytest.fixture(scope="module")
def paper():
    torch.manual_seed(0)
    model = PaperCPNet(PAPER).eval()
    t = np.linspace(-0.3, 0.3, 4)
    model.targets.copy_(torch.from_numpy(np.concatenate([0.3 + 1j * t, t - 0.3j])))  # both curves hold 0.3 - 0.3j
    torch.nn.init.normal_(model.head.weight, std=0.5)
    maps = network("dbsnet-straight")
    model.solver = [maps.mesh, lambda mu: maps(mu)[0]]
    return model


def moved(paper):
    q = paper.targets.numpy().astype(complex)
    p = q * np.exp(0.2j * (1 - abs(q) ** 2))
    return mobius(p, *best_mobius(p, q)), q


def test_the_papers_network_points_anywhere_below_one(paper):
    p = tensors(*moved(paper))[0]
    mu = paper(p).detach()
    assert mu.shape == (1, 8, 8) and 0 < mu.abs().max() < 1
    with torch.no_grad():
        for parameter in paper.head.parameters():
            parameter.neg_()
        torch.testing.assert_close(paper(p), -mu)  # the last layer is linear: nothing keeps a sign
        for parameter in paper.head.parameters():
            parameter.neg_()


def test_the_papers_loss_reaches_every_layer_through_dbsnet(paper):
    p, q = tensors(*moved(paper))
    loss, figures = paper.loss((p, q), None)
    loss.backward()
    assert all(parameter.grad.abs().max() > 0 for parameter in paper.parameters())
    assert 0 < figures["error"] < 0.2 and not any("solver" in name for name in paper.state_dict())
    paper.zero_grad()


def test_the_papers_losses_differ_in_means_gauge_and_what_is_lost(paper):
    p, q = moved(paper)
    p, q, off = tensors(p, q, mobius(p, 0.1))
    mesh, mu = paper.solver[0], paper(p).flatten(1).repeat(1, 2).detach()
    shares, losses, errors = mesh.areas / mesh.areas.sum(), {}, {}
    for name in LOSSES:
        model = PaperCPNet(replace(PAPER, loss=name))
        model.load_state_dict(paper.state_dict())
        model.solver = paper.solver
        losses[name], errors[name] = (model.distance(mesh, mu, p, q).item(), model.loss((off, q), None)[1]["error"])
    points = PAPER.gamma * L_Landmark(p, q)
    torch.testing.assert_close(losses["printed"], (L_mu(mu) + L_grad_mu(mesh, mu) + points).item())
    torch.testing.assert_close(losses["corrected"], (L_mu(mu, shares) + L_grad_mu(mesh, mu, shares) + points).item())
    torch.testing.assert_close(losses["whole"], losses["corrected"] + L_lost(mesh, mu, shares).item())
    assert errors["corrected"] == errors["whole"] < 0.1 * errors["printed"]


def test_the_papers_network_knows_its_control_alone(paper):
    p, q = moved(paper)
    mesh = square_disk(12)
    mu = paper.predict(*mesh, p[:-1], q[:-1])  # the point that the two curves share, once
    order = np.array([5, 2, 0, 6, 1, 3, 4])
    np.testing.assert_array_equal(paper.predict(*mesh, p[order], q[order]), mu)
    with pytest.raises(LandmarkError, match="preset best"):
        paper.predict(*mesh, p[:-1], q[:-1] * 0.9)
    with pytest.raises(LandmarkError, match="preset best"):
        paper.predict(*mesh, p[:-2], q[:-2])
    with pytest.raises(LandmarkError, match="1, 1, 10000"):
        paper.predict(*mesh, p[:-1], q[:-1], gamma=1e5)


def test_the_papers_answer_follows_a_mobius_map_before_it(paper):
    p, q = (x[:-1] for x in moved(paper))
    z, faces = square_disk(24)
    a, theta = 0.2 - 0.1j, 0.7
    before = mobius(z, a, theta)
    straight = paper.predict(z, faces, p, q)
    turned = paper.predict(before, faces, mobius(p, a, theta), q)  # the same landmarks on another picture of the disk
    slope = mobius_slope(z[faces].mean(1), a, theta)
    np.testing.assert_allclose(turned * slope.conj() / slope, straight, atol=0.05 * abs(straight).max())


def test_the_papers_examples_have_one_control():
    rng = np.random.default_rng(0)
    control = np.array([[0.3, 0.3 + 0.2j], [-0.3, -0.2 - 0.3j]])
    curves = control + 0.05 * rng.random((3, 2, 2))
    examples = ControlPairs(4, 0, curves, control, moved=0.5)
    for moving, target in examples:
        np.testing.assert_allclose(target.numpy(), control.ravel(), atol=1e-6)
        a, theta = best_mobius(moving.numpy(), control.ravel())
        assert abs(a) < 1e-3 and abs(theta) < 1e-3


def test_the_shipped_networks_two_looks_end_where_the_fit_does():
    net, t = load("cpnet"), np.linspace(-1, 1, 10)
    p = np.concatenate([0.4 + 0.25j * t, -0.3 - 0.1j + 0.25 * t, 0.35j + 0.2 * t])
    q = p * np.exp(0.5j * (1 - abs(p) ** 2)) + 0.05j * p**2
    problem, weights = Problem(Disk(*polar_disk(32, 96, 1.4)), p, q), Weights()
    assert net.config.looks == 2
    found = [fit_problem(problem, weights), exact_map(problem, net.predict(problem.disk.z, problem.disk.faces, p, q))]
    fit, answer = (measured_losses(problem, weights, one.mu, problem.samples @ one.f)["L_CP"] for one in found)
    assert answer < 1.1 * fit
