"""Meshes that the tests of the plane share."""

import pytest

from meshes import random_disk
from qclearn.plane.grids import polar_disk, square_disk

MESHES = {
    "square 2": square_disk(2), "square 16": square_disk(16), "polar 1 x 3": polar_disk(1, 3),
    "polar 8 x 24": polar_disk(8, 24), "graded": polar_disk(8, 24, 1.5), "random": random_disk(seed=3),
}  # fmt: skip


@pytest.fixture(params=MESHES, ids=str)
def mesh(request):
    """A mesh of the disk of every kind, (z, faces)."""
    return MESHES[request.param]
