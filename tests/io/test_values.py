"""Per-vertex files: what is written comes back, in each format; faults are named."""

import gzip
from contextlib import nullcontext

import nibabel
import numpy as np
import pytest

from qclearn.cli import main
from qclearn.io.frames import Frame
from qclearn.io.hemisphere import Numbering
from qclearn.io.mapfile import side_arrays, write_registration
from qclearn.io.meshes import read_surface, write_surface
from qclearn.io.values import read_map, read_values, write_values
from qclearn.plane.grids import polar_disk
from qclearn.surfaces.surface import Surface, SurfaceError

VALUES = np.array([0.1, -2.5, 1 / 3, 7e4])
WHOLE = np.array([3, 0, 2_000_000, -1])


@pytest.mark.parametrize("name", ["v.npy", "v.txt", "v.gii", "v.shape.gii.gz", "v.mgh", "v.mgz", "lh.thickness"])
def test_values_come_back(tmp_path, name):
    """Several maps and whole numbers, too, but of morphometry; NaN stays, complex numbers do not."""
    path, one_map = tmp_path / name, name == "lh.thickness"
    for values in (VALUES, np.array([1, np.nan, np.inf]), *([] if one_map else [np.outer(VALUES, [1, 2]), WHOLE])):
        write_values(path, values)
        back = read_values(path)
        # -1, no label, is 0 in a GIFTI
        expected = np.maximum(values, 0) if name == "v.gii" and values is WHOLE else values
        np.testing.assert_allclose(back, expected, rtol=0 if name in ("v.npy", "v.txt") else 1e-6)
        assert back.dtype.kind == values.dtype.kind and [file.name for file in tmp_path.iterdir()] == [name]
    with pytest.raises(SurfaceError, match=f"{name}: .*complex128.*real and imaginary"):
        write_values(path, VALUES * 1j)
    if name != "v.txt":
        path.write_bytes(path.read_bytes()[:-30])
        with pytest.raises(SurfaceError, match=name.replace(".", r"\.")):
            read_values(path)
    with pytest.raises(SurfaceError, match="cannot be written"):
        write_values(tmp_path / "nowhere" / name, VALUES)


def test_mgh_agrees_with_nibabel(tmp_path):
    """Also where FreeSurfer folded a long map; a volume is refused."""
    path = tmp_path / "lh.a.mgz"
    for shape in ((42, 1, 1), (7, 1, 6)):
        nibabel.save(nibabel.MGHImage.from_image(voxels(*shape)), path)
        np.testing.assert_array_equal(read_values(path), np.arange(42))
        path.write_bytes(gzip.decompress(path.read_bytes()))  # renamed, not zipped
        np.testing.assert_array_equal(read_values(path), np.arange(42))
    nibabel.save(nibabel.MGHImage.from_image(voxels(4, 5, 6)), path)
    with pytest.raises(SurfaceError, match="lh.a.mgz: holds a volume of 4 x 5 x 6.*mri_vol2surf"):
        read_values(path)
    for version, kind, dtype in (
        (1, 0, "u1"),
        (513, 1, ">i4"),
        (513, 3, ">f4"),
        (1, 4, ">i2"),
        (1, 10, ">u2"),
        (1, 9, "u4"),
    ):
        header = np.array([version, 42, 1, 1, 1, kind], ">i4").tobytes().ljust(284, b"\0")  # FreeSurfer 7.4's intent
        (tmp_path / "t.mgh").write_bytes(header + np.arange(42).astype(dtype).tobytes())
        with (
            pytest.raises(SurfaceError, match="type 9, .*mri_convert -odt float IN OUT") if kind == 9 else nullcontext()
        ):
            np.testing.assert_array_equal(read_values(tmp_path / "t.mgh"), np.arange(42))
    write_values(tmp_path / "o.mgh", VALUES)
    theirs = nibabel.MGHImage.from_bytes((tmp_path / "o.mgh").read_bytes())
    np.testing.assert_allclose(np.squeeze(theirs.dataobj), VALUES, rtol=1e-6)


@pytest.mark.parametrize("name, words", [
    ("x.dscalar.nii", "wb_command -cifti-separate"), ("x.dlabel.nii", "wb_command -cifti-separate"),
    ("x.nii.gz", "mri_vol2surf"),
    ("x.csv", "pandas.read_csv|choose another name"), ("lh.x.csv", "pandas.read_csv|choose another name"),
    ("x.vtk", "pyvista.read"), ("x.parquet", "convert it|choose another name"),
    ("x.npz", "save one as .npy"),
    ("x.annot", "vertex records|one label a vertex"), ("x.h5", "h5py.File|choose another name"),
])  # fmt: skip
def test_formats_that_are_not_read_or_written_are_refused_by_name(tmp_path, name, words):
    with pytest.raises(SurfaceError, match=f"{name}: .*({words})"):
        write_values(tmp_path / name, VALUES)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / name).write_bytes(b"1.0\n2.0\n3.0\n" * 9)
    with pytest.raises(SurfaceError, match=f"{name}: .*({words})"):
        read_values(tmp_path / name)


def voxels(*shape):
    array = np.arange(np.prod(shape), dtype=np.float32).reshape(shape, order="F")
    return nibabel.Nifti1Image(array, np.eye(4))


CORTEX = nibabel.cifti2.BrainModelAxis.from_mask(np.ones(9), "CortexLeft")
CIFTI = nibabel.Cifti2Image(np.zeros((1, 9), np.float32), (nibabel.cifti2.ScalarAxis(["a"]), CORTEX))
PATCH = np.array([-1, 2, 1, 0, 0, 0, -2, 0, 0, 0], ">i4").tobytes()
QUADS = bytes([0, 0, 4, 0, 0, 1]) + bytes(60)
NO_MAP = ".nii files are not read here; "


@pytest.mark.parametrize("name, content, words", [
    ("lh.thickness.nii.gz", voxels(40, 1, 1), NO_MAP + "a surface's map in NIfTI: mri_convert IN OUT.mgh$"),
    ("lh.long.nii", voxels(40, 1, 6, 3), NO_MAP + "a surface's map in NIfTI: mri_convert IN OUT.mgh$"),
    ("T1.nii.gz", voxels(4, 5, 6), NO_MAP + "a volume: mri_vol2surf or wb_command -volume-to-surface-mapping$"),
    ("any.nii", CIFTI, NO_MAP + "CIFTI holds .*wb_command -cifti-separate"),
    ("lh.cortex.patch.flat", PATCH, "patch.*mris_convert -p IN OUT"),
    ("lh.white", b"\xff\xff\xff" + QUADS, "quadrangles"),
    ("lh.pial", b"\xff\xff\xfd" + QUADS, "quadrangles.*: mris_convert IN OUT.surf.gii"),
    ("lh.midthickness.asc", b"#!ascii version of lh.midthickness\n", "FreeSurfer's text.*mris_convert"),
    ("lh.a.niml.dset", b"<AFNI_dataset>", "AFNI's .*ConvertDset -o_gii -input IN -prefix OUT"),
    ("lh.srf", b"\0\0\x80@", "BrainVoyager's surface; bvbabel.srf"),
    ("lh.smp", b"5", "BrainVoyager's maps; bvbabel.smp"), ("a.mnc", b"CDF", "mri_convert IN OUT.nii.gz"),
    ("lh.dfs", b"DFS_LE", "BrainSuite's; s = dfsio.readdfs"), ("a.mat", b"MATLAB", "scipy.io.loadmat.*faces from 0 on"),
    ("a.tsv", b"a", "pandas.read_table"), ("a.xlsx", b"PK", "pandas.read_excel"),
    ("subject_Lwhite.mesh", b"binarDCBA", "BrainVISA's .*AimsFileConvert -i IN -o OUT.gii"),
])  # fmt: skip
def test_foreign_files_are_named_with_their_converter(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content) if isinstance(content, bytes) else nibabel.save(content, path)
    for read in (read_values, read_surface):
        with pytest.raises(SurfaceError, match=f"{name}: .*{words}"):
            read(path)


@pytest.mark.parametrize("name, words", [
    ("lh.thickness", r"belongs to a surface's vertices \(lh.thickness\).*lh.pial"),
    ("lh.a.mgz", "belongs to a surface's vertices.*give that"), ("a.shape.gii", "not one surface.*.surf.gii"),
    ("lh.pial", "is a FreeSurfer surface, not values.*lh.thickness"),
])  # fmt: skip
def test_a_map_is_no_surface_and_a_surface_no_map(tmp_path, name, words):
    is_map = name != "lh.pial"
    (write_values if is_map else write_surface)(tmp_path / name, VALUES if is_map else Surface(np.eye(3), [[0, 1, 2]]))
    with pytest.raises(SurfaceError, match=f"{name}: .*{words}"):
        (read_surface if is_map else read_values)(tmp_path / name)


def test_columns_and_rows_of_one_map_are_that_map(tmp_path):
    for shape in ((4, 1), (1, 4), (4, 1, 1), (1, 1, 4, 1)):
        np.save(tmp_path / "v.npy", VALUES.reshape(shape))
        np.testing.assert_array_equal(read_values(tmp_path / "v.npy"), VALUES)
    np.save(tmp_path / "v.npy", np.outer(VALUES, [1, 2]).reshape(4, 1, 1, 2))
    assert read_values(tmp_path / "v.npy").shape == (4, 2)


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


@pytest.mark.parametrize("text, kind", [
    ("3\n-1\n", "i"), ("3\n0.5\n", "f"), ("3\n1e3\n", "f"), ("3\n+2\n", "i"), ("\ufeff3\r\n0\r\n", "i"), ("3 0", "i"),
    ("3\r\n0\r\n".encode("utf-16"), "i"), ("3\nN/A\n", "f"), ("thickness\n3\n0\n", "i"), ("# mm\r3\r0 # one\r", "i"),
])  # fmt: skip
def test_a_text_of_whole_numbers_is_of_labels(tmp_path, text, kind):
    """As is one of Windows, with a byte order mark; names of one column and comments are left out."""
    (tmp_path / "v.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    found = read_values(tmp_path / "v.txt")
    assert found.dtype.kind == kind and len(found) == 2 and found[0] == 3


@pytest.mark.parametrize("text, words", [
    *[(text, "holds a table or commas .*save the column of a map alone.*pandas.read_csv") for text in (
        "k mm\n0 1.5\n1 2\n2 2\n", "mm\n0,5\n1,5\n", "3;0\n4;1\n9;2", "".join(f"00{k} 0 {k / 2}\n" for k in range(7)),
        "3 1.5\n2 1.5\n1 2\n", "\"mm\"\n\"1\" 2.5\n\"2\" 3.5\n",
    )],
    *[(text, "not a readable text .*could not convert") for text in ("3\n-1.#QNAN\n", "1_000\n2\n", "\u22121\n2\n")],
])  # fmt: skip
def test_tables_and_other_texts_are_told_for_what_they_are(tmp_path, text, words):
    (tmp_path / "v.txt").write_text(text)
    with pytest.raises(SurfaceError, match=f"v.txt: {words}"):
        read_values(tmp_path / "v.txt")


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


def test_a_name_of_an_annotation_ends_at_nul_and_may_be_latin1(tmp_path):
    names = [b"low\0\x10 \x15\xec", "M\xfcller".encode("latin-1")]
    table = np.array([[9, 9, 9, 0, 0], [8, 8, 8, 0, 0]])
    nibabel.freesurfer.write_annot(tmp_path / "lh.a.annot", np.array([0, 1]), table, names, fill_ctab=True)
    labels = read_map(tmp_path / "lh.a.annot").labels
    assert [labels[k][0] for k in range(2)] == ["low", "M\xfcller"]


def regions(path):
    """The names of the vertices' regions, list."""
    found = read_map(path)
    return [found.labels[key][0] for key in found.values.tolist()]


RED, GREEN, BLUE, BLACK, WHITE = (200, 20, 30), (10, 200, 30), (30, 20, 200), (0, 0, 0), (255, 255, 255)


def annotation(path, colours, entries, indexed=True):
    """A FreeSurfer annotation as bytes; entries: (index, name, (r, g, b)) in the order of the file."""

    def words(*numbers):
        return np.array(numbers, ">i4").tobytes()

    def text(name):
        return words(len(name) + 1) + name.encode() + b"\0"

    codes = [red + (green << 8) + (blue << 16) for red, green, blue in colours]
    data = words(len(codes)) + b"".join(words(k, code) for k, code in enumerate(codes)) + words(1)
    data += words(-2, 99) + text("a.ctab") + words(len(entries)) if indexed else words(len(entries)) + text("a.ctab")
    for index, name, colour in entries:
        data += (words(index) if indexed else b"") + text(name) + words(*colour, 0)
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("indexed, entries, keys", [
    (True, [(2, "c", WHITE), (0, "a", RED), (1, "b", GREEN)], [0, 1, 2, -1]),
    (True, [(7, "c", WHITE), (3, "b", GREEN), (0, "a", RED)], [0, 3, 7, -1]),
    (True, [(5, "unknown", BLACK), (1, "b", GREEN), (2, "c", WHITE), (4, "a", RED)], [4, 1, 2, -1]),
    (True, [(5, "dark", BLACK), (1, "b", GREEN), (2, "c", WHITE), (4, "a", RED)], [4, 1, 2, 5]),
    (True, [(1, "b", GREEN), (2, "c", WHITE), (4, "a", RED), (5, "d", BLUE), (6, "e", BLUE)], [4, 1, 2, -1]),
    (False, [(0, "b", GREEN), (1, "a", RED), (2, "c", WHITE)], [1, 0, 2, -1]),
])  # fmt: skip
def test_an_annotations_names_belong_to_indices(tmp_path, indexed, entries, keys):
    """In any order and with gaps, as in the first version; two unused regions may have one colour; black
    is none, but for a region of that colour."""
    path = annotation(tmp_path / "lh.a.annot", [RED, GREEN, WHITE, BLACK], entries, indexed)
    assert read_values(path).tolist() == keys
    assert regions(path) == ["a", "b", "c", "dark" if 5 in keys else "???"]


@pytest.mark.parametrize("entries, words", [
    ([(0, "a", RED), (1, "b", GREEN), (2, "c", GREEN)], "the colour 2017290, of 'b' and 'c'; give each"),
    ([(0, "a", RED), (0, "b", GREEN)], "entry 0 of its table is no index, or is there twice"),
    ([(0, "a", RED)], "a vertex has the colour 2017290, of no region"), ([], "no colour table"),
    ([(0, "a", RED), (1, "b", (10, 300, 30))], "not a readable FreeSurfer annotation"),
])  # fmt: skip
def test_annotations_that_name_no_region_for_sure_are_refused(tmp_path, entries, words):
    path = annotation(tmp_path / "lh.a.annot", [RED, GREEN], entries)
    with pytest.raises(SurfaceError, match=f"lh.a.annot: .*{words}"):
        read_values(path)
    data = path.read_bytes()
    for bad in (data[:20], data[:28], data[:3] + b"\7" + data[4:], data[:4] + b"\0\1\2\3" + data[8:]):
        path.write_bytes(bad)  # cut in the colours or the table, another count, another vertex
        with pytest.raises(SurfaceError, match="lh.a.annot: not a readable FreeSurfer annotation"):
            read_values(path)


@pytest.fixture
def carry(tmp_path):
    """A function: `qclearn transfer` of a file onto a whole surface of 30 vertices, of which a disk has 28."""
    z, faces = polar_disk(3, 9)
    disk = Surface(np.stack([z.real, z.imag, 0 * z.real], 1), faces, None, np.r_[0:10, 12:30])
    arrays = {"disk_map": z, "disk_control": z, "faces_moving": faces, "faces_control": faces}
    for side in ("moving", "control"):
        arrays |= side_arrays(side, disk, Frame("left", count=30))
    write_registration(tmp_path / "r.npz", arrays | {"mirrored": np.array(False)})

    def transferred(name, *options, out="out.npy"):
        words = ["transfer", "r.npz", name, "--to", "control", "--out", out, *options]
        main([str(tmp_path / word) if "." in word else word for word in words])
        return read_map(tmp_path / out)

    return transferred


WALL = [10, 11]
SOME = np.arange(30) % 3


@pytest.mark.parametrize("names, alpha", [
    (["V1", "V2", "V3"], 1.0), (["V1", "V2", "V3"], 0.0), (["???", "V2", "V3"], 0.0),
    (["FreeSurfer_Defined_Medial_Wall", "V2", "V3"], 1.0),
])  # fmt: skip
@pytest.mark.parametrize("out", ["out.label.gii", "lh.out.annot", "out.npy"])
def test_the_wall_is_no_region(tmp_path, carry, names, alpha, out):
    """Also where none of a table's colours is shown, as other programs leave it."""
    table = {key: (name, (key / 3, 0.5, 0.5, alpha)) for key, name in enumerate(names)}
    write_values(tmp_path / "lh.a.label.gii", SOME, labels=table)
    there = carry("lh.a.label.gii", "--nearest", out=out)
    keys = there.values
    if out == "out.npy":
        assert set(keys[WALL]) == {-1 if names[0] == "V1" else 0}
    else:
        names_there = np.array(regions(tmp_path / out))
        assert set(names_there[WALL]) <= {"???", names[0]} - {"V1"}
        np.testing.assert_array_equal(np.delete(names_there, WALL)[SOME[np.r_[0:10, 12:30]] == 1], "V2")
        assert names[0] != "V1" or "V1" in names_there


def test_a_name_and_a_count_say_which_numbers_are_others(tmp_path, carry, capsys):
    for values, words in (
        (np.zeros(29), "29 values for 28 vertices .*, 30 before .*of the cortex alone.*-cifti-separate"),
        (np.zeros(60), "60 values .*of both hemispheres"),
        (np.zeros((3, 30)), "3 values .*transpose"),
    ):
        with pytest.raises(SurfaceError, match=f"v.npy: {words}"):
            Numbering(28, np.r_[0:10, 12:30], 30).on_cut_surface(values, "v.npy")
    np.save(tmp_path / "v.npy", np.zeros(29))
    with pytest.raises(SystemExit):
        carry("v.npy")
    assert "v.npy: 29 values for 28 vertices" in capsys.readouterr().err


@pytest.mark.filterwarnings("default:whole numbers")
@pytest.mark.parametrize("values, options, hinted", [
    (np.where(SOME, SOME, np.nan), (), True), (np.where(SOME, SOME, np.nan), ("--nearest",), False),
    (SOME + 0.5, (), False), (np.ones(30), (), False),
])  # fmt: skip
def test_whole_numbers_of_floats_are_carried_with_a_word(tmp_path, carry, capsys, values, options, hinted):
    np.save(tmp_path / "v.npy", values)
    carry("v.npy", *options)
    hint = "qclearn: whole numbers, carried as numbers; give nearest=True (--nearest) if these are labels\n"
    assert (capsys.readouterr().err == hint) == hinted


def test_maps_of_one_file_keep_their_types(tmp_path, carry, capsys):
    """The wall's key is that of labels alone: beside labels whose 0 is a region, floats get 0 there."""
    columns, table = np.stack([SOME, SOME / 4], axis=1), {key: (f"V{key}", (1.0, 0.5, 0.5, 1.0)) for key in range(3)}
    write_values(tmp_path / "lh.two.gii", columns, None, table, ["regions", "mm"], integer=[True, False])
    with pytest.raises(SystemExit):
        carry("lh.two.gii")
    assert "holds whole numbers" in capsys.readouterr().err
    there = carry("lh.two.gii", "--nearest", out="out.gii")
    assert there.integer == [True, False] and there.names == ["regions", "mm"]
    image = nibabel.load(tmp_path / "out.gii")
    assert [array.data.dtype.kind for array in image.darrays] == ["i", "f"]
    assert there.values[WALL].tolist() == [[0, 0], [0, 0]] and there.labels[0][0] == "???"
    np.testing.assert_array_equal(np.delete(there.values - columns, WALL, axis=0), np.tile([1, 0], (28, 1)))
