"""Surfaces in every format: round trips, agreement with VTK and nibabel, one named error for a
damaged file, and the recipes for formats that are not read."""

import gzip
import hashlib
import re
from pathlib import Path

import nibabel
import numpy as np
import pytest
import pyvista

import qclearn as qc
from freesurfer import GEOMETRY
from known_surfaces import grid
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.io.values import read_mask
from qclearn.surfaces.surface import Surface, SurfaceError

EXACT = ["a.npz", "a.ply", "a.obj"]
SINGLE = ["a.gii", "a.surf.gii", "a.surf.gii.gz", "lh.pial", "rh.white", "lh.sphere.reg", "surface"]


@pytest.fixture
def tent():
    """A square pyramid without its base: irrational coordinates, numbered in the order of its
    faces."""
    vertices = np.pi * np.array([[0, 0, 1 / 3], [1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 1e-9]])
    return Surface(vertices, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], {"rim": [1, 2, 3], "a b": [4]})


def refused(path, *expected, read=read_surface, **options):
    with pytest.raises(SurfaceError) as caught:
        read(path, **options)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    for text in expected:
        assert text in str(caught.value)


def store(path, *lines):
    path.write_bytes("\n".join([*lines, ""]).encode())
    return path


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_round_trip(tmp_path, tent, name):
    write_surface(tmp_path / name, tent)
    back = read_surface(tmp_path / name)
    expected = tent.vertices if name in EXACT else tent.vertices.astype(np.float32)
    np.testing.assert_array_equal(back.vertices, expected)
    np.testing.assert_array_equal(back.faces, tent.faces)
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_npz_and_gifti_keep_the_original_vertex_numbers_and_npz_the_curves(tmp_path, tent):
    numbers = [9, 8, 7, 5, 2]
    for name in ("a.npz", "a.gii", "a.ply"):
        write_surface(tmp_path / name, tent, original_vertices=numbers)
        again = read_surface(tmp_path / name)
        assert again.faces.tolist() == tent.faces.tolist()
        if name != "a.ply":
            assert again.original_vertices.tolist() == numbers
            write_surface(tmp_path / f"b{name}", again)
            assert read_surface(tmp_path / f"b{name}").original_vertices.tolist() == numbers
    assert again.original_vertices is None
    with np.load(tmp_path / "a.npz") as file:
        np.savez(tmp_path / "b.npz", **file, depth=np.zeros(5))  # which is not ours
    curves = read_surface(tmp_path / "b.npz").curves
    assert {name: curve.tolist() for name, curve in curves.items()} == {"rim": [1, 2, 3], "a b": [4]}
    image = nibabel.load(tmp_path / "a.gii")
    image.darrays[0].meta["QclearnOriginalVertices"] = "eJxjYAACAAAFAAE="  # five bytes
    (tmp_path / "c.gii").write_bytes(image.to_bytes())
    refused(tmp_path / "c.gii", "does not hold the numbers of 5 vertices")


@pytest.mark.parametrize("name", ["a.npz", "a.gii", "a.ply", "a.obj", "lh.pial"])
def test_a_surface_is_known_by_one_hash_in_every_format(tmp_path, tent, name):
    odd = Surface(tent.vertices / 3 * [1, 1, -1], tent.faces)  # thirds are no float32, and there are negative zeros
    write_surface(tmp_path / name, odd)
    stored = (np.float32(odd.vertices) + 0).astype("<f4").tobytes() + odd.faces.astype("<i8").tobytes()
    assert read_surface(tmp_path / name).fingerprint == {"vertices": 5, "sha256": hashlib.sha256(stored).hexdigest()}
    assert read_surface(tmp_path / name).fingerprint != tent.fingerprint


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_a_file_cut_short_is_refused_wherever_it_is_cut(tmp_path, tent, name):
    """Or it is read whole, where all that is missing is what no surface needs (a line break)."""
    write_surface(tmp_path / name, tent)
    whole = read_surface(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    lengths = [*range(0, len(data), max(len(data) // 50, 1)), *range(len(data) - 12, len(data))]
    read = 0
    for length in lengths:
        (tmp_path / name).write_bytes(data[:length])
        try:
            cut = read_surface(tmp_path / name)
        except SurfaceError as error:
            assert str(error).startswith(f"{tmp_path / name}: ")
        else:
            read += 1
            np.testing.assert_array_equal(cut.faces, whole.faces)
            np.testing.assert_array_equal(cut.vertices, whole.vertices)
    assert read < 0.4 * len(lengths)


def test_freesurfer_and_gifti_agree_with_nibabel(tmp_path, tent):
    write_surface(tmp_path / "lh.pial", tent)
    write_surface(tmp_path / "a.surf.gii", tent)
    vertices, faces = nibabel.freesurfer.read_geometry(tmp_path / "lh.pial")
    image = nibabel.load(tmp_path / "a.surf.gii")
    for points, triangles in ((vertices, faces), image.agg_data(("pointset", "triangle"))):
        np.testing.assert_array_equal(points, tent.vertices.astype(np.float32))
        np.testing.assert_array_equal(triangles, tent.faces)


@pytest.mark.parametrize("name", ["a.ply", "a.obj"])
@pytest.mark.parametrize("binary", [True, False])
def test_files_agree_with_vtk_in_both_directions(tmp_path, tent, name, binary):
    write_surface(tmp_path / name, tent)
    theirs = pyvista.read(tmp_path / name)
    np.testing.assert_allclose(theirs.points, tent.vertices, atol=1e-6)
    np.testing.assert_array_equal(theirs.regular_faces, tent.faces)
    theirs.save(tmp_path / f"theirs-{name}", **({} if name == "a.obj" else {"binary": binary}))
    ours = read_surface(tmp_path / f"theirs-{name}")
    np.testing.assert_allclose(ours.vertices, tent.vertices, atol=1e-5)
    np.testing.assert_array_equal(ours.faces, tent.faces)


@pytest.mark.parametrize("path", ["/data/run=1/orig.mgz", "/data/M\xfcller/orig.mgz", "orig.mgz\0\x10 = 7"])
def test_freesurfer_is_known_by_its_content_and_may_hold_any_letters(tmp_path, tent, path):
    """Latin-1 of an old machine, = and what stands behind a NUL; coordinates come as stored."""
    file = tmp_path / "lh.pial.T1"
    nibabel.freesurfer.write_geometry(file, tent.vertices, tent.faces, "created by JOSE", GEOMETRY)
    data = file.read_bytes().replace(b"JOSE", b"Jos\xe9").replace(b"= orig.mgz", b"= " + path.encode("latin-1"))
    file.write_bytes(data)
    np.testing.assert_array_equal(read_surface(file).vertices, tent.vertices.astype(np.float32))
    frame = frame_of(file)
    assert frame.volume["filename"] == path.partition("\0")[0] and frame.volume["cras"] == GEOMETRY["cras"]
    write_surface(tmp_path / "lh.again", tent, frame=frame)
    assert frame_of(tmp_path / "lh.again").volume == frame.volume
    file.write_bytes(data[: data.index(b"zras")])
    refused(file, "volume geometry is incomplete", read=frame_of)


PLY = (
    "ply", "format ascii 1.0", "comment by hand", "element vertex 3", "property float x", "property uchar red",
    "property float y", "property double z", "element face 1", "property int label",
)  # fmt: skip
POINTS = ("1 255 2 3", "4 255 5 7", "7 255 8 9")
CORNERS = ("property list uchar uint vertex_indices", "end_header", *POINTS)
TEXTURE = ("property list uchar float tex", "property list uchar int vertex_index")
EDGE = ("element edge 1", "property int from", "end_header", *POINTS)
SQUARE = ("# a comment", "o name", "v 0 0 0 1.0", "v 1 0 0", "vt 0 0", "vn 0 0 1", "v 0 1 0", "", "v 1 1 0")
PLY_POINTS = [[1, 2, 3], [4, 5, 7], [7, 8, 9]]
OBJ_POINTS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]


@pytest.mark.parametrize("name, lines, vertices, faces", [
    ("a.ply", (*PLY, *CORNERS, "6 3 2 0 1"), PLY_POINTS, [[2, 0, 1]]),
    ("a.ply", (*PLY, *TEXTURE, *EDGE, "6 2 0.5 0.25 3 2 0 1", "1"), PLY_POINTS, [[2, 0, 1]]),
    *[("a.obj", (*SQUARE, face, "f 2 4 3"), OBJ_POINTS, [[0, 1, 2], [1, 3, 2]])
      for face in ("f 1/1/1 2/1/1 3/1/1", "f 1//1 2//1 3//1", "f -4 -3 -2")],
])  # fmt: skip
def test_text_of_other_programs_with_further_properties(tmp_path, name, lines, vertices, faces):
    surface = read_surface(store(tmp_path / name, *lines))
    assert surface.vertices.tolist() == vertices and surface.faces.tolist() == faces


@pytest.mark.parametrize("lines, words", [
    ((*PLY, "end_header", *"147"), "early end-of-line"),
    ((*PLY, "end_header", *POINTS, "6"), "lacks vertices with x, y, z, or faces with a list vertex_indices"),
    *[((*PLY, *CORNERS, f"6 {corners}"), "") for corners in ("3 2 0 1.5", "3 2 0 -1", "3 2 0 99999999999")],
    ((*PLY, *CORNERS, "6 4 2 0 1 0"), "face 0 has 4 corners"),
    *[([line.replace(old, new) for line in (*PLY, *CORNERS, "6 3 2 0 1")], "") for old, new in (
        ("face 1", "face -128"), ("face 1", "vertex 5"), ("face 1", "face 400"), ("element vertex 3", "property int q"),
        ("float x", "quad x"), ("uchar uint", "uchar float"), ("ascii 1", "ascii 2"),
    )],
])  # fmt: skip
def test_text_of_ply_that_is_no_mesh_is_refused(tmp_path, lines, words):
    refused(store(tmp_path / "a.ply", *lines), "not a readable PLY file", words, "again")


def test_ply_of_other_machines(tmp_path, tent):
    """Comments of any letters, line ends of Windows, the other byte order."""
    write_surface(tmp_path / "a.ply", tent)
    header, end, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    faces = np.array([(3, face) for face in tent.faces], dtype=[("sides", "u1"), ("corners", ">i4", (3,))])
    turned = header.replace(b"little", b"big") + end + tent.vertices.astype(">f8").tobytes() + faces.tobytes()
    files = [turned]
    for comment in ("größe".encode(), b"gr\xf6\xdfe", b"plain"):
        for line_end in (b"\n", b"\r\n"):
            changed = (header.replace(b"comment qclearn", b"comment " + comment) + end).replace(b"\n", line_end)
            files.append(changed + body)
    for data in files:
        (tmp_path / "b.ply").write_bytes(data)
        np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").vertices, tent.vertices)
        np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").faces, tent.faces)


def test_curves_with_names_that_cannot_be_shown_are_neither_read_nor_written(tmp_path, tent):
    for name in ("\x1b]0;x", "A" * 300):
        np.savez(tmp_path / "a.npz", vertices=tent.vertices, faces=tent.faces, **{f"curve_{name}": [1, 2]})
        refused(tmp_path / "a.npz", "too long or holds control characters", "rename")
    for name in ("a\tb", "M\udcfcller"):
        with pytest.raises(SurfaceError, match="b.npz: has a curve whose name is too long or holds control"):
            write_surface(tmp_path / "b.npz", Surface(tent.vertices, tent.faces, {name: [1, 2]}))
    assert [file.name for file in tmp_path.iterdir()] == ["a.npz"]


def test_freesurfer_counts_that_lie_are_refused(tmp_path, tent):
    write_surface(tmp_path / "lh.pial", tent)
    data = (tmp_path / "lh.pial").read_bytes()
    place = data.index(b"\n\n") + 2
    for counts in (b"\x7f\xff\xff\xff\0\0\0\4", b"\0\0\0\5\x7f\xff\xff\xff", b"\xff\xff\xff\xff\0\0\0\4"):
        (tmp_path / "lh.pial").write_bytes(data[:place] + counts + data[place + 8 :])
        refused(tmp_path / "lh.pial", "records are announced")


QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)


def test_faces_that_are_no_triangles_are_refused(tmp_path):
    pyvista.PolyData(QUAD, faces=[4, 0, 1, 2, 3]).save(tmp_path / "a.ply")
    refused(tmp_path / "a.ply", "face 0 has 4 corners", "triangulate")
    corners = [" ".join(map(str, row)) for row in QUAD]
    path = store(tmp_path / "a.obj", *(f"v {row}" for row in corners), "f 1 2 3", "f 1 3 4 2")
    refused(path, "face 1 has 4 corners", "triangulate")
    np.savez(tmp_path / "a.npz", vertices=QUAD, faces=[[0, 1, 2, 3]])
    refused(tmp_path / "a.npz", "(1, 4)", "triangles")
    (tmp_path / "lh.quad").write_bytes(b"\xff\xff\xff" + bytes(60))
    refused(tmp_path / "lh.quad", "quadrangles", "mris_convert")


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_content_of_another_kind_is_refused(tmp_path, name):
    for content in (b"not a surface\n" * 20, b"\xff\xff\xfe" + bytes(300), bytes(range(256)) * 3):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name)
    (tmp_path / name).write_bytes(b"")
    refused(tmp_path / name, "empty", "again") if name[-2:] != "gz" else refused(tmp_path / name)


@pytest.mark.parametrize("name", ["a.vtk", "a.vtp", "lh.pial.stl", "a.OFF"])
def test_a_format_that_went_names_the_way_to_a_surface(tmp_path, tent, name):
    way = "trimesh.load" if name == "a.OFF" else "pyvista.read"
    refused(store(tmp_path / name, "solid"), f"{Path(name).suffix.lower()} went with version 0.3: m = {way}(path")
    (tmp_path / name).unlink()
    refused(tmp_path / name, "went with version 0.3", read=write_surface, surface=tent)
    assert not list(tmp_path.iterdir())


def test_mnis_obj_is_read_by_the_lines_on_the_page_of_files(tmp_path, monkeypatch):
    """One colour, one a face, one a vertex; several numbers a line, or one."""
    page = Path(__file__).parents[2] / "book" / "files.md"
    lines = re.search(r"```python\n(words = .*?)```", page.read_text("utf-8"), re.DOTALL)[1]
    vertices, faces = grid(3, 3)
    points, corners = (" ".join(map(str, array.ravel().tolist())) for array in (vertices, faces))
    ends = " ".join(map(str, 3 + 3 * np.arange(len(faces))))
    monkeypatch.chdir(tmp_path)
    for kind, colours in enumerate([1, len(faces), len(vertices)]):
        text = f"P 0.3 0.3 0.4 10 1 {len(vertices)}\n{points}\n\n{points}\n\n {len(faces)}\n {kind} "
        text += f"{' '.join(['0 1 0 1'] * colours)}\n\n{ends}\n\n{corners}\n"
        for content in (text, text.replace(" ", "\n")):
            (tmp_path / "lh.obj").write_text(content)
            known = {"np": np, "qc": qc, "Path": Path}
            exec(lines, known)
            np.testing.assert_array_equal(known["surface"].vertices, vertices)
            np.testing.assert_array_equal(known["surface"].faces, faces)
    refused(tmp_path / "lh.obj", "MNI's .obj went with version 0.3", "eight lines")


@pytest.mark.parametrize("name", ["a.vtk", "a.vtp", "a.stl", "a.off"])
def test_the_recipes_for_other_formats_keep_the_vertex_numbers(tmp_path, name):
    """Of a shuffled mesh, vertex by vertex; STL has none, and keeps its triangles."""
    vertices, faces = grid(5, 4)
    order = np.random.default_rng(3).permutation(len(vertices))
    shuffled = pyvista.PolyData.from_regular_faces(vertices[order], np.argsort(order)[faces])
    path = tmp_path / name
    if name == "a.off":
        trimesh = pytest.importorskip("trimesh", reason="trimesh comes with the extra test")
        trimesh.Trimesh(shuffled.points, shuffled.regular_faces, process=False).export(path)
        m = trimesh.load(path, process=False)
        surface = Surface(m.vertices, m.faces)
    else:
        shuffled.save(path)
        m = pyvista.read(path)
        m = (m.clean() if name == "a.stl" else m).triangulate()
        surface = Surface(m.points, m.regular_faces)
    if name == "a.stl":
        np.testing.assert_allclose(surface.vertices[surface.faces], vertices[faces], atol=1e-6)
        assert len(surface.vertices) == len(vertices)
    else:
        np.testing.assert_allclose(surface.vertices, vertices[order], atol=1e-6)
        np.testing.assert_array_equal(surface.faces, np.argsort(order)[faces])


def test_missing_files_folders_and_unknown_formats(tmp_path, tent):
    refused(tmp_path / "none.ply", "No such file", "check the name")
    refused(tmp_path, "Is a directory")
    refused(store(tmp_path / "a.stp", "ISO-10303-21"), ".ply", "FreeSurfer", "mris_convert")
    for name in ("a.stp", "a.mgz", "pial.txt"):
        with pytest.raises(SurfaceError, match="suffix.*FreeSurfer.*lh.pial"):
            write_surface(tmp_path / name, tent)
    assert [file.name for file in tmp_path.iterdir()] == ["a.stp"]


def test_a_file_without_a_sound_surface_names_what_is_wrong(tmp_path, tent):
    np.savez(tmp_path / "a.npz", vertices=tent.vertices)
    refused(tmp_path / "a.npz", "lacks the array faces")
    np.savez(tmp_path / "a.npz", vertices=tent.vertices, faces=np.array([{}, None]))
    refused(tmp_path / "a.npz", "npz file")
    np.savez(tmp_path / "a.npz", vertices=tent.vertices * [1, np.nan, 1], faces=tent.faces)
    refused(tmp_path / "a.npz", "NaN or infinite coordinates: 0")
    values = nibabel.gifti.GiftiDataArray(np.zeros(5, dtype=np.float32), intent="NIFTI_INTENT_SHAPE")
    nibabel.GiftiImage(darrays=[values]).to_filename(tmp_path / "a.shape.gii")
    refused(tmp_path / "a.shape.gii", "not one surface", ".surf.gii")


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_folders_that_cannot_be_written(tmp_path, tent, name):
    (tmp_path / "file").write_text("")
    (tmp_path / "taken" / name).mkdir(parents=True)
    for folder in ("missing", "file", "taken"):
        with pytest.raises(SurfaceError, match="cannot be written.*exists and is writable") as caught:
            write_surface(tmp_path / folder / name, tent)
        assert str(caught.value).startswith(str(tmp_path / folder / name))
    for factor in (1, 2):  # a file that is there is replaced, and has ordinary permissions
        write_surface(str(tmp_path / name), Surface(factor * tent.vertices, tent.faces))
    np.testing.assert_allclose(read_surface(str(tmp_path / name)).vertices, 2 * tent.vertices, atol=1e-6)
    assert (tmp_path / name).stat().st_mode == (tmp_path / "file").stat().st_mode
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(["file", "taken", name, name])


WALL = np.array([0, 0, 3, 0.5, 0])


def label(path, indices, announced=None):
    rows = [f"{index}  0.0  0.0  0.0 0.5" for index in indices]
    return store(path, "#!ascii label , from subject", str(len(indices) if announced is None else announced), *rows)


def values(name, path, array):
    if name.endswith(".npy"):
        np.save(path, array)
    elif name.endswith(".txt"):
        np.savetxt(path, array)
    elif ".gii" in name:
        gifti = nibabel.GiftiImage(darrays=[nibabel.gifti.GiftiDataArray(array.astype(np.float32))]).to_bytes()
        path.write_bytes(gzip.compress(gifti) if name.endswith(".gz") else gifti)
    else:
        nibabel.freesurfer.write_morph_data(path, array)
    return path


@pytest.mark.parametrize("name", ["a.npy", "a.txt", "a.shape.gii", "a.func.gii.gz", "lh.thickness"])
def test_masks_of_one_value_a_vertex(tmp_path, tent, name):
    path = values(name, tmp_path / name, WALL)
    assert read_mask(path, tent).tolist() == [False, False, True, True, False]
    assert read_mask(path, tent, keep=True).tolist() == [True, True, False, False, True]
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, "again", read=read_mask, surface=tent)
    refused(values(name, path, WALL[:4]), "(4,)", "5 vertices", "belongs", read=read_mask, surface=tent)
    bad = values(name, path, np.array([0, np.nan, 1, 0, 0]))
    refused(bad, "NaN", "the first 1", read=read_mask, surface=tent)


def test_masks_from_a_label(tmp_path, tent):
    path = label(tmp_path / "lh.Medial_wall.label", [3, 1])
    assert read_mask(path, tent).tolist() == [False, True, False, True, False]
    assert read_mask(path, tent, keep=True).tolist() == [True, False, True, False, True]
    assert not read_mask(label(path, []), tent).any()
    assert read_mask(label(path, [2]), tent).sum() == 1
    path = label(tmp_path / "lh.cortex.label", [0, 1, 2])
    refused(path, "would cut 3 of 5 vertices", "keep=True", "--keep", read=read_mask, surface=tent)
    assert read_mask(path, tent, keep=True).tolist() == [False, False, False, True, True]


def test_labels_of_another_surface_or_cut_short_are_refused(tmp_path, tent):
    path = tmp_path / "a.label"
    refused(path, "No such file", read=read_mask, surface=tent)
    refused(label(path, [1, 7]), "do not exist", "7", "5 vertices", read=read_mask, surface=tent)
    refused(label(path, [1], announced=2), "2 vertex records", "1 are there", read=read_mask, surface=tent)
    refused(label(path, [1, 2], announced=1), "1 vertex records", "2 are there", read=read_mask, surface=tent)
    for lines in (["#!ascii label"], ["#!ascii label", "1", "1.7 0 0 0 0"]):
        refused(store(path, *lines), "not a readable FreeSurfer label", read=read_mask, surface=tent)
