"""Surfaces in every format: round trips, agreement with VTK and nibabel, and one named error for a
damaged file."""

import gzip
import hashlib
import os
import subprocess
import sys
from pathlib import Path

import nibabel
import numpy as np
import pytest
import pyvista

from freesurfer import GEOMETRY
from known_surfaces import grid
from qclearn.io.meshes import SlitWarning, frame_of, read_surface, write_surface
from qclearn.io.values import read_mask
from qclearn.surfaces.surface import Surface, SurfaceError

EXACT = ["a.npz", "a.ply", "a.obj", "a.off", "a.vtk", "a.vtp"]
SINGLE = ["a.gii", "a.surf.gii", "a.surf.gii.gz", "a.stl", "lh.pial", "rh.white", "lh.sphere.reg", "surface"]


@pytest.fixture
def tent():
    """A square pyramid without its base: irrational coordinates, numbered in the order of its
    faces."""
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
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "b.npz", **arrays, depth=np.zeros(5))
    curves = read_surface(tmp_path / "b.npz").curves
    assert {name: curve.tolist() for name, curve in curves.items()} == {"rim": [1, 2, 3], "a b": [4]}


def test_npz_and_gifti_keep_the_original_vertex_numbers(tmp_path, tent):
    for name in ("a.npz", "a.gii", "a.ply"):
        write_surface(tmp_path / name, tent, original_vertices=[9, 8, 7, 5, 2])
        again = read_surface(tmp_path / name)
        assert again.faces.tolist() == tent.faces.tolist()
        if name != "a.ply":
            assert again.original_vertices.tolist() == [9, 8, 7, 5, 2]
            write_surface(tmp_path / f"b{name}", again)
            assert read_surface(tmp_path / f"b{name}").original_vertices.tolist() == [9, 8, 7, 5, 2]
    assert again.original_vertices is None
    with np.load(tmp_path / "a.npz") as file:
        assert file["original_vertices"].tolist() == [9, 8, 7, 5, 2]
    image = nibabel.load(tmp_path / "a.gii")
    image.darrays[0].meta["QclearnOriginalVertices"] = "eJxjYAACAAAFAAE="  # five bytes
    (tmp_path / "c.gii").write_bytes(image.to_bytes())
    refused(tmp_path / "c.gii", "does not hold the numbers of 5 vertices")


@pytest.mark.parametrize("name", ["a.npz", "a.gii", "a.ply", "a.obj", "a.off", "lh.pial"])
def test_a_surface_is_known_by_one_hash_in_every_format_that_keeps_its_numbers(tmp_path, tent, name):
    odd = Surface(tent.vertices / 3 * [1, 1, -1], tent.faces)  # thirds are no float32, and there are negative zeros
    write_surface(tmp_path / name, odd)
    stored = (np.float32(odd.vertices) + 0).astype("<f4").tobytes() + odd.faces.astype("<i8").tobytes()
    assert read_surface(tmp_path / name).fingerprint == {"vertices": 5, "sha256": hashlib.sha256(stored).hexdigest()}
    assert read_surface(tmp_path / name).fingerprint != tent.fingerprint


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_a_file_cut_short_is_refused_wherever_it_is_cut(tmp_path, tent, name, capfd):
    """Or it is read whole, where all that is missing is what no surface needs (a line break, VTK's
    empty lists)."""
    write_surface(tmp_path / name, tent)
    whole = read_surface(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    path = tmp_path / f"cut-{name}" if "." in name[1:] and not name.startswith(("lh", "rh")) else tmp_path / "cut"
    if name.startswith("a.vt"):  # a process each
        lengths = [1, len(data) // 3, len(data) // 2, len(data) * 9 // 10]
    else:
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


def refused(path, *expected, read=read_surface, **options):
    with pytest.raises(SurfaceError) as caught:
        read(path, **options)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    for text in expected:
        assert text in str(caught.value)


def store(path, *lines):
    path.write_bytes("\n".join([*lines, ""]).encode())
    return path


@pytest.mark.parametrize("name", ["a.ply", "a.stl", "a.obj", "a.vtk", "a.vtp"])
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


def test_freesurfer_and_gifti_agree_with_nibabel(tmp_path, tent):
    write_surface(tmp_path / "lh.pial", tent)
    write_surface(tmp_path / "a.surf.gii", tent)
    vertices, faces = nibabel.freesurfer.read_geometry(tmp_path / "lh.pial")
    image = nibabel.load(tmp_path / "a.surf.gii")
    for points, triangles in ((vertices, faces), image.agg_data(("pointset", "triangle"))):
        np.testing.assert_array_equal(points, tent.vertices.astype(np.float32))
        np.testing.assert_array_equal(triangles, tent.faces)


def test_freesurfer_is_known_by_its_content_and_keeps_stored_coordinates(tmp_path, tent):
    geometry = {
        "head": np.array([2, 0, 20]), "valid": "1  # volume info valid", "filename": "orig.mgz",
        "volume": [256, 256, 256], "voxelsize": [1, 1, 1], "xras": [-1, 0, 0], "yras": [0, 0, -1], "zras": [0, 1, 0],
        "cras": [10, 20, 30],
    }  # fmt: skip
    path = tmp_path / "lh.pial.T1"
    nibabel.freesurfer.write_geometry(path, tent.vertices, tent.faces, volume_info=geometry)
    np.testing.assert_array_equal(read_surface(path).vertices, tent.vertices.astype(np.float32))


@pytest.mark.parametrize("path", ["/data/run=1/orig.mgz", "/data/M\xfcller/orig.mgz", "orig.mgz\0\x10 = 7"])
def test_freesurfers_stamp_and_path_may_hold_any_letters(tmp_path, tent, path):
    """Latin-1 of an old machine, = and what stands behind a NUL; FreeSurfer asks for none of it."""
    file = tmp_path / "lh.pial"
    nibabel.freesurfer.write_geometry(file, tent.vertices, tent.faces, "created by JOSE", GEOMETRY)
    data = file.read_bytes().replace(b"JOSE", b"Jos\xe9").replace(b"= orig.mgz", b"= " + path.encode("latin-1"))
    file.write_bytes(data)
    np.testing.assert_array_equal(read_surface(file).vertices, tent.vertices.astype(np.float32))
    frame = frame_of(file)
    assert frame.volume["filename"] == path.partition("\0")[0] and frame.volume["cras"] == GEOMETRY["cras"]
    write_surface(tmp_path / "lh.again", tent, frame=frame)
    assert frame_of(tmp_path / "lh.again").volume == frame.volume


def test_a_volume_without_its_last_lines_is_refused(tmp_path, tent):
    nibabel.freesurfer.write_geometry(tmp_path / "lh.pial", tent.vertices, tent.faces, volume_info=GEOMETRY)
    data = (tmp_path / "lh.pial").read_bytes()
    (tmp_path / "lh.pial").write_bytes(data[: data.index(b"zras")])
    with pytest.raises(SurfaceError, match="lh.pial: .*volume geometry is incomplete"):
        frame_of(tmp_path / "lh.pial")


PLY_HEADER = (
    "ply", "format ascii 1.0", "comment by hand", "element vertex 3", "property float x", "property uchar red",
    "property float y", "property double z", "element face 1", "property int label",
)  # fmt: skip


def test_ply_with_further_properties(tmp_path):
    rows = ("1 255 2 3", "4 255 5 7", "7 255 8 9", "6 3 2 0 1")
    for name in ("vertex_indices", "vertex_index"):
        path = store(tmp_path / "a.ply", *PLY_HEADER, f"property list uchar uint {name}", "end_header", *rows)
        assert read_surface(path).vertices.tolist() == [[1, 2, 3], [4, 5, 7], [7, 8, 9]]
        assert read_surface(path).faces.tolist() == [[2, 0, 1]]
    further = "property list uchar float tex", "property list uchar int vertex_indices"
    rows = (*rows[:3], "6 2 0.5 0.25 3 2 0 1")
    path = store(path, *PLY_HEADER, *further, "element edge 1", "property int from", "end_header", *rows, "1")
    assert read_surface(path).faces.tolist() == [[2, 0, 1]]
    refused(store(path, *PLY_HEADER, "end_header", *(row[:1] for row in rows)), "early end-of-line")
    refused(store(path, *PLY_HEADER, "end_header", *rows[:3], "6"), "lacks", "vertex_indices")


def test_ply_with_foreign_letters_and_line_ends(tmp_path, tent):
    write_surface(tmp_path / "a.ply", tent)
    header, end, body = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    for comment in ("größe".encode(), b"gr\xf6\xdfe", b"plain"):
        for line_end in (b"\n", b"\r\n"):
            changed = (header.replace(b"comment qclearn", b"comment " + comment) + end).replace(b"\n", line_end)
            (tmp_path / "b.ply").write_bytes(changed + body)
            np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").vertices, tent.vertices)
            np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").faces, tent.faces)


def test_ply_big_endian(tmp_path, tent):
    write_surface(tmp_path / "a.ply", tent)
    header, _, _ = (tmp_path / "a.ply").read_bytes().partition(b"end_header\n")
    faces = np.array([(3, face) for face in tent.faces], dtype=[("sides", "u1"), ("corners", ">i4", (3,))])
    body = tent.vertices.astype(">f8").tobytes() + faces.tobytes()
    (tmp_path / "b.ply").write_bytes(header.replace(b"little", b"big") + b"end_header\n" + body)
    np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").vertices, tent.vertices)
    np.testing.assert_array_equal(read_surface(tmp_path / "b.ply").faces, tent.faces)


def test_obj_with_texture_normals_and_negative_indices(tmp_path):
    vertices = ("# a comment", "o name", "v 0 0 0 1.0", "v 1 0 0", "vt 0 0", "vn 0 0 1", "v 0 1 0", "")
    for face in ("f 1/1/1 2/1/1 3/1/1", "f 1//1 2//1 3//1", "f -4 -3 -2"):
        surface = read_surface(store(tmp_path / "a.obj", *vertices, "v 1 1 0", face, "f 2 4 3"))
        assert surface.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
        assert surface.faces.tolist() == [[0, 1, 2], [1, 3, 2]]


@pytest.mark.parametrize("kind, colours", [(0, 1), (1, 4), (2, 5)])
def test_obj_of_mni_as_civet_writes_it(tmp_path, tent, kind, colours):
    """One colour, one a face, one a vertex; several numbers a line, or one."""
    points = " ".join(map(str, tent.vertices.ravel().tolist()))
    look = " ".join(["0 1 0 1"] * colours)
    corners = " ".join(map(str, tent.faces.ravel()))
    text = f"P 0.3 0.3 0.4 10 1 5\n{points}\n\n{points}\n\n 4\n {kind} {look}\n\n3 6 9 12\n\n{corners}\n"
    for content in (text, text.replace(" ", "\n")):
        (tmp_path / "lh.obj").write_text(content)
        np.testing.assert_array_equal(read_surface(tmp_path / "lh.obj").vertices, tent.vertices)
        np.testing.assert_array_equal(read_surface(tmp_path / "lh.obj").faces, tent.faces)
    for length in range(1, text.rindex(" "), 7):
        (tmp_path / "lh.obj").write_text(text[:length])
        refused(tmp_path / "lh.obj", "again")
    refused(store(tmp_path / "lh.obj", text.replace("3 6 9 12", "4 8 10 12")), "face 0 has 4 corners")
    refused(store(tmp_path / "lh.obj", "L 1 5", points), ".obj of MNI, but not one of polygons as text")


def test_off_with_comments_and_colours(tmp_path):
    rows = ("0 0 0", "1 0 0 255 0 0 255 # red", "", "0 1 0", "3 0 1 2 255 0 0")
    for header in (("OFF", "# by hand", "3 1 0"), ("OFF 3 1 0",), ("COFF", "3 1 3")):
        surface = read_surface(store(tmp_path / "a.off", *header, *rows))
        assert surface.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]] and surface.faces.tolist() == [[0, 1, 2]]
    refused(store(tmp_path / "a.off", "4OFF", "3 1 0", *rows), "not OFF")


def test_stl_merges_equal_points_and_both_zeros(tmp_path):
    corners = ("0 0 0", "1 0 0", "0 1 0", "1 0 -0", "1 1 0", "-0 1 0")
    facet = "facet normal 0 0 1\nouter loop\nvertex {}\nvertex {}\nvertex {}\nendloop\nendfacet"
    lines = ("solid name", facet.format(*corners[:3]), facet.format(*corners[3:]), "endsolid name")
    surface = read_surface(store(tmp_path / "a.stl", *lines))
    assert surface.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    assert surface.faces.tolist() == [[0, 1, 2], [1, 3, 2]]
    refused(store(tmp_path / "a.stl", *lines[:-1]), "incomplete", "copy or export it again")


@pytest.mark.parametrize("count", [1, 3, 5])
def test_a_binary_stl_with_another_count_is_refused(tmp_path, tent, count):
    write_surface(tmp_path / "a.stl", tent)
    data = (tmp_path / "a.stl").read_bytes()
    (tmp_path / "a.stl").write_bytes(data[:80] + bytes([count, 0, 0, 0]) + data[84:])
    refused(tmp_path / "a.stl", f"{count} face records are announced, 4 are there")


@pytest.mark.parametrize("face, corner", [(40, 0), (0, 1)])  # inside and at the rim
@pytest.mark.parametrize("bit", [0x01, 0x80])
def test_merging_stl_points_that_leaves_a_slit_warns(tmp_path, face, corner, bit):
    vertices, faces = grid(6, 6)
    write_surface(tmp_path / "a.stl", Surface(vertices + [0.3, 0.7, 1], faces))
    read_surface(tmp_path / "a.stl")  # without a warning
    data = bytearray((tmp_path / "a.stl").read_bytes())
    data[84 + 50 * face + 12 + 12 * corner + 1] ^= bit  # in the mantissa of x
    (tmp_path / "a.stl").write_bytes(data)
    with pytest.warns(SlitWarning, match="a.stl: merging equal points leaves a slit at vertex"):
        assert len(read_surface(tmp_path / "a.stl").vertices) == 50


@pytest.mark.parametrize("old, new", [
    (b"element face 4", b"element face -128"), (b"element vertex 5", b"property int q"), (b"double x", b"quad x"),
    (b"uchar int vertex", b"uchar float vertex"), (b"element face 4", b"element vertex 5"), (b"endian 1", b"endian 2"),
    (b"element face 4", b"element face 400000000"),
])  # fmt: skip
def test_ply_headers_that_make_no_sense_are_refused(tmp_path, tent, old, new):
    write_surface(tmp_path / "a.ply", tent)
    data = (tmp_path / "a.ply").read_bytes()
    assert old in data
    (tmp_path / "a.ply").write_bytes(data.replace(old, new))
    refused(tmp_path / "a.ply", "not a readable PLY file", "copy or export it again")


def test_ply_corners_with_a_fraction_or_beyond_their_type_are_refused(tmp_path):
    for corners in ("3 2 0 1.5", "3 2 0 -1", "3 2 0 99999999999"):
        rows = ("1 255 2 3", "4 255 5 7", "7 255 8 9", f"6 {corners}")
        path = store(tmp_path / "a.ply", *PLY_HEADER, "property list uchar uint vertex_indices", "end_header", *rows)
        refused(path, "not a readable PLY file", "again")


def test_npz_curves_with_names_that_cannot_be_shown_are_refused(tmp_path, tent):
    for name in ("\x1b]0;x", "A" * 300):
        np.savez(tmp_path / "a.npz", vertices=tent.vertices, faces=tent.faces, **{f"curve_{name}": [1, 2]})
        refused(tmp_path / "a.npz", "too long or holds control characters", "rename")


def test_npz_curves_that_no_reader_takes_are_not_written(tmp_path, tent):
    for name in ("a\tb", "M\udcfcller"):
        with pytest.raises(SurfaceError, match="a.npz: has a curve whose name is too long or holds control"):
            write_surface(tmp_path / "a.npz", Surface(tent.vertices, tent.faces, {name: [1, 2]}))
    assert not list(tmp_path.iterdir())


def test_freesurfer_counts_are_checked_before_they_are_believed(tmp_path, tent):
    write_surface(tmp_path / "lh.pial", tent)
    data = (tmp_path / "lh.pial").read_bytes()
    place = data.index(b"\n\n") + 2
    for counts in (b"\x7f\xff\xff\xff\0\0\0\4", b"\0\0\0\5\x7f\xff\xff\xff", b"\xff\xff\xff\xff\0\0\0\4"):
        (tmp_path / "lh.pial").write_bytes(data[:place] + counts + data[place + 8 :])
        refused(tmp_path / "lh.pial", "records are announced")


PEAK = """
import resource, sys
import qclearn as qc
try:
    qc.read_surface(sys.argv[1])
except qc.SurfaceError:
    print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)
"""


def test_vtks_reader_has_limits_of_memory_and_time(tmp_path, tent, monkeypatch):
    write_surface(tmp_path / "a.vtk", tent)
    lines = (
        "# vtk DataFile Version 3.0",
        "x",
        "ASCII",
        "DATASET POLYDATA",
        "POINTS 3 float",
        "0 0 0 1 0 0 0 1 0",
        "POLYGONS 400000000 1600000000",
        "3 0 1 2",
    )
    refused(store(tmp_path / "b.vtk", *lines), "VTK")
    announced = 400_000_000 * 4 / 2**20  # MB, which VTK takes without the limit
    alone = subprocess.run([sys.executable, "-c", PEAK, tmp_path / "b.vtk"], capture_output=True, text=True, check=True)
    assert float(alone.stdout) < 0.6 * announced
    monkeypatch.setattr("qclearn.io.meshes.VTK_SECONDS", 0.01)
    refused(tmp_path / "a.vtk", "has not ended after 0.01 s")


QUAD = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)


def test_faces_that_are_no_triangles_are_refused(tmp_path):
    mesh = pyvista.PolyData(QUAD, faces=[4, 0, 1, 2, 3])
    corners = [" ".join(map(str, row)) for row in QUAD]
    for name in ("a.ply", "b.ply", "a.vtk", "a.vtp"):
        mesh.save(tmp_path / name, binary=name < "b")
        refused(tmp_path / name, "face 0 has 4 corners", "triangulate")
    path = store(tmp_path / "a.obj", *(f"v {row}" for row in corners), "f 1 2 3", "f 1 3 4 2")
    refused(path, "face 1 has 4 corners", "triangulate")
    refused(store(tmp_path / "a.off", "OFF", "4 1 0", *corners, "4 0 1 2 3"), "face 0 has 4 corners", "triangulate")
    np.savez(tmp_path / "a.npz", vertices=QUAD, faces=[[0, 1, 2, 3]])
    refused(tmp_path / "a.npz", "(1, 4)", "triangles")
    (tmp_path / "lh.quad").write_bytes(b"\xff\xff\xff" + bytes(60))
    refused(tmp_path / "lh.quad", "quadrangles", "mris_convert")


def test_vtk_files_of_other_data_are_refused(tmp_path, capfd):
    pyvista.PolyData(QUAD, strips=[4, 0, 1, 3, 2]).save(tmp_path / "strips.vtk")
    pyvista.PolyData(QUAD).save(tmp_path / "points.vtp")
    pyvista.ImageData(dimensions=(2, 2, 2)).save(tmp_path / "image.vtk")
    for name in ("strips.vtk", "points.vtp", "image.vtk"):
        refused(tmp_path / name, "VTK" if name == "image.vtk" else "no faces")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_content_of_another_kind_is_refused(tmp_path, name, capfd):
    for content in (b"not a surface\n" * 20, b"\xff\xff\xfe" + bytes(300), bytes(range(256)) * 3):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name)
    (tmp_path / name).write_bytes(b"")
    refused(tmp_path / name, "empty", "again") if name[-2:] != "gz" else refused(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name, old, new", [
    ("a.vtk", b"Version 5.1", b"Version 1.1"),
    ("a.vtp", b'NumberOfPoints="5"', b'NumberOfPoints="5555555555555"'),
])  # fmt: skip
def test_damage_that_makes_vtk_end_the_process_is_refused(tmp_path, tent, name, old, new):
    write_surface(tmp_path / name, tent)
    data = (tmp_path / name).read_bytes()
    assert old in data
    (tmp_path / name).write_bytes(data.replace(old, new))
    refused(tmp_path / name, "VTK", "copy or export it again")


def test_missing_files_folders_and_unknown_formats(tmp_path, tent):
    refused(tmp_path / "none.ply", "No such file", "check the name")
    refused(tmp_path, "Is a directory")
    refused(store(tmp_path / "a.stp", "ISO-10303-21"), ".ply", "FreeSurfer", "mris_convert")
    for name in ("a.stp", "a.mgz", "pial.txt"):
        with pytest.raises(SurfaceError, match="suffix.*FreeSurfer.*lh.pial"):
            write_surface(tmp_path / name, tent)
    assert [file.name for file in tmp_path.iterdir()] == ["a.stp"]


def test_npz_that_lacks_an_array_or_holds_objects(tmp_path, tent):
    np.savez(tmp_path / "a.npz", vertices=tent.vertices)
    refused(tmp_path / "a.npz", "lacks the array faces")
    np.savez(tmp_path / "b.npz", vertices=tent.vertices, faces=np.array([{}, None]))
    refused(tmp_path / "b.npz", "npz file")


def test_gifti_that_is_no_surface(tmp_path):
    values = nibabel.gifti.GiftiDataArray(np.zeros(5, dtype=np.float32), intent="NIFTI_INTENT_SHAPE")
    nibabel.GiftiImage(darrays=[values]).to_filename(tmp_path / "a.shape.gii")
    refused(tmp_path / "a.shape.gii", "not one surface", ".surf.gii")


def test_faults_of_the_surface_name_the_file(tmp_path):
    vertices, faces = grid(2, 2)
    vertices[3] = np.nan
    np.savez(tmp_path / "a.npz", vertices=vertices, faces=faces)
    refused(tmp_path / "a.npz", "NaN or infinite coordinates: 3.")


@pytest.mark.parametrize("name", EXACT + SINGLE)
def test_folders_that_cannot_be_written(tmp_path, tent, name, capfd):
    (tmp_path / "file").write_text("")
    (tmp_path / "taken" / name).mkdir(parents=True)
    for folder in ("missing", "file", "taken"):
        with pytest.raises(SurfaceError, match="cannot be written.*exists and is writable") as caught:
            write_surface(tmp_path / folder / name, tent)
        assert str(caught.value).startswith(str(tmp_path / folder / name))
    assert sorted(path.name for path in tmp_path.rglob("*")) == sorted(["file", "taken", name])
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission(tmp_path, tent):
    tmp_path.chmod(0o500)
    with pytest.raises(SurfaceError, match="Permission denied.*writable"):
        write_surface(tmp_path / "a.npz", tent)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, tent, monkeypatch):
    write_surface(tmp_path / "a.ply", tent)
    before = (tmp_path / "a.ply").read_bytes()

    def full_disk(path, data):
        with path.open("wb") as file:
            file.write(data[:10])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(SurfaceError, match="No space left"):
        write_surface(tmp_path / "a.ply", Surface(2 * tent.vertices, tent.faces))
    assert (tmp_path / "a.ply").read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.ply"]


def test_a_write_replaces_and_has_ordinary_permissions(tmp_path, tent):
    (tmp_path / "plain").touch()
    for factor in (1, 2):
        write_surface(str(tmp_path / "a.obj"), Surface(factor * tent.vertices, tent.faces))
    np.testing.assert_array_equal(read_surface(str(tmp_path / "a.obj")).vertices, 2 * tent.vertices)
    assert (tmp_path / "a.obj").stat().st_mode == (tmp_path / "plain").stat().st_mode


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


VALUES = ["a.npy", "a.txt", "a.shape.gii", "a.func.gii.gz", "lh.thickness"]


@pytest.mark.parametrize("name", VALUES)
def test_masks_of_one_value_a_vertex(tmp_path, tent, name):
    path = values(name, tmp_path / name, WALL)
    assert read_mask(path, tent).tolist() == [False, False, True, True, False]
    assert read_mask(path, tent, keep=True).tolist() == [True, True, False, False, True]


def test_masks_from_a_label(tmp_path, tent):
    path = label(tmp_path / "lh.Medial_wall.label", [3, 1])
    assert read_mask(path, tent).tolist() == [False, True, False, True, False]
    assert read_mask(path, tent, keep=True).tolist() == [True, False, True, False, True]
    assert not read_mask(label(path, []), tent).any()
    assert read_mask(label(path, [2]), tent).sum() == 1


@pytest.mark.parametrize("name", VALUES)
def test_masks_of_another_surface_or_with_nan_are_refused(tmp_path, tent, name):
    refused(values(name, tmp_path / name, WALL[:4]), "(4,)", "5 vertices", "belongs", read=read_mask, surface=tent)
    bad = values(name, tmp_path / name, np.array([0, np.nan, 1, 0, 0]))
    refused(bad, "NaN", "the first 1", read=read_mask, surface=tent)


def test_labels_of_another_surface_or_cut_short_are_refused(tmp_path, tent):
    path = tmp_path / "a.label"
    refused(label(path, [1, 7]), "do not exist", "7", "5 vertices", read=read_mask, surface=tent)
    refused(label(path, [1], announced=2), "2 vertex records", "1 are there", read=read_mask, surface=tent)
    refused(label(path, [1, 2], announced=1), "1 vertex records", "2 are there", read=read_mask, surface=tent)
    refused(store(path, "#!ascii label"), "not a readable FreeSurfer label", read=read_mask, surface=tent)
    refused(
        store(path, "#!ascii label", "1", "1.7 0 0 0 0"),
        "not a readable FreeSurfer label",
        read=read_mask,
        surface=tent,
    )


@pytest.mark.parametrize("name", [*VALUES, "a.label"])
def test_damaged_masks_are_refused(tmp_path, tent, name):
    path = label(tmp_path / name, [1, 2]) if name == "a.label" else values(name, tmp_path / name, WALL)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, "again", read=read_mask, surface=tent)
    path.unlink()
    refused(path, "No such file", read=read_mask, surface=tent)


def test_what_to_keep_must_be_said(tmp_path, tent):
    path = label(tmp_path / "lh.cortex.label", [0, 1, 2])
    refused(path, "would cut 3 of 5 vertices", "keep=True", "--keep", read=read_mask, surface=tent)
    assert read_mask(path, tent, keep=True).tolist() == [False, False, False, True, True]


def test_importing_the_readers_does_not_load_vtk():
    """It takes half a second that most callers need not pay."""
    code = "import sys, qclearn.io.meshes; sys.exit('vtkmodules' in sys.modules or 'pyvista' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
