"""What other programs find in a GIFTI file that is written here, read back with nibabel."""

import re
from contextlib import nullcontext
from dataclasses import replace
from xml.dom import minidom

import nibabel
import numpy as np
import pytest

from freesurfer import GEOMETRY
from known_surfaces import grid
from qclearn.io.frames import Frame, frame_of_text, kind_of_name, side_of_name
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.io.safe import LeftOutWarning
from qclearn.io.values import read_map, read_values, write_values
from qclearn.surfaces.surface import Surface, SurfaceError

FLAT = Surface(*grid(3, 3))
CENTRE = np.array([[1.0, 0, 0, 5], [0, 1, 0, -7], [0, 0, 1, 9], [0, 0, 0, 1]])


@pytest.mark.parametrize("name, side, kind", [
    ("lh.pial", "left", "Pial"), ("rh.thickness", "right", None), ("lh.pial.T1", "left", "Pial"),
    ("100307.L.midthickness.32k_fs_LR.surf.gii", "left", "MidThickness"), ("rh.smoothwm", "right", "GrayWhite"),
    ("sub-01_hemi-R_pial.surf.gii", "right", "Pial"), ("lh.sphere.reg", "left", "Spherical"),
    ("1.L.very_inflated.surf.gii", "left", "VeryInflated"), ("registered.surf.gii", None, None), ("l.gii", None, None),
    ("lh_to_rh.gii", None, None), ("Laura.gii", None, None), ("lh.pial_on_white", "left", None),
    ("lh.pial.sphere", "left", None), ("fsaverage_left.gii", "left", None),
])  # fmt: skip
def test_hemisphere_and_kind_are_read_from_a_name_that_says_them(name, side, kind):
    assert side_of_name(f"rh/{name}") == side and kind_of_name(f"white/{name}") == kind


@pytest.fixture
def whole(tmp_path):
    """lh.pial with a volume's geometry, and its vertices as they lie in FreeSurfer."""
    path = tmp_path / "lh.pial"
    nibabel.freesurfer.write_geometry(path, FLAT.vertices, FLAT.faces, volume_info=GEOMETRY)
    return path, read_surface(path).vertices


def test_a_volume_that_lies_askew_is_laid_on_the_scanner_too(tmp_path):
    """By the two affine maps of its voxels, where FreeSurfer's has the same axes for every volume."""
    c, s = np.cos(0.3), np.sin(0.3)
    axes = {"xras": [-c, s, 0], "yras": [0, 0, -1], "zras": [s, c, 0]}
    volume = GEOMETRY | {key: list(map(float, row)) for key, row in axes.items()}
    tkr = np.array([[-1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # rows: the axes of the voxels i, j, k
    ijk = np.random.default_rng(0).uniform(-90, 90, (5, 3))  # from the middle of the volume
    found = Frame(space="tkr", volume=volume).to_scanner(ijk @ tkr)
    np.testing.assert_allclose(found, ijk @ np.array([axes[key] for key in axes]) + GEOMETRY["cras"])
    np.testing.assert_allclose(Frame(volume=volume).to_tkr(found), ijk @ tkr)


def test_coordinates_that_are_not_said_to_be_freesurfers_stay(tmp_path, whole):
    """mris_convert without --to-scanner keeps FreeSurfer's, and says UNKNOWN: what is read so is written so."""
    path, tkr = whole
    unknown = replace(frame_of(path), space=nibabel.gifti.GiftiCoordSystem())
    write_surface(tmp_path / "a.surf.gii", read_surface(path), frame=unknown)
    for name in ("b.surf.gii", "lh.b"):
        write_surface(tmp_path / name, read_surface(tmp_path / "a.surf.gii"), frame=frame_of(tmp_path / "a.surf.gii"))
        np.testing.assert_allclose(read_surface(tmp_path / name).vertices, tkr, atol=1e-6)
    assert frame_of(tmp_path / "lh.b").volume["cras"] == GEOMETRY["cras"]


def test_geometry_that_makes_no_sense_is_refused(tmp_path, whole):
    path, _ = whole
    data = path.read_bytes()
    path.write_bytes(data.replace(b"12.25", b"nan  "))
    with pytest.raises(SurfaceError, match="lh.pial: .*volume geometry makes no sense"):
        frame_of(path)
    path.write_bytes(data.replace(b"1  # volume info valid", b"0  # volume info valid"))
    assert frame_of(path) == Frame("left", kind="Pial")


REGIONS = {1: ("b", (1.0, 0.0, 0.0, 1.0)), 2: ("c", (0.0, 1.0, 0.0, 1.0))}


@pytest.mark.parametrize("zero, raised", [
    (("unknown", (0.1, 0.1, 0.1, 1.0)), 0), (("???", (1.0, 1.0, 1.0, 0.0)), 0), (("insula", (0.1, 0.1, 0.1, 1.0)), 1),
])  # fmt: skip
def test_labels_keep_names_and_colours_and_no_key_is_below_0(tmp_path, zero, raised):
    """Key -1 becomes 0 and shows nothing; where 0 is a region, all keys are raised by one."""
    path, labels = tmp_path / "a.label.gii", {-1: ("???", (1.0, 1.0, 1.0, 0.0)), 0: zero, **REGIONS}
    write_values(path, np.array([-1, 0, 2, 1], dtype=np.int64), side="left", labels=labels)
    found, image = read_map(path), nibabel.load(path)
    assert found.values.dtype == np.int32 and found.values.tolist() == [0, raised, 2 + raised, 1 + raised]
    assert min(found.labels) == 0 and found.labels[0][1][3] == 0.0
    assert [found.labels[key + raised] for key in REGIONS] == list(REGIONS.values())
    theirs = {label.key - raised: (label.label, label.rgba) for label in image.labeltable.labels}
    assert theirs[1] == REGIONS[1] and theirs[2] == REGIONS[2]
    assert image.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    assert image.darrays[0].intent == nibabel.nifti1.intent_codes["NIFTI_INTENT_LABEL"]
    with pytest.raises(SurfaceError, match="a.label.gii: .*keys below 0"):
        write_values(path, np.array([-2, 0]), labels={-2: REGIONS[1]})


def test_an_annotation_comes_back(tmp_path):
    """With regions of one colour, a black one, and Workbench's none at key 0."""
    red, black = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 1.0)
    labels = {0: ("???", (1.0, 1.0, 1.0, 0.0)), 3: ("a b", red), 5: ("M\xfc", red), 9: ("c", black)}
    write_values(tmp_path / "lh.a.annot", np.array([0, 3, 5, 9, -1]), labels=labels)
    keys, _, names = nibabel.freesurfer.read_annot(tmp_path / "lh.a.annot")
    assert keys.tolist() == [-1, 0, 1, 2, -1] and names == [b"a b", "M\xfc".encode(), b"c"]
    assert read_map(tmp_path / "lh.a.annot").side == "left"
    for bad in (np.array([0.5]), np.array([-3]), np.zeros((4, 2), int)):
        with pytest.raises(SurfaceError, match="b.annot: an annotation holds one label a vertex"):
            write_values(tmp_path / "b.annot", bad)


@pytest.mark.parametrize("name, values, names, expected", [
    ("lh.thickness.shape.gii", np.zeros(4), None, ["lh.thickness"]),
    ("a.func.gii", np.arange(8.0).reshape(4, 2), None, ["a 1", "a 2"]),
    ("a.label.gii", np.array([0, 7, 3, 7]), ["regions"], ["regions"]),
])  # fmt: skip
def test_maps_have_names_and_whole_numbers_a_table(tmp_path, name, values, names, expected):
    path = tmp_path / name
    write_values(path, values, names=names)
    image = nibabel.load(path)
    assert read_map(path).names == expected and len(image.darrays) == len(expected)
    np.testing.assert_array_equal(read_values(path), values)
    if "label" in name:
        assert image.labeltable.get_labels_as_dict() == {0: "???", 3: "3", 7: "7"}
        path.write_bytes(path.read_bytes().replace(b">3</Label>", b"></Label>"))
        assert read_map(path).labels[3][0] == "" and read_map(path).labels[7][0] == "7"


def gifti(path, *arrays, keys=()):
    """A file of arrays, each (data, intent), and a table of the keys."""
    table = nibabel.gifti.GiftiLabelTable()
    for key in keys:
        table.labels.append(nibabel.gifti.GiftiLabel(key, 1, 0, 0, 1))
        table.labels[-1].label = f"region {key}" if key else "???"
    made = [nibabel.gifti.GiftiDataArray(data, f"NIFTI_INTENT_{intent}") for data, intent in arrays]
    path.write_bytes(nibabel.GiftiImage(darrays=made, labeltable=table).to_bytes())
    return path


@pytest.mark.parametrize("name", ["lh.a.func.gii", "lh.a.gii.dset"])
def test_node_indices_say_where_values_stand(tmp_path, name):
    """As in AFNI's maps; they are no map of their own."""
    index, x = np.array([3, 0, 2, 1], np.int32), np.array([30, 0, 20, 10], np.float32)
    path = gifti(tmp_path / name, (index, "NODE_INDEX"), (x, "NONE"))
    np.testing.assert_array_equal(read_values(path), [0, 10, 20, 30])
    gifti(path, (index, "NODE_INDEX"), (x, "NONE"), ((x / 10).astype(np.int32), "LABEL"), keys=range(4))
    np.testing.assert_array_equal(read_values(path), np.outer([0, 1, 2, 3], [10, 1]))
    for bad in ([3, 0, 2, 9], [3, 0, 2, 2], [-1, 0, 2, 1]):
        gifti(path, (np.array(bad, np.int32), "NODE_INDEX"), (x, "NONE"))
        with pytest.raises(SurfaceError, match=f"{name}: gives 4 values to .*from {min(bad)} to {max(bad)} .*ConvertD"):
            read_values(path)


WHOLE = np.array([0, 2, 1, 2], np.float32)


@pytest.mark.parametrize("intent, keys, values, kind", [
    ("LABEL", (), WHOLE, "i"), ("NONE", (0, 1, 2), WHOLE, "i"), ("NONE", (0,), WHOLE, "f"), ("NONE", (), WHOLE, "f"),
    ("NONE", (0, 1, 2), WHOLE / 2, "f"), ("LABEL", (0, 1, 2), WHOLE[None], "i"), ("NONE", (), WHOLE[:, None], "f"),
])  # fmt: skip
def test_floats_are_labels_by_intent_or_table(tmp_path, intent, keys, values, kind):
    """But not by the table of none that Workbench writes into every map."""
    found = read_values(gifti(tmp_path / "a.gii", (values, intent), keys=keys))
    assert found.dtype.kind == kind
    np.testing.assert_array_equal(found, values.ravel())


@pytest.mark.parametrize("intent, bad", [("LABEL", 0.5), ("LABEL", np.nan), ("NONE", np.nan)])
def test_labels_that_are_no_whole_numbers_are_refused(tmp_path, intent, bad):
    path = gifti(tmp_path / "a.gii", (np.array([0, 1, bad, 2], np.float32), intent), keys=(0, 1, 2))
    with pytest.raises(SurfaceError, match=f"a.gii: holds labels, but {bad} at vertex 2, no whole number"):
        read_values(path)


@pytest.mark.parametrize("old, new, message", [
    (b'Dim0="9"', b'Dim0="8"', "array of size 9 into shape .8"),
    (b'Dim0="9"', b'Dim0="10"', "size 9 into shape .10"), (b'Dim0="9"', b'Dim0="nine"', "nine"),
    (b'"GZipBase64Binary"', b'"ExternalFileBinary"', "Is a directory"),
    (b'"NIFTI_TYPE_FLOAT32"', b'"NIFTI_TYPE_QUAD"', "NIFTI_TYPE_QUAD"), (b'"UTF-8"', b'"UTF-7777"', "unknown encoding"),
])  # fmt: skip
def test_counts_and_types_that_lie_are_refused(tmp_path, old, new, message):
    write_values(tmp_path / "v.shape.gii", np.arange(9.0))
    data = (tmp_path / "v.shape.gii").read_bytes()
    assert old in data
    (tmp_path / "v.shape.gii").write_bytes(data.replace(old, new))
    with pytest.raises(SurfaceError, match=f"v.shape.gii: not a readable GIFTI.*{message}"):
        read_values(tmp_path / "v.shape.gii")


def test_data_in_a_file_of_their_own_are_read(tmp_path):
    """As SPM and CAT12 leave them, here by columns and of the other byte order."""
    path, values = tmp_path / "v.func.gii", np.arange(8.0).reshape(4, 2)
    gifti(path, (values.astype(np.float32), "NONE"))
    (tmp_path / "v.dat").write_bytes(b"    " + values.T.astype(">f4").tobytes())
    text = path.read_text().replace("GZipBase64Binary", "ExternalFileBinary").replace('Name=""', 'Name="v.dat"')
    text = (
        text.replace('Offset="0"', 'Offset="4"').replace("LittleEndian", "BigEndian").replace("RowMajor", "ColumnMajor")
    )
    path.write_text(re.sub("<Data>.*</Data>", "<Data/>", text))
    np.testing.assert_array_equal(read_values(path), values)
    (tmp_path / "v.dat").unlink()
    with pytest.raises(SurfaceError, match="v.func.gii: not a readable GIFTI.*Cannot locate external file .*v.dat"):
        read_values(path)


ROWS = list(map(str, CENTRE.ravel()))


@pytest.mark.parametrize("matrix, space, kept", [
    ("\n\n  \t".join(ROWS), "SCANNER_ANAT", True), (" ".join(ROWS), "PIGLET", False),
    (" ".join(ROWS[:9]), "SCANNER_ANAT", False), (",".join(ROWS), "SCANNER_ANAT", False),
])  # fmt: skip
def test_a_coordinate_system_is_read_in_any_lines_or_left_out_with_a_word(tmp_path, matrix, space, kept):
    path = tmp_path / "lh.surf.gii"
    write_surface(path, FLAT, frame=Frame(space=nibabel.gifti.GiftiCoordSystem(1, 3, CENTRE)))
    text = re.sub(r"(<MatrixData>)[^<]*", rf"\g<1>{matrix}", path.read_text())
    path.write_text(text.replace("XFORM_SCANNER_ANAT", f"XFORM_{space}"))
    with (
        nullcontext() if kept else pytest.warns(LeftOutWarning, match="lh.surf.gii: its coordinate system .* left out")
    ):
        frame = frame_of(path)
    assert frame_of_text(frame.text).text == frame.text and len(read_surface(path).vertices) == 16
    assert np.array_equal(frame.space.xform, CENTRE) if kept else frame.space is None
    write_surface(tmp_path / "lh.again.surf.gii", read_surface(path), frame=frame)
    assert frame_of(tmp_path / "lh.again.surf.gii").side == "left"


def test_names_of_any_letters_are_written_as_xml_and_read_again(tmp_path):
    names = ["a\tb & <c>", "M\udcfcller", "red\x1b[31m", "end\0\x10"]
    labels = {k: (name, (0.1 * k, 0.5, 0.5, 1.0)) for k, name in enumerate(names)}
    for name in ("lh.a.label.gii", "lh.a.annot"):
        write_values(tmp_path / name, np.arange(4), labels=labels)
        found = read_map(tmp_path / name).labels
        assert [found[k][0] for k in range(4)] == ["a\tb & <c>", r"M\udcfcller", r"red\x1b[31m", r"end\x00\x10"]
    path = tmp_path / "v\udcfc.shape.gii"
    write_values(path, np.ones(4), names=["M\udcfc"])
    assert minidom.parseString(path.read_bytes()) and read_map(path).names == [r"M\udcfc"]


@pytest.mark.parametrize("name", ["lh.a.surf.gii", "lh.a.npz", "sub-01_hemi-L_a.shape.gii"])
def test_metadata_and_a_name_that_differ_are_refused_with_the_command_that_corrects_them(tmp_path, name):
    path, other = tmp_path / name, tmp_path / name.replace("lh", "rh").replace("-L", "-R")

    def write(path):
        if "shape" in name:
            write_values(path, np.ones(4), side="left")
        else:
            write_surface(path, FLAT, frame=Frame("left"))

    words = f"{other.name}: its metadata are of the left hemisphere, its name is of the right one"
    with pytest.raises(SurfaceError, match=words):
        write(other)
    assert not list(tmp_path.iterdir())
    write(path)
    path.rename(other)
    for read in (frame_of, *([read_values] if "shape" in name else [])):
        with pytest.raises(SurfaceError, match=f"{words}; .*wb_command -set-structure .*_RIGHT"):
            read(other)


def test_both_hemispheres_are_refused(tmp_path):
    path = tmp_path / "a.surf.gii"
    write_surface(path, FLAT, frame=Frame("left"))
    path.write_bytes(path.read_bytes().replace(b"CortexLeft", b"CortexRight", 1))
    with pytest.raises(SurfaceError, match="a.surf.gii: its metadata name both hemispheres; .*-set-structure"):
        frame_of(path)
