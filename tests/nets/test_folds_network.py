"""The try at a network that sees the folds: its examples, its symmetry, and the maps that it begins fits with."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import torch

from qclearn.plane.bijectivity import check_bijective
from qclearn.plane.fields import bounded

TOOL = Path(__file__).parents[2] / "tools" / "folds_network.py"


@pytest.fixture(scope="module")
def tool(tmp_path_factory):
    """The script as a module, what it keeps in a folder of the test."""
    spec = importlib.util.spec_from_file_location("folds_network", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.FOLDER = tmp_path_factory.mktemp("training")
    return module


@pytest.fixture(scope="module")
def net(tool):
    torch.manual_seed(0)
    net = tool.FoldsNet(tool.FoldsConfig(rings=12, spokes=36, channels=(8, 16), blocks=1)).eval().requires_grad_(False)
    torch.nn.init.normal_(net.unet.head.weight, std=0.3)
    return net


def test_what_is_wanted_takes_the_folds_of_an_example_to_those_of_its_control(tool, net):
    pairs = tool.Pairs(1, 0, (1, 2), net.config, quick=True)
    kinds = set()
    for seed in range(8):
        here, control, away, f = pairs.pair(np.random.default_rng(seed))
        kinds.add(control is pairs.subjects[0])
        assert alike(here, control.at(away)) > max(0.5, alike(here, control.at(f)))
        *images, wanted = pairs.draw(np.random.default_rng(seed))
        np.testing.assert_array_equal(wanted.ravel(), away - f)
        np.testing.assert_array_equal(images[1], control.at(f).T.reshape(images[1].shape))
    assert len(kinds) == 2


def alike(one, other):
    return np.corrcoef(one.ravel(), other.ravel())[0, 1]


def test_a_turn_of_both_sides_turns_the_displacements(net):
    here, there = torch.randn(2, 1, 4, 12, 36, generator=torch.Generator().manual_seed(0)).unbind(0)
    once, turned = net(here, there), net(here.roll(8, -1), there.roll(8, -1))
    turn = np.exp(2j * np.pi * 8 / 36)
    np.testing.assert_allclose(turned.numpy(), turn * once.roll(8, -1).numpy(), atol=1e-5)


def test_what_training_turns_and_mirrors_stays_an_example(net):
    images = torch.randn(2, 3, 4, 12, 36, generator=torch.Generator().manual_seed(0))
    wanted = net(*images)
    *seen, asked = net.turned((*images, wanted), torch.Generator().manual_seed(3))
    sizes = [x.abs().mean((1, 2)).numpy() for x in (wanted, asked)]
    np.testing.assert_allclose(*sizes, rtol=1e-5)
    assert (asked - wanted).abs().max() > 0.01 and seen[0].shape == images[0].shape


def test_the_map_near_given_points_is_theirs_where_it_can_be(tool):
    nodes = tool.Nodes(24, 72)
    nu = 0.3 * np.exp(-4 * abs(nodes.z - 0.2) ** 2) * np.exp(1j * nodes.z.real)
    wanted = nodes.solver.solve(bounded(nu[nodes.faces].mean(1)))
    _, f = nodes.map_near(wanted)
    assert abs(f - wanted).mean() < 0.05 * abs(wanted - nodes.z).mean()
    torn = wanted + 0.2 * np.random.default_rng(0).normal(size=wanted.shape)
    assert check_bijective(nodes.z, nodes.faces, nodes.map_near(torn)[1]).bijective


def test_a_network_without_a_start_leaves_the_moebius_map(tool, net):
    torch.manual_seed(0)
    plain = tool.FoldsNet(net.config).eval().requires_grad_(False)
    images = torch.zeros(1, 4, 12, 36)
    assert plain(images, images).abs().max() == 0
    loss, figures = plain.loss((images, images, torch.full((1, 12, 36), 0.1 + 0j)), None)
    assert figures["error"] == 1 and 0.9 < loss <= 1
