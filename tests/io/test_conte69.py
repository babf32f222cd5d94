"""conte69 from the files of brainspace: a small made-up layout of the same form."""

import numpy as np
import pytest

from known_surfaces import sphere
from qclearn.io.conte69 import MAPS, SIDES, conte69
from qclearn.io.meshes import write_surface
from qclearn.surfaces.surface import Surface, SurfaceError, mirror

BALL = sphere()
N = len(BALL.vertices)


@pytest.fixture
def folder(tmp_path):
    """A data folder as brainspace has it: a ball and its mirror image; masks differ, maps say side and vertex."""
    for name in ("surfaces", "matrices/main_group"):
        (tmp_path / name).mkdir(parents=True)
    for side, word in zip(("left", "right"), SIDES):
        surface = BALL if side == "left" else mirror(Surface(BALL.vertices * 1.1, BALL.faces))
        write_surface(tmp_path / f"surfaces/conte69_32k_{word}.gii", surface)
        keep = BALL.vertices[:, 2] > (-0.8 if side == "left" else -0.7)
        np.savetxt(tmp_path / f"surfaces/conte69_32k_{word}_mask.csv", keep)
    for k, word in enumerate(MAPS.values()):
        values = np.arange(2.0 * N) + 1e4 * k
        values[3] = np.nan
        np.savetxt(tmp_path / f"matrices/main_group/conte69_32k_{word}.csv", values)
    return tmp_path


def test_the_sides_correspond_by_index_and_carry_their_maps(folder):
    left, right, maps = conte69(folder)
    assert left.vertices[:, 2].min() > -0.75 and len(left.boundary)  # cut by both masks
    np.testing.assert_allclose(right.vertices, left.vertices * [-1.1, 1.1, 1.1], atol=1e-6)
    np.testing.assert_array_equal(left.original_vertices, right.original_vertices)
    assert left.volume > 0 and right.volume > 0
    assert list(maps) == ["T1w/T2w", "thickness", "functional gradient", "microstructural gradient"]
    for k, (here, there) in enumerate(maps.values()):
        known = np.isfinite(here)
        assert (~known).sum() == (3 in left.original_vertices)
        np.testing.assert_array_equal(here[known], left.original_vertices[known] + 1e4 * k)
        np.testing.assert_array_equal(there, right.original_vertices + N + 1e4 * k)


def test_sides_of_two_meshes_are_refused(folder):
    order = np.random.default_rng(0).permutation(N)
    shuffled = Surface(BALL.vertices[order], np.argsort(order)[BALL.faces])
    write_surface(folder / "surfaces/conte69_32k_rh.gii", shuffled)
    with pytest.raises(SurfaceError, match="two sides of conte69 differ in their mesh; install brainspace again"):
        conte69(folder)


@pytest.mark.parametrize("text, message", [
    ("1\n2\n", "2 numbers for 642"), ("thick\n", "not a readable table of numbers"), (None, "not a readable table"),
])  # fmt: skip
def test_a_damaged_file_is_named(folder, text, message):
    path = folder / "surfaces/conte69_32k_rh_mask.csv"
    path.unlink() if text is None else path.write_text(text)
    with pytest.raises(SurfaceError, match=f"conte69_32k_rh_mask.csv: {message}"):
        conte69(folder)
