"""The checked surface: what is stored, its measures and boundary, and one error for each way not to be a surface."""

import copy
import inspect
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import qclearn as qc
from known_surfaces import grid, torus_mesh, with_seam
from operations import lines_run
from qclearn.surfaces.surface import Mesh, Surface, SurfaceError, mirror, require_disk, require_outward
from qclearn.surfaces.units import other_units, relative_units, size_of

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
OUTWARD = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])


def refused(*expected, vertices=TETRAHEDRON, faces=OUTWARD, curves=None):
    with pytest.raises(SurfaceError) as caught:
        Surface(vertices, faces, curves)
    for text in expected:
        assert text in str(caught.value)


def test_arrays_are_stored_as_promised_and_cannot_be_changed():
    vertices = TETRAHEDRON.astype(np.float32)
    surface = Surface(vertices, OUTWARD.astype(np.uint16), {"ridge": [0, 3]})
    assert repr(surface) == "Surface(4 vertices, 4 faces, curves ridge)"
    assert surface.vertices.dtype == np.float64 and surface.faces.dtype == surface.curves["ridge"].dtype == np.int64
    vertices[0] = 7
    np.testing.assert_array_equal(surface.vertices, TETRAHEDRON)
    for kept in (surface, pickle.loads(pickle.dumps(surface)), copy.copy(surface), copy.deepcopy(surface)):
        for array in (kept.vertices, kept.faces, kept.edges, kept.edge_faces, kept.curves["ridge"]):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0


PUBLIC = filter(inspect.isfunction, (getattr(qc, name) for name in qc.__all__))
TAKERS = [function for function in PUBLIC if "Surface" in str(inspect.signature(function).parameters)]


@pytest.mark.parametrize("function", TAKERS)
def test_a_path_or_arrays_in_place_of_a_surface_are_told_how_to_make_one(function):
    needed = {k: p.annotation for k, p in inspect.signature(function).parameters.items() if p.default is p.empty}
    for name in [name for name, kind in needed.items() if "Surface" in str(kind)]:
        others = {key: Surface(TETRAHEDRON, OUTWARD[1:]) if key == "moving" else None for key in needed}
        for given in ("lh.pial", Path("lh.pial"), (TETRAHEDRON, OUTWARD))[: 2 if function is qc.open_surface else 3]:
            with pytest.raises(SurfaceError, match=r"needed, not .*(tuple|lh.pial).*read_surface.*Surface\("):
                function(**others | {name: given})


def test_edges_and_their_faces():
    surface = Surface(TETRAHEDRON, OUTWARD[:3])
    assert surface.edges.tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]
    assert surface.edge_faces.tolist() == [[0, 1], [0, -1], [1, -1], [0, 2], [1, 2], [2, -1]]


def test_areas_and_volume_of_a_tetrahedron():
    surface = Surface(TETRAHEDRON, OUTWARD)
    np.testing.assert_allclose(surface.face_areas, [0.5, 0.5, np.sqrt(3) / 2, 0.5])
    np.testing.assert_allclose(surface.vertex_areas, np.array([1.5, 1 + np.sqrt(3) / 2] + [1 + np.sqrt(3) / 2] * 2) / 3)
    assert surface.area == pytest.approx(1.5 + np.sqrt(3) / 2)
    assert surface.volume == pytest.approx(1 / 6)
    assert Surface(TETRAHEDRON, OUTWARD[:, ::-1]).volume == pytest.approx(-1 / 6)
    assert surface.boundary_loops == [] and surface.euler_characteristic == 2
    assert Surface(*torus_mesh()).euler_characteristic == 0
    largest = Surface(np.eye(3) * 9e59, [[0, 1, 2]])
    assert np.isfinite([largest.area, largest.volume]).all()


@drawn(st.integers(0, 2**32 - 1), st.floats(1e-6, 1e6), st.integers(0, 4))
def test_volume_is_capped_and_moves_with_the_surface(seed, scale, opening):
    """A missing face is capped by itself, wherever the surface lies and however it is turned."""
    random = np.random.default_rng(seed)
    moved = scale * (Rotation.random(rng=random).apply(TETRAHEDRON) + random.normal(size=3, scale=10))
    surface = Surface(moved, np.delete(OUTWARD, opening, axis=0) if opening < 4 else OUTWARD)
    assert surface.volume == pytest.approx(scale**3 / 6, rel=1e-9)


def test_boundary_runs_counterclockwise_from_its_smallest_vertex():
    surface = Surface(*grid(3, 2))
    loop = surface.boundary
    assert loop.tolist() == [0, 3, 6, 9, 10, 11, 8, 5, 2, 1]
    reverse = Surface(surface.vertices, surface.faces[:, ::-1]).boundary
    assert reverse.tolist() == [0, *loop[:0:-1].tolist()]


def test_boundary_loops_keep_the_surface_on_their_left():
    surface = Surface(*grid(3, 3, hole=[(1, 1)]))
    outer, inner = surface.boundary_loops
    z = surface.vertices[:, 0] + 1j * surface.vertices[:, 1]
    areas = [0.5 * (np.conj(z[loop]) * np.roll(z[loop], -1)).imag.sum() for loop in (outer, inner)]
    assert (outer[0], inner[0], areas) == (0, 5, [9, -1])
    with pytest.raises(SurfaceError, match="2 boundary loops"):
        _ = surface.boundary


def test_mirror_keeps_outward_indices_and_curves():
    surface = Surface(TETRAHEDRON + 5, OUTWARD[1:], {"ridge": [0, 3]})
    image = mirror(surface)
    np.testing.assert_array_equal(image.vertices, surface.vertices * [-1, 1, 1])
    assert image.volume == pytest.approx(surface.volume) and surface.volume > 0
    assert image.curves["ridge"].tolist() == [0, 3]
    np.testing.assert_array_equal(mirror(image).vertices, surface.vertices)
    np.testing.assert_array_equal(mirror(image).faces, surface.faces)


def test_numbers_in_the_whole_surface_are_kept_and_checked():
    numbers = [7, 3, 9, 0]
    kept = Surface(TETRAHEDRON, OUTWARD, original_vertices=numbers)
    assert kept.original_vertices.tolist() == mirror(kept).original_vertices.tolist() == numbers
    assert not kept.original_vertices.flags.writeable and Surface(TETRAHEDRON, OUTWARD).original_vertices is None
    for wrong, message in (
        ([7, 3, 9], "4 whole numbers.*shape"),
        ([0.5, 1, 2, 3], "float64"),
        ([7, 3, 9, 7], "one number twice"),
        ([-1, 3, 9, 7], "negative"),
    ):
        with pytest.raises(SurfaceError, match=f"original_vertices .*{message}"):
            Surface(TETRAHEDRON, OUTWARD, original_vertices=wrong)


def changed(array, place, value):
    array = array.copy()
    array[place] = value
    return array


def two_fans():
    """Faces of a grid that touch in the vertex 3 alone."""
    vertices, faces = grid(2, 2, hole=[(0, 1), (1, 0)])
    used, corners = np.unique(faces, return_inverse=True)
    return {"vertices": vertices[used], "faces": corners.reshape(-1, 3)}


PIECES = {"vertices": np.vstack([TETRAHEDRON, grid(2, 2)[0]]), "faces": np.vstack([OUTWARD, grid(2, 2)[1] + 4])}
ONE_TURNED, FIVE = changed(OUTWARD[:3], 2, OUTWARD[2, ::-1]), np.vstack([TETRAHEDRON, [0, -1, -1]])
TOUCHING = np.vstack([TETRAHEDRON, TETRAHEDRON[:3] + [0, 0, 2]])  # two tetrahedra that have vertex 3 in common
TWINS = {"vertices": TOUCHING, "faces": [*OUTWARD, *np.array([4, 5, 6, 3])[OUTWARD[:, ::-1]]]}
APART = "2 components: 9 vertices around vertex 4, 4 vertices around vertex 0"
BEYOND = "3 vertices with coordinates beyond 1e+60: 0, 1, 2"
REFUSED = [
    (["(4, 2)", "z = 0"], {"vertices": TETRAHEDRON[:, :2]}),
    (["real numbers"], {"vertices": [["a", "b", "c"]] * 4}),
    (["real numbers", "<U"], {"vertices": TETRAHEDRON.astype(str)}),
    (["real numbers", "datetime64"], {"vertices": TETRAHEDRON.astype("M8[s]")}),
    (["complex", "z.real"], {"vertices": TETRAHEDRON * 1j}),
    ([BEYOND, "millimetres"], {"vertices": np.eye(3) * 1e61, "faces": [[0, 1, 2]]}),
    *(
        (["1 vertex with NaN or infinite coordinates: 2.", "export"], {"vertices": changed(TETRAHEDRON, (2, 1), bad)})
        for bad in (np.nan, np.inf, -np.inf)
    ),
    (["7 vertices in no face: 4, 5, 6, 7, 8 and 2 more."], {"vertices": np.pad(TETRAHEDRON, ((0, 7), (0, 0)))}),
    (["(4, 4)", "triangles"], {"faces": np.zeros((4, 4), dtype=int)}),
    (["float64", "astype(int)"], {"faces": OUTWARD.astype(float)}),
    (["no faces", "triangle"], {"faces": np.empty((0, 3), dtype=int)}),
    (["1 face", "outside 0 ... 3: 3.", "subtract 1"], {"faces": changed(OUTWARD, (3, 1), 4)}),
    (["1 face", "outside 0 ... 3: 3.", "subtract 1"], {"faces": changed(OUTWARD, (3, 1), -1)}),
    (["1 degenerate face", "repeated", ": 4.", "the numbers stay"], {"faces": np.vstack([OUTWARD, [1, 1, 2]])}),
    (["duplicate faces: 1 pair", "[1, 4]", "one of each"], {"faces": np.vstack([OUTWARD, [1, 0, 3]])}),
    (["duplicate faces: 1 pair", "[1, 4]", "one of each"], {"faces": np.vstack([OUTWARD, [3, 1, 0]])}),
    (["duplicate faces", "[0, 1]"], {"vertices": TETRAHEDRON[:3], "faces": [[0, 1, 2], [0, 2, 1]]}),
    (["inconsistent orientation: 2 pairs", "[0, 2], [1, 2]", "Reverse"], {"faces": ONE_TURNED}),
    (["not manifold: 1 edge", "[0, 1]", "Delete"], {"vertices": FIVE, "faces": np.vstack([OUTWARD, [0, 1, 4]])}),
    (["not manifold: 1 vertex", ": 3.", "Duplicate the vertex"], two_fans()),
    (["not manifold: 1 vertex", ": 3."], TWINS),
    ([APART, "in a file of its own", "qclearn open"], PIECES),
    (["curve 'ridge'", "4, -1;", "0 to 3"], {"curves": {"ridge": [0, 4, -1]}}),
    *((["curve 'ridge'", "vertex indices"], {"curves": {"ridge": path}}) for path in ([], [0.5], [[0, 1]])),
]


@pytest.mark.parametrize("expected, given", REFUSED)
def test_what_is_no_surface_is_refused_with_its_indices_and_the_remedy(expected, given):
    refused(*expected, **given)


def test_unused_vertices_and_their_remedy():
    vertices = np.insert(TETRAHEDRON, 1, [9, 9, 9], axis=0)
    faces = OUTWARD + (OUTWARD > 0)
    refused("1 vertex in no face: 1.", "numpy.unique", vertices=vertices, faces=faces)
    used, corners = np.unique(faces, return_inverse=True)
    surface = Surface(vertices[used], corners.reshape(-1, 3), original_vertices=used)
    np.testing.assert_array_equal(surface.vertices, TETRAHEDRON)
    dropped = Surface(*Mesh.of(vertices, faces, {"ridge": [0, 2]}).used())
    np.testing.assert_array_equal(dropped.faces, surface.faces)
    assert dropped.original_vertices.tolist() == [0, 2, 3, 4] and dropped.curves["ridge"].tolist() == [0, 1]


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_zero_area_is_judged_at_the_scale_of_the_surface(scale):
    vertices, faces = grid(2, 1)
    vertices = scale * Rotation.from_rotvec([1, 2, 3]).apply(vertices)
    flat = vertices.copy()
    flat[0] = (vertices[2] + vertices[5]) / 2  # onto the line of a face's other two corners, up to rounding
    refused("degenerate", ": 0.", vertices=flat[[0, 2, 5, 4]], faces=[[0, 1, 2], [1, 3, 2]])
    thin = vertices.copy()
    thin[0] = vertices[3] + 1e-9 * (vertices[0] - vertices[3])
    assert Surface(thin, faces).area > 0


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_points_doubled_along_a_seam_are_refused_and_merged(scale):
    """Halves that touch, and one face cut out; the lowest numbers stay, and a curve across stays one."""
    vertices, faces = torus_mesh()
    for side in (vertices[faces].mean(1)[:, 0] > 0.1, np.arange(len(faces)) == 7):
        doubled, torn, seam = with_seam(scale * vertices, faces, side)
        copy = len(vertices)
        refused(f"seam: {len(seam)} pairs", f"[{seam[0]}, {copy}]", "--merge", vertices=doubled, faces=torn)
        mesh = Mesh.of(doubled, torn, {"across": [seam[0], copy, seam[1]]}).merged()
        surface = Surface(*mesh.used())
        np.testing.assert_array_equal(surface.faces, faces)
        np.testing.assert_array_equal(surface.original_vertices, np.arange(len(vertices)))
        assert surface.curves["across"].tolist() == seam[:2].tolist()


def test_fans_that_touch_in_a_point_alone_are_no_seam():
    vertices, faces = grid(2, 2, hole=[(0, 1), (1, 0)])
    faces = np.where((faces == 4) & (np.arange(len(faces))[:, None] % 2 == 0), len(vertices), faces)
    mesh = Mesh.of(np.vstack([vertices, vertices[4]]), faces)
    assert mesh.merged().faces.tolist() == mesh.faces.tolist()


@pytest.mark.parametrize("scale, unit, mm", [
    (1.0, "mm", 1.0), (0.3, "mm", 1.0), (1e-3, "m", 1e-3), (2e-4, "m", 1e-3), (1e3, "um", 1e3), (3e3, "um", 1e3),
    (0.1, None, 15 / 165), (1 / 150, None, 1 / 165), (10.0, None, 1500 / 165),
])  # fmt: skip
def test_the_length_tells_the_unit(scale, unit, mm):
    """Of a hemisphere 150 mm long; in cm, at length 1 and at ten times its size a mm is relative."""
    surface = Surface(150 * scale * TETRAHEDRON, OUTWARD)
    length, found, one = size_of(surface)
    assert (length, found, one) == (pytest.approx(150 * scale), unit, pytest.approx(mm))
    messages = list(other_units(moving=surface))
    assert len(messages) == (unit in ("m", "um")) and all(f"--units {unit}" in message for message in messages)
    assert (relative_units(surface) is None) == (unit is not None)


def test_require_disk():
    require_disk(Surface(*grid(2, 2)))
    with pytest.raises(SurfaceError, match="closed.*open_surface.*qclearn open"):
        require_disk(Surface(TETRAHEDRON, OUTWARD))
    message = "2 boundary loops.*: 12 vertices from vertex 0, 4 vertices from vertex 5.*open_surface"
    with pytest.raises(SurfaceError, match=message):
        require_disk(Surface(*grid(3, 3, hole=[(1, 1)])))


@pytest.mark.parametrize("corner", [0, 440, 17])
def test_a_handle_is_refused_and_located(corner):
    """A tube between two holes of a grid: the named edges lie on it or next to it, whichever vertex is the first."""
    vertices, faces = grid(20, 20, hole=[(9, 9), (12, 9)])
    one, two = (np.array([i * 21 + 9, i * 21 + 10, (i + 1) * 21 + 10, (i + 1) * 21 + 9]) for i in (9, 12))
    two = two[[0, 3, 2, 1]]  # the tube joins the holes against each other
    following = np.roll(np.arange(4), -1)
    tube = [*np.stack([one[following], one, two], 1), *np.stack([one[following], two, two[following]], 1)]
    order = np.roll(np.arange(len(vertices)), -corner)
    surface = Surface(vertices[order], np.argsort(order)[np.vstack([faces, tube])])
    with pytest.raises(SurfaceError, match="1 handle .*Euler characteristic -1.*mris_fix_topology") as caught:
        require_disk(surface)
    edges = np.array(re.findall(r"\[(\d+), (\d+)\]", str(caught.value)), dtype=int)
    assert edges.shape == (2, 2)
    assert (np.abs(surface.vertices[edges] - [11, 9.5, 0]) <= [3, 2, 0]).all()


def test_require_outward():
    require_outward(Surface(TETRAHEDRON, OUTWARD[1:]))
    inward = Surface(TETRAHEDRON, OUTWARD[1:, ::-1])
    with pytest.raises(SurfaceError, match=r"inward.*faces\[:, ::-1\].*qclearn open --reverse"):
        require_outward(inward)
    require_outward(Surface(inward.vertices, inward.faces[:, ::-1]))


@drawn(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_flat_surface_is_valid_but_has_no_outside(seed):
    vertices = Rotation.random(rng=seed).apply(grid(3, 2)[0] + 0.3) + [1, 2, 3]
    with pytest.raises(SurfaceError, match="plane.*pial"):
        require_outward(Surface(vertices, grid(3, 2)[1]))


def test_no_check_loops_over_vertices_or_faces():
    vertices, faces = grid(150, 150)
    assert lines_run(lambda: Surface(vertices, faces)) < len(vertices)
