"""What all networks share: they learn a batch, and answers on any mesh are repeatable, bounded or refused."""

from functools import cache

import numpy as np
import pytest
import torch

from data_synth.datasets import CurveDataset
from data_synth.training import DATA_POINTS, Pairs
from meshes import random_disk, random_mu
from qclearn.nets.cpnet import BestCPNet, BestCPNetConfig
from qclearn.nets.cpnet_paper import PaperCPNet, PaperCPNetConfig
from qclearn.nets.dbsnet import BestDBSNet, BestDBSNetConfig, PaperDBSNet
from qclearn.nets.dbsnet_paper import PaperDBSNetConfig
from qclearn.nets.ldnet import BestLDNet, BestLDNetConfig
from qclearn.nets.ldnet_paper import PaperLDNet, PaperLDNetConfig
from qclearn.plane.checks import BeltramiError
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.surfaces.surface import SurfaceError
from subjects import grown

pytestmark = [
    pytest.mark.filterwarnings("ignore::qclearn.plane.bijectivity.RepairWarning"),
    pytest.mark.usefixtures("one_thread"),
]

CPNET = BestCPNetConfig(rings=12, spokes=36, modes=300, channels=(8, 16), blocks=1, finer=16, finest=20)
SQUARE = {"size": 8, "frequencies": 2}
# name -> network, configuration, steps and rate of a short training, share of the loss that may be left after it.
NETWORKS = {
    "ldnet-best": (BestLDNet, BestLDNetConfig(size=32, widths=(16, 24, 32)), 60, 3e-3, 0.5),
    "ldnet-paper": (PaperLDNet, PaperLDNetConfig(size=32, widths=(16, 16, 16), hidden=64), 60, 3e-3, 0.3),
    "cpnet-best": (BestCPNet, CPNET, 12, 3e-3, 0.99),
    "dbsnet-best": (BestDBSNet, BestDBSNetConfig(rings=8, spokes=16, channels=(8, 16), blocks=1), 25, 1e-3, 0.7),
    "dbsnet-paper": (PaperDBSNet, PaperDBSNetConfig(**SQUARE), 25, 1e-3, 0.7),
    "dbsnet-rows": (PaperDBSNet, PaperDBSNetConfig(**SQUARE, loss="rows"), 25, 1e-3, 0.95),
    "dbsnet-maps": (PaperDBSNet, PaperDBSNetConfig(**SQUARE, loss="maps"), 25, 1e-3, 0.95),
    "dbsnet-straight": (PaperDBSNet, PaperDBSNetConfig(**SQUARE, shortcut=False), 25, 1e-3, 0.95),
}
POINTS = 0.5 * np.exp(2j * np.pi * np.arange(6) / 6)
ANSWERS = {  # of a network on a mesh (z, faces): mu or a map
    "cpnet-best": lambda net, z, faces: net.predict(z, faces, POINTS, POINTS * np.exp(0.1j)),
    "dbsnet-best": lambda net, z, faces: net.solve(z, faces, random_mu(np.random.default_rng(1), z, faces, 0.6)),
}
ANSWERS["dbsnet-paper"] = ANSWERS["dbsnet-best"]
MESHES = {"polar": polar_disk(8, 16), "square": square_disk(10), "random": random_disk(3, 40)}


def network(name):
    """A small network whose last layers are not zero."""
    torch.manual_seed(0)
    net = NETWORKS[name][0](NETWORKS[name][1])
    for parameter in net.parameters():
        if not parameter.any():
            torch.nn.init.normal_(parameter, std=0.1)
    return net.eval()


@cache
def batch(name):
    """Items of the training of a network."""
    rng = np.random.default_rng(0)
    if name.startswith("ldnet"):
        items = CurveDataset(4, 5, [grown(1, 1000)], size=32, points=37)
    elif name.startswith("cpnet"):
        t = np.linspace(-1, 1, DATA_POINTS)
        curves = np.array([[0.4], [-0.35 + 0.3j], [-0.1 - 0.45j]]) + np.array([[0.2j], [0.2], [0.15 - 0.15j]]) * t
        moved = [curves + 0.05 * ((rng.random((3, 1)) - 0.5) * (1 + 1j) + rng.random() * t) for _ in range(4)]
        items = Pairs(4, 1, np.array(moved), CPNET)
    elif name == "dbsnet-best":
        mesh = network(name).solver.mesh
        return (torch.from_numpy(np.array([random_mu(rng, mesh.z, mesh.faces, 0.5) for _ in range(4)])).cfloat(),)
    else:
        real, imaginary = rng.uniform(-0.35, 0.35, (2, 4, 8, 8))
        return (torch.from_numpy(real + 1j * imaginary).cfloat(),)
    return tuple(torch.stack(column) for column in zip(*items))


@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_learns_one_batch_and_its_loss_is_its_generators(name):
    _, _, steps, rate, least = NETWORKS[name]
    net, given = network(name).train(), batch(name)
    one, again, other = (net.loss(given, torch.Generator().manual_seed(seed))[0].item() for seed in (1, 1, 2))
    assert one == again != other
    optimiser, losses = torch.optim.AdamW(net.parameters(), rate), []
    for _ in range(steps):
        loss, figures = net.loss(given, None)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert np.isfinite(list(figures.values())).all()
    # CP-Net's loss is a mean logarithm.
    assert losses[-1] < (losses[0] - 0.05 if name.startswith("cpnet") else least * losses[0])


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("name", ANSWERS)
def test_an_answer_on_any_mesh_is_bounded_and_the_same_again(name, mesh):
    net, (z, faces) = network(name), mesh
    found = ANSWERS[name](net, z, faces)
    assert found.dtype == np.complex128 and np.array_equal(found, ANSWERS[name](net, z, faces))
    if name.startswith("cpnet"):
        assert found.shape == (len(faces),) and 0 < abs(found).max() < 1
    else:
        assert found.shape == z.shape and abs(found).max() < 1 + 1e-12 and abs(found - z).max() > 0.02
        np.testing.assert_allclose(abs(found[abs(z) > 1 - 1e-9]), 1, atol=1e-12)
        for point in (0, 1):
            np.testing.assert_allclose(found[abs(z - point) < 1e-9], point, atol=1e-6)


BAD = [
    (lambda z, faces: (2 * z, faces), SurfaceError, "unit circle"),
    (lambda z, faces: (z, np.delete(faces, 60, axis=0)), BeltramiError, "."),  # a hole inside
    (lambda z, faces: (z.conj(), faces), BeltramiError, "counter-clockwise"),
]


@pytest.mark.parametrize("change, error, message", BAD)
@pytest.mark.parametrize("name", ANSWERS)
def test_what_is_no_mesh_of_the_disk_is_refused(name, change, error, message):
    with pytest.raises(error, match=message):
        ANSWERS[name](network(name), *change(*square_disk(8)))


@pytest.mark.parametrize("value", [np.nan, 1.0, 2j])
@pytest.mark.parametrize("name", ["dbsnet-best", "dbsnet-paper"])
def test_impossible_coefficients_are_refused(name, value):
    z, faces = polar_disk(4, 12)
    mu = np.where(np.arange(len(faces)) == 7, value, 0)
    for wrong, message in ((mu, "7"), (mu[:3], ".")):
        with pytest.raises(BeltramiError, match=message):
            network(name).solve(z, faces, wrong)


@pytest.mark.parametrize("kind, config", [(PaperCPNet, PaperCPNetConfig), (PaperDBSNet, PaperDBSNetConfig)])
def test_an_unknown_loss_is_refused(kind, config):
    with pytest.raises(ValueError, match="unknown loss 'half'; there are (printed|corrected)"):
        kind(config(loss="half"))
