"""Per-vertex files: what is written comes back, in each format; faults are named."""

import numpy as np
import pytest

from qclearn.surface import SurfaceError
from qclearn.values import read_values, write_values

VALUES = np.array([0.1, -2.5, 1 / 3, 7e4])


@pytest.mark.parametrize("name", ["v.npy", "v.txt", "v.gii", "v.shape.gii.gz", "lh.thickness"])
def test_values_come_back(tmp_path, name):
    write_values(tmp_path / name, VALUES)
    exact = name.endswith(("npy", "txt"))
    np.testing.assert_allclose(read_values(tmp_path / name), VALUES, rtol=0 if exact else 1e-6)
    assert [file.name for file in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("name", ["v.npy", "v.txt", "v.gii"])
def test_labels_stay_whole_numbers(tmp_path, name):
    labels = np.array([3, 0, 2_000_000, -1])
    write_values(tmp_path / name, labels)
    assert (read_values(tmp_path / name) == labels).all()


@pytest.mark.parametrize("name", ["v.npy", "v.gii", "v.shape.gii.gz", "lh.thickness"])
def test_a_file_cut_short_is_named(tmp_path, name):
    path = tmp_path / name
    write_values(path, VALUES)
    path.write_bytes(path.read_bytes()[:-6])
    with pytest.raises(SurfaceError, match=name.replace(".", r"\.")):
        read_values(path)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SurfaceError, match="cannot be written"):
        write_values(tmp_path / "nowhere" / "v.npy", VALUES)
