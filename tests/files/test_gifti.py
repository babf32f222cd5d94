"""What other programs find in a GIFTI file that is written here, read back with nibabel."""

import nibabel
import numpy as np
import pytest
from known_surfaces import grid

from qclearn.files.gifti import side_of_name
from qclearn.files.meshes import Frame, frame_of, read_surface, write_surface
from qclearn.files.values import read_labels, read_values, write_values
from qclearn.surfaces.surface import Surface, SurfaceError

CENTRE = np.array([[1.0, 0, 0, 5], [0, 1, 0, -7], [0, 0, 1, 9], [0, 0, 0, 1]])


@pytest.mark.parametrize("name, side", [
    ("lh.pial", "left"), ("rh.thickness", "right"), ("100307.L.midthickness.32k_fs_LR.surf.gii", "left"),
    ("sub-01_hemi-R_pial.surf.gii", "right"), ("fsaverage_left.gii", "left"),
    ("registered.surf.gii", None), ("l.gii", None),
    ("lh_to_rh.gii", None), ("Laura.gii", None),
])  # fmt: skip
def test_the_hemisphere_is_read_from_a_name_that_says_it(name, side):
    assert side_of_name(f"rh/{name}") == side


def test_a_surface_names_its_hemisphere_and_coordinate_system(tmp_path):
    surface = Surface(*grid(3, 3))
    space = nibabel.gifti.GiftiCoordSystem("NIFTI_XFORM_SCANNER_ANAT", "NIFTI_XFORM_TALAIRACH", CENTRE)
    for name, frame, structure in (
        ("lh.a.surf.gii", None, "CortexLeft"),
        ("a.surf.gii", None, None),
        ("b.surf.gii.gz", Frame("right", space), "CortexRight"),
    ):
        write_surface(tmp_path / name, surface, frame=frame)
        image = nibabel.load(tmp_path / name)
        points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")[0]
        assert (
            points.meta.get("AnatomicalStructurePrimary") == image.meta.get("AnatomicalStructurePrimary") == structure
        )
        assert nibabel.nifti1.xform_codes.label[points.coordsys.dataspace] == ("scanner" if frame else "unknown")
    np.testing.assert_array_equal(points.coordsys.xform, CENTRE)
    again = frame_of(tmp_path / "b.surf.gii.gz")
    assert again.side == "right"
    np.testing.assert_array_equal(again.space.xform, CENTRE)
    np.testing.assert_array_equal(read_surface(tmp_path / "b.surf.gii.gz").vertices, surface.vertices)  # as stored


def test_freesurfers_volume_geometry_is_kept(tmp_path):
    geometry = {
        "head": np.array([2, 0, 20]),
        "valid": "1  # volume info valid",
        "filename": "orig.mgz",
        "volume": [256, 256, 256],
        "voxelsize": [1, 1, 1],
        "xras": [-1, 0, 0],
        "yras": [0, 0, -1],
        "zras": [0, 1, 0],
        "cras": [10, 20, 30],
    }
    vertices, faces = grid(3, 3)
    nibabel.freesurfer.write_geometry(tmp_path / "lh.pial", vertices, faces, volume_info=geometry)
    write_surface(tmp_path / "lh.open", read_surface(tmp_path / "lh.pial"), frame=frame_of(tmp_path / "lh.pial"))
    *_, kept = nibabel.freesurfer.read_geometry(tmp_path / "lh.open", read_metadata=True)
    assert kept["cras"].tolist() == [10, 20, 30] and kept["filename"] == "orig.mgz"
    assert frame_of(tmp_path / "lh.open").side == "left"


def test_labels_keep_their_names_and_colours(tmp_path):
    labels, table = np.array([0, 1, 2, -1, 1]), np.array([[25, 5, 25, 0, 0], [100, 20, 30, 0, 0], [20, 220, 60, 0, 0]])
    nibabel.freesurfer.write_annot(
        tmp_path / "lh.aparc.annot", labels, table, ["unknown", "insula", "cuneus"], fill_ctab=True
    )
    found = read_values(tmp_path / "lh.aparc.annot")
    np.testing.assert_array_equal(found, labels)
    write_values(tmp_path / "a.label.gii", found, side="left", labels=read_labels(tmp_path / "lh.aparc.annot"))
    image = nibabel.load(tmp_path / "a.label.gii")
    names = image.labeltable.get_labels_as_dict()
    assert names[1] == "insula" and names[2] == "cuneus"
    colour = next(label.rgba for label in image.labeltable.labels if label.key == 2)
    np.testing.assert_allclose(colour, np.array([20, 220, 60, 255]) / 255, atol=1e-6)
    assert image.meta["AnatomicalStructurePrimary"] == "CortexLeft"
    assert image.darrays[0].intent == nibabel.nifti1.intent_codes["NIFTI_INTENT_LABEL"]
    again = read_labels(tmp_path / "a.label.gii")
    assert again[1][0] == "insula"
    np.testing.assert_array_equal(read_values(tmp_path / "a.label.gii"), labels)


def test_whole_numbers_without_names_get_a_table(tmp_path):
    write_values(tmp_path / "a.label.gii", np.array([0, 7, 3, 7]))
    assert nibabel.load(tmp_path / "a.label.gii").labeltable.get_labels_as_dict() == {0: "???", 3: "3", 7: "7"}


def test_several_maps_stay_columns(tmp_path):
    maps = np.arange(12.0).reshape(4, 3)
    write_values(tmp_path / "a.func.gii", maps)
    assert len(nibabel.load(tmp_path / "a.func.gii").darrays) == 3
    np.testing.assert_array_equal(read_values(tmp_path / "a.func.gii"), maps)


def damaged(tmp_path, old, new):
    write_values(tmp_path / "v.shape.gii", np.arange(9.0))
    data = (tmp_path / "v.shape.gii").read_bytes()
    assert old in data
    (tmp_path / "v.shape.gii").write_bytes(data.replace(old, new))
    return tmp_path / "v.shape.gii"


@pytest.mark.parametrize("old, new, message", [
    (b'Dimensionality="1"', b'Dimensionality="2147483648"', "2147483648 dimensions"),
    (b'Dim0="9"', b'Dim0="8"', "32 bytes is announced, more are there"),
    (b'Dim0="9"', b'Dim0="10"', "40 bytes is announced, 36 are there"),
    (b'Dim0="9"', b'Dim0="1000000000"', "larger than the file can hold"),
    (b'"GZipBase64Binary"', b'"ExternalFileBinary"', "another file.*wb_command"),
    (b'"NIFTI_TYPE_FLOAT32"', b'"NIFTI_TYPE_QUAD"', "unknown type"),
    (b'"UTF-8"', b'"UTF-7777"', "unknown encoding"),
])  # fmt: skip
def test_sizes_that_are_not_true_are_refused(tmp_path, old, new, message):
    with pytest.raises(SurfaceError, match=f"v.shape.gii: .*{message}"):
        read_values(damaged(tmp_path, old, new))
