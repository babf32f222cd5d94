"""Per-vertex files: what is written comes back, in each format; faults are named."""

import nibabel
import numpy as np
import pytest

from qclearn.io.values import read_map, read_values, write_values
from qclearn.surfaces.surface import SurfaceError

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
    expected = np.maximum(labels, 0) if name == "v.gii" else labels  # -1, no label, is 0 there
    assert (read_values(tmp_path / name) == expected).all()


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


@pytest.mark.parametrize("name", ["v.mgh", "v.mgz", "v.func.gii", "v.npy", "v.txt"])
def test_several_maps_and_whole_numbers_come_back(tmp_path, name):
    for values in (np.outer(VALUES, [1, 2]), np.array([3, 0, 2_000_000, -1])):
        write_values(tmp_path / name, values)
        back = read_values(tmp_path / name)
        np.testing.assert_allclose(back, values, rtol=1e-6)
        assert back.dtype.kind == values.dtype.kind


def test_mgz_agrees_with_nibabel(tmp_path):
    nibabel.save(
        nibabel.MGHImage(VALUES.astype(np.float32).reshape(-1, 1, 1), np.eye(4)), tmp_path / "lh.thickness.mgz"
    )
    np.testing.assert_allclose(read_values(tmp_path / "lh.thickness.mgz"), VALUES, rtol=1e-6)
    write_values(tmp_path / "o.mgh", VALUES)
    np.testing.assert_allclose(
        np.squeeze(nibabel.MGHImage.from_bytes((tmp_path / "o.mgh").read_bytes()).dataobj), VALUES, rtol=1e-6
    )
    nibabel.save(nibabel.MGHImage(np.zeros((4, 5, 6), np.float32), np.eye(4)), tmp_path / "T1.mgz")
    with pytest.raises(SurfaceError, match="T1.mgz: holds a volume of 4 x 5 x 6.*mri_vol2surf"):
        read_values(tmp_path / "T1.mgz")


@pytest.mark.parametrize("name, words", [
    ("x.dscalar.nii", "wb_command -cifti-separate"), ("x.dlabel.nii", "wb_command -cifti-separate"),
    ("x.nii.gz", "mri_vol2surf"),
    ("x.csv", "convert it|choose another name"), ("lh.x.csv", "convert it|choose another name"),
    ("x.npz", "save one as .npy"),
    ("x.annot", "vertex records|one label a vertex"), ("x.h5", "convert it|choose another name"),
])  # fmt: skip
def test_formats_that_are_not_read_or_written_are_refused_by_name(tmp_path, name, words):
    with pytest.raises(SurfaceError, match=f"{name}: .*({words})"):
        write_values(tmp_path / name, VALUES)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / name).write_bytes(b"1.0\n2.0\n3.0\n" * 9)
    with pytest.raises(SurfaceError, match=f"{name}: .*({words})"):
        read_values(tmp_path / name)


@pytest.mark.parametrize("name, values", [
    ("v.gii", np.array([2**31])), ("v.gii", np.array([-2**40])),
    ("v.mgh", np.array([2**31])), ("lh.thickness", np.array([2**24 + 1])),
    ("v.gii", np.array([1e300])), ("v.mgh", np.array([-1e39])), ("lh.thickness", np.array([1e39])),
])  # fmt: skip
def test_numbers_that_do_not_fit_are_refused(tmp_path, name, values):
    with pytest.raises(SurfaceError, match=rf"{name}: .* at vertex 0 does not fit.*\.npy"):
        write_values(tmp_path / name, values)
    write_values(tmp_path / "v.npy", values)
    assert read_values(tmp_path / "v.npy") == values


@pytest.mark.parametrize("name", ["v.npy", "v.txt", "v.gii", "v.mgh", "lh.thickness"])
def test_complex_numbers_are_refused_and_nan_is_kept(tmp_path, name):
    with pytest.raises(SurfaceError, match=f"{name}: .*complex128.*real and imaginary"):
        write_values(tmp_path / name, VALUES * 1j)
    write_values(tmp_path / name, np.array([1, np.nan, np.inf]))
    np.testing.assert_array_equal(read_values(tmp_path / name), [1, np.nan, np.inf])


def test_a_text_of_whole_numbers_is_of_labels(tmp_path):
    for text, kind in (("3\n-1\n", "i"), ("3\n0.5\n", "f"), ("3\n1e3\n", "f"), ("3\n+2\n", "i")):
        (tmp_path / "v.txt").write_text(text)
        assert read_values(tmp_path / "v.txt").dtype.kind == kind


@pytest.mark.parametrize("array", [np.ones(3) * 1j, np.array(["a"]), np.array(3.0), np.zeros((2, 2, 2)), np.zeros(0)])
def test_arrays_that_are_no_map_are_refused(tmp_path, array):
    np.save(tmp_path / "v.npy", array)
    with pytest.raises(SurfaceError, match="v.npy: holds .*real number|v.npy: holds .*one number a vertex"):
        read_values(tmp_path / "v.npy")


def test_morphometry_is_known_by_its_content_alone(tmp_path):
    write_values(tmp_path / "lh.thickness", VALUES)
    data = (tmp_path / "lh.thickness").read_bytes()
    (tmp_path / "any.name").write_bytes(data)
    np.testing.assert_allclose(read_values(tmp_path / "any.name"), VALUES, rtol=1e-6)
    for bad in (data + b"\0\0\0\0", data[:11] + b"\0\0\0\2" + data[15:], data[3:]):
        (tmp_path / "any.name").write_bytes(bad)
        with pytest.raises(SurfaceError, match="any.name: "):
            read_values(tmp_path / "any.name")


def test_a_damaged_annotation_is_refused(tmp_path):
    path = tmp_path / "lh.a.annot"
    nibabel.freesurfer.write_annot(
        path, np.array([0, 1, 0]), np.array([[9, 9, 9, 0, 0], [8, 8, 8, 0, 0]]), ["a", "b"], fill_ctab=True
    )
    data = path.read_bytes()
    no_colours = np.array([3, 0, 0, 1, 0, 2, 0, 1, -2, 0, 4, 0, 0], ">i4").tobytes()
    for bad in (
        data[:20],
        data[:28],
        data[:4] + b"\0\0\0\7" + data[8:],
        data[:8] + b"\0\1\2\3" + data[12:],
        no_colours,
    ):
        path.write_bytes(bad)
        with pytest.raises(SurfaceError, match="lh.a.annot: not a readable FreeSurfer annotation"):
            read_values(path)


def test_a_text_of_windows_is_read(tmp_path):
    (tmp_path / "v.txt").write_bytes("1\r\n0\r\n3\r\n".encode("utf-8-sig"))
    values = read_values(tmp_path / "v.txt")
    assert values.dtype == np.int64 and values.tolist() == [1, 0, 3]


def test_a_name_of_an_annotation_ends_at_nul_and_may_be_latin1(tmp_path):
    names = [b"low\0\x10 \x15\xec", "M\xfcller".encode("latin-1")]
    table = np.array([[9, 9, 9, 0, 0], [8, 8, 8, 0, 0]])
    nibabel.freesurfer.write_annot(tmp_path / "lh.a.annot", np.array([0, 1]), table, names, fill_ctab=True)
    labels = read_map(tmp_path / "lh.a.annot").labels
    assert [labels[k][0] for k in range(2)] == ["low", "M\xfcller"]
