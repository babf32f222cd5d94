"""Surfaces in every format: round trips, agreement with VTK and nibabel, one named error for a damaged file."""

import hashlib
import re
from contextlib import nullcontext
from pathlib import Path

import nibabel
import numpy as np
import pytest
import pyvista
from nibabel.freesurfer import read_geometry
from nilearn.surface import load_surf_mesh

import qclearn as qc
from freesurfer import GEOMETRY
from known_surfaces import grid
from qclearn.io.frames import Frame
from qclearn.io.meshes import frame_of, read_surface, write_surface
from qclearn.io.safe import LeftOutWarning
from qclearn.io.values import read_mask, write_values
from qclearn.surfaces.surface import Surface, SurfaceError

EXACT = ["a.npz", "a.ply", "a.obj"]
SINGLE = ["a.gii", "a.surf.gii", "a.surf.gii.gz", "lh.pial", "rh.white", "lh.sphere.reg", "surface"]
each = pytest.mark.parametrize("name", EXACT + SINGLE)

# A square pyramid without its base: irrational coordinates, numbered in the order of its faces.
POINTS_OF_TENT = np.pi * np.array([[0, 0, 1 / 3], [1, 1, -0.0], [-1, 1, 0], [-1, -1, 0], [1, -1, 1e-9]])
TENT = Surface(POINTS_OF_TENT, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], {"rim": [1, 2, 3], "a b": [4]})


def refused(path, *expected, read=read_surface, **options):
    with pytest.raises(SurfaceError) as caught:
        read(path, **options)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    for text in expected:
        assert text in str(caught.value)


def store(path, *lines):
    path.write_bytes("\n".join([*lines, ""]).encode())
    return path


@each
def test_a_surface_comes_back_and_is_known_by_one_hash(tmp_path, name):
    """It takes the place of an old file, with ordinary permissions; a folder that cannot be written is named."""
    (tmp_path / "plain").touch()
    for factor in (2, 1):
        write_surface(str(tmp_path / name), Surface(factor * TENT.vertices, TENT.faces, TENT.curves))
    back = read_surface(str(tmp_path / name))
    np.testing.assert_array_equal(back.vertices, TENT.vertices if name in EXACT else np.float32(TENT.vertices))
    np.testing.assert_array_equal(back.faces, TENT.faces)
    stored = (np.float32(TENT.vertices) + 0).astype("<f4").tobytes() + TENT.faces.astype("<i8").tobytes()
    assert back.fingerprint == {"vertices": 5, "sha256": hashlib.sha256(stored).hexdigest()}
    assert back.fingerprint != Surface(2 * TENT.vertices, TENT.faces).fingerprint
    assert (tmp_path / name).stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "taken" / name).mkdir(parents=True)
    for folder in ("missing", "plain", "taken"):
        path = tmp_path / folder / name
        refused(path, "cannot be written", "exists and is writable", read=write_surface, surface=TENT)
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(["plain", "taken", name, name])


def test_foreign_arrays_of_an_npz_are_left_out_and_a_table_of_another_count_is_refused(tmp_path):
    for name in ("a.npz", "a.gii"):
        write_surface(tmp_path / name, TENT, original_vertices=[9, 8, 7, 5, 2])
    with np.load(tmp_path / "a.npz") as file:
        np.savez(tmp_path / "b.npz", **file, depth=np.zeros(5))  # which is not ours
    curves = read_surface(tmp_path / "b.npz").curves
    assert {name: curve.tolist() for name, curve in curves.items()} == {"rim": [1, 2, 3], "a b": [4]}
    image = nibabel.load(tmp_path / "a.gii")
    image.darrays[0].meta["QclearnOriginalVertices"] = "eJxjYAACAAAFAAE="  # five bytes
    (tmp_path / "c.gii").write_bytes(image.to_bytes())
    refused(tmp_path / "c.gii", "does not hold the numbers of 5 vertices")


@each
def test_a_file_cut_short_or_of_another_kind_is_refused(tmp_path, name):
    """Or it is read whole, where all that is missing is what no surface needs (a line break)."""
    path, read = tmp_path / name, 0
    write_surface(path, TENT)
    whole, data = read_surface(path), path.read_bytes()
    lengths = [*range(0, len(data), max(len(data) // 50, 1)), *range(len(data) - 12, len(data))]
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
    for content in (b"not a surface\n" * 20, b"\xff\xff\xfe" + bytes(300), bytes(range(256)) * 3, b""):
        path.write_bytes(content)
        refused(path, *(() if content or name.endswith("gz") else ("empty", "again")))


@pytest.mark.parametrize("name, options", [
    ("a.ply", {"binary": True}), ("a.ply", {"binary": False}), ("a.obj", {}), ("lh.pial", read_geometry),
    ("a.surf.gii", load_surf_mesh),
])  # fmt: skip
def test_files_agree_with_vtk_in_both_directions_and_with_nibabel(tmp_path, name, options):
    write_surface(tmp_path / name, TENT)
    if callable(options):
        points, faces = options(tmp_path / name)
    else:
        theirs = pyvista.read(tmp_path / name)
        points, faces = theirs.points, theirs.regular_faces
        theirs.save(tmp_path / f"theirs-{name}", **options)
        ours = read_surface(tmp_path / f"theirs-{name}")
        np.testing.assert_allclose(ours.vertices, TENT.vertices, atol=1e-5)
        np.testing.assert_array_equal(ours.faces, TENT.faces)
    np.testing.assert_allclose(points, TENT.vertices, atol=1e-6)
    np.testing.assert_array_equal(faces, TENT.faces)


@pytest.mark.parametrize("path", ["/data/run=1/orig.mgz", "/data/M\xfcller/orig.mgz", "orig.mgz\0\x10 = 7"])
def test_freesurfer_is_known_by_its_content_and_may_hold_any_letters(tmp_path, path):
    """Latin-1 of an old machine, = and what stands behind a NUL; coordinates come as stored."""
    file = tmp_path / "lh.pial.T1"
    nibabel.freesurfer.write_geometry(file, TENT.vertices, TENT.faces, "created by JOSE", GEOMETRY)
    data = file.read_bytes().replace(b"JOSE", b"Jos\xe9").replace(b"= orig.mgz", b"= " + path.encode("latin-1"))
    file.write_bytes(data)
    np.testing.assert_array_equal(read_surface(file).vertices, TENT.vertices.astype(np.float32))
    frame = frame_of(file)
    assert frame.volume["filename"] == path.partition("\0")[0] and frame.volume["cras"] == GEOMETRY["cras"]
    write_surface(tmp_path / "lh.again", TENT, frame=frame)
    assert frame_of(tmp_path / "lh.again").volume == frame.volume
    for name, header in (("lh.one", b"\n"), ("lh.pial.img", b"\non Monday\n")):  # lines of other programs
        (tmp_path / name).write_bytes(data.replace(b"\n\n", header, 1))
        np.testing.assert_array_equal(read_surface(tmp_path / name).vertices, TENT.vertices.astype(np.float32))
        assert frame_of(tmp_path / name).volume == frame.volume
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
      for face in ("f 1/1/1 2/1/1 3/1/1", "f 1//1 2//1 3//1", "f -4 -3 -2", "f 1 2 \\\n3", "f 1 2 3 # 1")],
    ("a.obj", ("\ufeffv 0 0 0", *SQUARE[3:-1], "v 1 1 \\ ", " 0", "f 1 2 3", "f 2 4 3"), OBJ_POINTS,
     [[0, 1, 2], [1, 3, 2]]),
])  # fmt: skip
def test_text_of_other_programs_with_further_properties(tmp_path, name, lines, vertices, faces):
    store(tmp_path / name, *lines)
    for line_end in (b"\n", b"\r\n", b"\r")[: 3 if name == "a.obj" else 1]:
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes().replace(b"\n", line_end))
        surface = read_surface(tmp_path / name)
        assert surface.vertices.tolist() == vertices and surface.faces.tolist() == faces


PLY_REFUSED = [
    ((*PLY, "end_header", *"147"), "early end-of-line"),
    ((*PLY, "end_header", *POINTS, "6"), "lacks vertices with x, y, z, or faces with a list vertex_indices"),
    *[((*PLY, *CORNERS, f"6 {corners}"), "") for corners in ("3 2 0 1.5", "3 2 0 -1", "3 2 0 99999999999")],
    ((*PLY, *CORNERS, "6 4 2 0 1 0"), "face 0 has 4 corners"), ((*PLY, *CORNERS, "6 4 2 0 1 0"), "triangulate"),
    *[([line.replace(old, new) for line in (*PLY, *CORNERS, "6 3 2 0 1")], "") for old, new in (
        ("face 1", "face -128"), ("face 1", "vertex 5"), ("face 1", "face 400"), ("element vertex 3", "property int q"),
        ("float x", "quad x"), ("uchar uint", "uchar float"), ("ascii 1", "ascii 2"),
    )],
]  # fmt: skip
SOUND = {"vertices": TENT.vertices, "faces": TENT.faces}
COUNTS = (b"\x7f\xff\xff\xff\0\0\0\4", b"\0\0\0\5\x7f\xff\xff\xff", b"\xff\xff\xff\xff\0\0\0\4")


@pytest.mark.parametrize("name, content, words", [
    *[("a.ply", lines, ("not a readable PLY file", words, "again")) for lines, words in PLY_REFUSED],
    ("a.obj", (*SQUARE, "f 1 2 3", "f 1 3 4 2"), ("face 1 has 4 corners", "triangulate")),
    *[("a.obj", (line, *SQUARE, "f 1 2 3"), ("no OBJ has a line", line[1:])) for line in ("\u200bv 0 0 0", "v 1 2")],
    ("a.npz", SOUND | {"faces": [[0, 1, 2, 3]]}, ("(1, 4)", "triangles")),
    ("a.npz", {"vertices": TENT.vertices}, ("lacks the array faces",)),
    ("a.npz", SOUND | {"faces": np.array([{}, None])}, ("npz file",)),
    ("a.npz", SOUND | {"vertices": TENT.vertices * [1, np.nan, 1]}, ("NaN or infinite coordinates: 0",)),
    *[("a.npz", SOUND | {f"curve_{curve}": [1, 2]}, ("too long or holds control characters", "rename"))
      for curve in ("\x1b]0;x", "A" * 300)],
    *[("lh.pial", b"\xff\xff\xfeby hand\n\n" + counts + bytes(108), ("records are announced",)) for counts in COUNTS],
    ("a.stp", ("ISO-10303-21",), (".ply", "FreeSurfer", "mris_convert")),
    ("none.ply", None, ("No such file", "check the name")), ("", None, ("Is a directory",)),
])  # fmt: skip
def test_a_file_without_a_sound_surface_says_what_is_wrong(tmp_path, name, content, words):
    if isinstance(content, dict):
        np.savez(tmp_path / name, **content)
    elif content is not None:
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else "\n".join(content).encode())
    refused(tmp_path / name, *words)


TURN = np.diag([-1.0, -1, 1, 1]) + 5 * np.eye(4, k=3)
PLAIN, SPACES = b"comment qclearn", b"<DataSpace>NIFTI_XFORM_%s</DataSpace>"


@pytest.mark.parametrize("name, old, new, turned", [
    ("a.obj", b"# qclearn", b"# 3D Slicer output. SPACE=LPS\n# qclearn", True),
    ("a.obj", b"# qclearn", b"# 3D Slicer output. SPACE=RAS\n# once in LPS\n# qclearn", False),
    ("a.ply", PLAIN, b"comment 3D Slicer output. SPACE=LPS", True),
    ("a.ply", PLAIN, b"comment space: left-posterior-superior", True), ("a.ply", PLAIN, b"comment LPS", False),
    ("a.gii", b"<MetaData />", b"<MetaData><MD><Name>SPACE</Name><Value>LPS</Value></MD></MetaData>", True),
    ("a.gii", SPACES % b"SCANNER_ANAT", b"<DataSpace>LPS</DataSpace>", True),
    ("a.gii", SPACES % b"SCANNER_ANAT", SPACES % b"UNKNOWN", True), ("a.gii", b"-1.0", b"1.0", False),
])  # fmt: skip
def test_a_file_that_says_it_is_in_lps_is_turned_with_a_word(tmp_path, name, old, new, turned):
    """Also by a matrix that leads into the scanner's space; nothing is turned twice."""
    path = tmp_path / name
    matrix = TURN if old in (SPACES % b"SCANNER_ANAT", b"-1.0") else np.eye(4)
    write_surface(path, TENT, frame=Frame(space=nibabel.gifti.GiftiCoordSystem(1, 1, matrix)))
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new))
    with (
        pytest.warns(LeftOutWarning, match=f"{name}: says that it is in LPS: x and y are negated")
        if turned
        else nullcontext()
    ):
        back = read_surface(path)
    np.testing.assert_allclose(back.vertices, TENT.vertices * ([-1, -1, 1] if turned else 1), rtol=1e-6)
    if new == SPACES % b"UNKNOWN":
        np.testing.assert_array_equal(frame_of(path).space.xform, np.eye(4) + 5 * np.eye(4, k=3))
    if new.startswith(b"#"):
        path.write_bytes(b"# SPACE=LPS, space=RAS\n" + path.read_bytes())
        refused(path, "says that it is in LPS and in RAS")


@pytest.mark.parametrize("name, words", [
    *[(name, ("suffix", "FreeSurfer", "lh.pial")) for name in ("a.stp", "a.mgz", "pial.txt")],
    ("b.npz", ("has a curve whose name is too long or holds control",)),
])  # fmt: skip
def test_what_cannot_be_read_again_is_not_written(tmp_path, name, words):
    for curve in ("a\tb", "M\udcfcller"):
        refused(tmp_path / name, *words, read=write_surface, surface=Surface(TENT.vertices, TENT.faces, {curve: [1]}))
    assert not list(tmp_path.iterdir())


def test_ply_of_other_machines(tmp_path):
    """Comments of any letters, line ends of Windows, the other byte order."""
    write_surface(tmp_path / "a.ply", TENT)
    header, end, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    faces = np.array([(3, face) for face in TENT.faces], dtype=[("sides", "u1"), ("corners", ">i4", (3,))])
    turned = header.replace(b"little", b"big") + end + TENT.vertices.astype(">f8").tobytes() + faces.tobytes()
    files = [turned]
    for comment in ("größe".encode(), b"gr\xf6\xdfe", b"plain"):
        for line_end in (b"\n", b"\r\n"):
            changed = (header.replace(b"comment qclearn", b"comment " + comment) + end).replace(b"\n", line_end)
            files.append(changed + body)
    for data in files:
        (tmp_path / "b.ply").write_bytes(data)
        np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").vertices, TENT.vertices)
        np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").faces, TENT.faces)


@pytest.mark.parametrize("name", ["a.vtk", "a.vtp", "lh.pial.stl", "a.OFF"])
def test_a_format_that_went_names_the_way_to_a_surface(tmp_path, name):
    way = "trimesh.load" if name == "a.OFF" else "pyvista.read"
    refused(store(tmp_path / name, "solid"), f"{Path(name).suffix.lower()} went with version 0.3: m = {way}(path")
    (tmp_path / name).unlink()
    refused(tmp_path / name, "went with version 0.3", read=write_surface, surface=TENT)
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


@pytest.mark.parametrize("name", ["a.npy", "a.shape.gii", "lh.thickness"])
def test_masks_of_one_value_a_vertex(tmp_path, name):
    path, wall = tmp_path / name, np.array([0, 0, 3, 0.5, 0])
    write_values(path, wall)
    assert read_mask(path, TENT).tolist() == [False, False, True, True, False]
    assert read_mask(path, TENT, keep=True).tolist() == [True, True, False, False, True]
    for bad, words in (
        (wall[:4], ("(4,)", "5 vertices", "belongs")),
        (wall * [1, np.nan, 1, 0, 0], ("NaN", "the first 1")),
    ):
        write_values(path, bad)
        refused(path, *words, read=read_mask, surface=TENT)
    path.write_bytes(path.read_bytes()[:-3])
    refused(path, "again", read=read_mask, surface=TENT)


def label(path, count, *indices):
    return store(path, "#!ascii label , from subject", count, *(f"{k}  0.0  0.0  0.0 0.5" for k in indices))


def test_masks_from_a_label(tmp_path):
    path = label(tmp_path / "lh.Medial_wall.label", "2", 3, 1)
    assert read_mask(path, TENT).tolist() == [False, True, False, True, False]
    assert read_mask(path, TENT, keep=True).tolist() == [True, False, True, False, True]
    for header in (["2"], ["# one", "#", "2"]):  # as FreeSurfer reads it, too
        assert read_mask(store(path, *header, "3 0 0 0 0", "1 0 0 0 0"), TENT).sum() == 2
    assert not read_mask(label(path, "0"), TENT).any() and read_mask(label(path, "1", 2), TENT).sum() == 1
    path = label(tmp_path / "lh.cortex.label", "3", 0, 1, 2)
    refused(path, "would cut 3 of 5 vertices", "keep=True", "--keep", read=read_mask, surface=TENT)
    assert read_mask(path, TENT, keep=True).tolist() == [False, False, False, True, True]


@pytest.mark.parametrize("count, indices, words", [
    ("2", (1, 7), ("do not exist", "7", "5 vertices")), ("2", (1,), ("2 vertex records", "1 are there")),
    ("1", (1, 2), ("1 vertex records", "2 are there")), ("", (), ("not a readable FreeSurfer label",)),
    ("1", (1.7,), ("not a readable FreeSurfer label",)), (None, (), ("No such file",)),
])  # fmt: skip
def test_labels_of_another_surface_or_cut_short_are_refused(tmp_path, count, indices, words):
    path = tmp_path / "a.label"
    refused(path if count is None else label(path, count, *indices), *words, read=read_mask, surface=TENT)
