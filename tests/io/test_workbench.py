"""Workbench as the judge of what is written: it opens every file, knows what each is, and misses nothing."""

import re

import nibabel
import numpy as np
import pytest

from freesurfer import GEOMETRY
from known_surfaces import sphere
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.io.values import read_map, write_values
from workbench import unknown, workbench

BALL = sphere()
COUNT = len(BALL.vertices)


@pytest.fixture
def folder(tmp_path):
    for name, scale in (("pial", 50), ("white", 45), ("inflated", 60), ("sphere", 100)):
        shape = (tmp_path / f"lh.{name}", scale * BALL.vertices, BALL.faces)
        nibabel.freesurfer.write_geometry(*shape, volume_info=GEOMETRY)
    return tmp_path


@pytest.mark.parametrize("name, kind", [
    ("pial", ["Anatomical", "Pial"]), ("white", ["Anatomical", "GrayWhite"]),
    ("inflated", ["Inflated", "Midthickness"]), ("sphere", ["Spherical", "Invalid"]),
])  # fmt: skip
def test_surfaces_say_what_they_are(folder, name, kind):
    path = folder / "out.surf.gii"
    write_surface(path, read_surface(folder / f"lh.{name}"), frame=frame_of(folder / f"lh.{name}"))
    told = workbench("-file-information", path)
    assert re.findall(r"^Surface Type \(\w+\): +(\w+)", told, re.MULTILINE) == kind
    assert re.search("^Structure: +CortexLeft", told, re.MULTILINE)
    assert re.search("^Normal Vectors Correct: +true", told, re.MULTILINE)
    assert unknown(told) == (["Surface Type (Secondary)"] if name == "sphere" else [])
    centre = 3.5 if kind[0] == "Anatomical" else 0.0  # where FreeSurfer's header lays it
    low, high = (float(re.search(rf"^X-{end}: +(\S+)", told, re.MULTILINE)[1]) for end in ("minimum", "maximum"))
    assert (low + high) / 2 == pytest.approx(centre, abs=0.01)


@pytest.mark.parametrize("name", ["lh.a.shape.gii", "lh.a.func.gii"])
def test_maps_have_a_side_and_names_and_may_be_of_whole_numbers(folder, name):
    maps = np.stack([np.linspace(0, 1, COUNT), np.arange(COUNT) % 5 - 1], axis=1)
    for values in (maps, np.int64(5 * maps)):
        write_values(folder / name, values, names=["one", "two"])
        told = workbench("-file-information", folder / name)
        assert unknown(told) == [] and re.search(f"^Number of Vertices: +{COUNT}", told, re.MULTILINE)
        assert re.findall(r"(\w+) *$", told[told.index("Map Name") :].strip(), re.MULTILINE)[1:] == ["one", "two"]


@pytest.mark.parametrize("first", ["unknown", "insula"])
def test_labels_have_no_key_below_0(folder, first):
    """Of an annotation in which some vertices have none: nothing is merged, and what is none shows nothing."""
    table = np.array([[25, 5, 25, 0, 0], [100, 20, 30, 0, 0], [20, 220, 60, 0, 0]])
    names = [first, "cuneus", "lingual"]
    nibabel.freesurfer.write_annot(folder / "lh.a.annot", np.arange(COUNT) % 4 - 1, table, names, fill_ctab=True)
    write_values(folder / "lh.a.label.gii", *read_map(folder / "lh.a.annot"))
    told = workbench("-file-information", folder / "lh.a.label.gii")
    assert unknown(told) == []
    rows = re.findall(r"^ +(\d+) +(\S+) .* (\d\.\d+) *$", told[told.index("KEY") :], re.MULTILINE)
    regions = [name for name in names if name != "unknown"]
    assert rows == [("0", "???", "0.000"), *((str(k), name, "1.000") for k, name in enumerate(regions, 1))]
