"""Maps of images of mu: the exact ones, those of the shipped networks, what they pass on of a change of mu."""

import numpy as np
import pytest
import torch

from data_synth.training import SolvedFields
from qclearn.nets.cpnet_paper import maps_through
from qclearn.nets.gauges import gauge_errors
from qclearn.nets.squaremaps import SquareMaps
from qclearn.plane.grids import square_disk

pytestmark = pytest.mark.usefixtures("one_thread")

SIZE = 64


@pytest.fixture(scope="module")
def fields():
    """Two images of mu with their exact maps on the mesh of the square."""
    return [torch.stack(column) for column in zip(*SolvedFields(2, 5, SIZE))]


def test_maps_of_the_polar_mesh_are_those_of_the_square(fields):
    mu, exact = fields
    f = SquareMaps(SIZE)(mu, 1e-6)
    errors = gauge_errors(f.numpy(), exact.numpy(), square_disk(SIZE)[0])
    assert 0 < errors["comes"] < 0.01 and 0 < errors["mobius"] < 0.01


@pytest.mark.parametrize("name", ["exact", "best", "paper"])
def test_what_mu_is_changed_by_changes_the_map_as_its_gradient_says(fields, name):
    """The derivative of a sum over the map along a smooth change of mu, against a difference."""
    maps, (mu, _) = maps_through(name, SIZE, torch.device("cpu")), fields
    x, y = np.meshgrid(*2 * [np.linspace(-1, 1, SIZE)])
    change = torch.from_numpy(0.1 * np.cos(2 * x) + 0.1j * x * y).to(mu)
    weights = torch.from_numpy(square_disk(SIZE)[0].conj()).to(mu) / SIZE**2

    def value(mu):
        return (maps(mu) * weights).sum().imag

    given = mu.clone().requires_grad_()
    value(given).backward()
    slope, step = (given.grad.conj() * change).real.sum().item(), 0.1
    with torch.no_grad():
        difference = (value(mu + step * change) - value(mu - step * change)).item() / (2 * step)
    assert abs(difference) > 1e-3 and slope == pytest.approx(difference, rel=0.2)
