import nibabel
import numpy as np
import pytest

from qclearn.files import read_mask, read_surface, write_surface
from qclearn.surface import Surface, SurfaceError

EXACT = ["a.npz", "a.ply", "a.obj", "a.off", "a.vtk", "a.vtp"]
SINGLE = ["a.gii", "a.surf.gii", "a.surf.gii.gz", "a.stl", "lh.pial", "rh.white", "lh.sphere.reg", "surface"]


@pytest.fixture
def tent():
    """A square pyramid without its base: irrational coordinates, numbered in the order of its faces."""
    vertices = np.pi * np.array([[0, 0, 1 / 3], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 1e-9]])
    return Surface(vertices, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], {"rim": [1, 2, 3], "a b": [4]})


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_round_trip(tmp_path, tent, name):
    write_surface(tmp_path / name, tent)
    back = read_surface(tmp_path / name)
    expected = tent.vertices if name in EXACT else tent.vertices.astype(np.float32)
    np.testing.assert_array_equal(back.vertices, expected)
    np.testing.assert_array_equal(back.faces, tent.faces)
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_npz_keeps_curves_and_ignores_other_arrays(tmp_path, tent):
    write_surface(tmp_path / "a.npz", tent)
    arrays = dict(np.load(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", **arrays, depth=np.zeros(5))
    curves = read_surface(tmp_path / "b.npz").curves
    assert {name: curve.tolist() for name, curve in curves.items()} == {"rim": [1, 2, 3], "a b": [4]}


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_a_file_cut_short_is_refused_wherever_it_is_cut(tmp_path, tent, name, capfd):
    """Or it is read whole, where all that is missing is what no surface needs (a line break, VTK's empty lists)."""
    write_surface(tmp_path / name, tent)
    whole = read_surface(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    path = tmp_path / f"cut-{name}" if "." in name[1:] and not name.startswith(("lh", "rh")) else tmp_path / "cut"
    lengths = [*range(0, len(data), max(len(data) // 50, 1)), *range(len(data) - 12, len(data))]
    read = 0
    for length in lengths:
        path.write_bytes(data[:length])
        try:
            cut = read_surface(path)
        except SurfaceError as error:
            assert str(error).startswith(f"{path}: ")
        else:
            read += 1
            np.testing.assert_array_equal(cut.faces, whole.faces)
            np.testing.assert_array_equal(cut.vertices, whole.vertices)
    assert read < 0.4 * len(lengths)
    assert capfd.readouterr() == ("", "")
