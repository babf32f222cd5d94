"""Cutting a surface open: what is kept, what is filled, and which masks are refused."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from known_surfaces import grid, sphere, torus_mesh
from qclearn.io.fsaverage import fsaverage5
from qclearn.surfaces.opening import open_surface
from qclearn.surfaces.surface import Surface, SurfaceError, mirror, require_disk, require_outward


def height(surface):
    return surface.vertices[:, 2]


def chords(surface):
    on_rim = np.isin(surface.edges, surface.boundary).all(axis=1)
    return surface.edges[on_rim & (surface.edge_faces[:, 1] >= 0)]


def block(*cells, n=8):
    """Mask on grid(n, n): True at the vertices (i, j) named."""
    mask = np.zeros((n + 1, n + 1), dtype=bool)
    for i, j in cells:
        mask[i, j] = True
    return mask.ravel()


def closed_grid(n=8):
    """grid(n, n) made a closed surface by a cone over its boundary, its tip the last vertex."""
    vertices, faces = grid(n, n)
    loop = Surface(vertices, faces).boundary
    cone = np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(vertices))], axis=1)
    return Surface(np.vstack([vertices, [n / 2, n / 2, -n]]), np.vstack([faces, cone]))


CAP = sphere().vertices[:, 2] > 0.6


def unread(rim):
    """NaN in a mask, as in files whose wall was never reconstructed."""
    vertices = sphere().vertices.copy()
    vertices[CAP if rim else height(sphere()) > 0.8] = np.nan
    return vertices, sphere().faces


def without_faces(some):
    """Faces of the wall removed, its vertices left: those that touch it, or those within."""
    inside = CAP[sphere().faces]
    return sphere().vertices, sphere().faces[~(inside.any(axis=1) if some else inside.all(axis=1))]


def in_one_place(among):
    """Two neighbours among vertices (V,) bool in one place."""
    vertices = sphere().vertices.copy()
    first, second = sphere().edges[among[sphere().edges].all(axis=1)][3]
    vertices[first] = vertices[second]
    return vertices, sphere().faces


def turned(among):
    """A face turned round, and another one twice."""
    inside = np.flatnonzero(among[sphere().faces].all(axis=1))
    faces = np.vstack([sphere().faces, sphere().faces[inside[9]]])
    faces[inside[3]] = faces[inside[3], ::-1]
    return sphere().vertices, faces


def bubble():
    """A small closed piece beside, all of it in the mask."""
    whole = sphere()
    return np.vstack([whole.vertices, whole.vertices / 9 + 3]), np.vstack([whole.faces, whole.faces + 642])


@pytest.mark.parametrize("mesh", [
    unread(True), unread(False), without_faces(True), without_faces(False), in_one_place(CAP), turned(CAP), bubble(),
    (np.vstack([sphere().vertices, np.full((3, 3), 7.0)]), sphere().faces),
])  # fmt: skip
def test_faults_of_what_is_cut_away_do_not_matter(mesh):
    expected, table = open_surface(sphere(), CAP)
    opened, index = open_surface(mesh, np.append(CAP, np.ones(len(mesh[0]) - 642, dtype=bool)))
    np.testing.assert_array_equal(index, table)
    np.testing.assert_array_equal(opened.vertices, expected.vertices)
    np.testing.assert_array_equal(opened.faces, expected.faces)


@pytest.mark.parametrize("mesh, message", [
    (in_one_place(~CAP), "2 degenerate faces"), (turned(~CAP), "duplicate faces: 1 pair"),
    (unread(False), r"NaN or infinite coordinates: \d+"),
])  # fmt: skip
def test_faults_of_what_stays_are_refused(mesh, message):
    """Also beside a wall with faults of its own, by the numbers of the file."""
    mask = CAP if "NaN" not in message else np.roll(CAP, 7) & (height(sphere()) < 0)
    mask = mask if mask.any() else height(sphere()) < -0.6
    vertices = mesh[0].copy()
    vertices[height(sphere()) > 0.9] = np.nan
    with pytest.raises(SurfaceError, match=message):
        open_surface((vertices, mesh[1]), mask)


@pytest.mark.parametrize("mask, cap", [
    (lambda z: z > 0.8, lambda z: z > 0.8), (lambda z: (z > 0.8) | (z < -0.95), lambda z: z > 0.8),
    (lambda z: np.abs(z - 0.5) < 0.1, lambda z: z > 0.4),
])  # fmt: skip
def test_the_largest_gap_is_the_opening_the_largest_piece_is_kept_and_indices_come_back(mask, cap):
    mask, cap = mask(height(sphere())), cap(height(sphere()))
    opened, index = open_surface(sphere(), mask)
    np.testing.assert_array_equal(index, np.flatnonzero(~cap))
    np.testing.assert_array_equal(opened.vertices, sphere().vertices[index])
    kept = ~cap[sphere().faces].any(axis=1)
    np.testing.assert_array_equal(index[opened.faces], sphere().faces[kept])
    require_outward(opened)


def test_curves_follow_their_vertices_or_are_refused():
    cap = height(sphere()) > 0.8
    low, high = np.argsort(height(sphere()))[:4], np.argmax(height(sphere()))
    carrying = Surface(sphere().vertices, sphere().faces, {"south": low})
    opened, index = open_surface(carrying, cap)
    np.testing.assert_array_equal(index[opened.curves["south"]], low)
    crossing = Surface(sphere().vertices, sphere().faces, {"meridian": [*low, high]})
    with pytest.raises(SurfaceError, match=f"'meridian' would lose 1 of its 5 vertices, the first {high}.*shorten"):
        open_surface(crossing, cap)


def test_a_vertex_on_the_rim_of_two_fans_keeps_the_larger():
    """Two gaps that meet in the tip of a cone of 32 faces leave 10 of them on one side and 18 on the other."""
    surface = closed_grid()
    loop, tip = Surface(*grid(8, 8)).boundary, len(surface.vertices) - 1
    mask = np.zeros(tip + 1, dtype=bool)
    mask[loop[[0, 12]]] = True
    opened, index = open_surface(surface, mask)
    assert (index[opened.faces] == tip).sum() == 18
    assert loop[20] in index[opened.faces[(index[opened.faces] == tip).any(axis=1)]]


def test_teeth_that_hang_by_one_edge_are_cut_off():
    """A peninsula joined by one edge goes as a whole; a broad one stays, and no inner edge joins rim vertices."""
    surface = closed_grid(12)
    wall = block(*[(i, j) for i in range(6) for j in range(13)], n=12)
    broad = [(i, j) for i in (3, 4, 5) for j in range(4, 8)]
    hanging = [(5, 4), (5, 5), (4, 4), (4, 5), (4, 6), (3, 5), (3, 4), (3, 6)]
    for cells, stays in ((broad, True), (hanging, False)):
        mask = np.append(wall & ~block(*cells, n=12), True)
        opened, index = open_surface(surface, mask)
        assert (3 * 13 + 5 in index) == stays
        assert len(chords(opened)) == 0


@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.4))
@settings(max_examples=60)
def test_any_ragged_mask_leaves_a_disk_without_chords(seed, share):
    surface = sphere()
    mask = np.random.default_rng(seed).random(len(surface.vertices)) < share
    mask |= height(surface) > 0.8
    try:
        opened, index = open_surface(surface, mask)
    except SurfaceError as error:  # one mask in a hundred opens less than it fills
        assert "only a pinhole would open" in str(error)
        return
    require_disk(opened)
    assert len(chords(opened)) == 0 and opened.volume > 0
    np.testing.assert_array_equal(opened.vertices, surface.vertices[index])
    assert (np.diff(index) > 0).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_opening_commutes_with_mirroring_and_renumbering(seed):
    random = np.random.default_rng(seed)
    surface = sphere()
    mask = (random.random(len(surface.vertices)) < 0.1) | (height(surface) > 0.7)
    _, index = open_surface(surface, mask)
    order = random.permutation(len(mask))
    renumbered = mirror(Surface(surface.vertices[order], np.argsort(order)[surface.faces]))
    _, other = open_surface(renumbered, mask[order])
    np.testing.assert_array_equal(np.sort(order[other]), index)


def test_a_second_cut_of_the_rim_of_an_open_surface():
    surface = Surface(*grid(8, 8))
    edge = block(*[(0, j) for j in range(9)], (1, 4))
    opened, index = open_surface(surface, edge)
    assert not edge[index].any() and opened.area == pytest.approx(56 - 1.5 - 2 * 0.5)  # three faces at (1, 4), two ears
    opened, index = open_surface(surface, edge | block((5, 5)))  # the hole is filled again
    assert 5 * 9 + 5 in index


def at(*vertices, but=False):
    """Mask on the sphere: True at the vertices named, or everywhere but there."""
    return np.isin(np.arange(642), vertices) != but


TORUS = Surface(*torus_mesh())
TWO = np.vstack([sphere().vertices, sphere().vertices + 3]), np.vstack([sphere().faces, sphere().faces + 642])
REFUSED = [
    ("cuts nothing.*medial wall", sphere(), at()),
    ("cuts everything.*642 of 642.*--keep", sphere(), ~at()),
    (r"642 booleans.*\(641,\)", sphere(), at()[1:]),
    (r"642 booleans.*int64.*numpy.zeros\(642, bool\)", sphere(), at().astype(int)),
    ("642 booleans", sphere(), np.array([3, 4, 5])),
    # Of scattered holes one would open and the others be filled: that is no medial wall.
    ("only a pinhole would open: 3 of the mask's 4 vertices.*one piece.*smooth", sphere(), at(3, 200, 400, 600)),
    ("shreds.*faces left: 1.*no inner vertex.*smooth", sphere(), at(*sphere().faces[[3, 600]].ravel(), but=True)),
    ("holes inside.*open already.*32 boundary vertices from vertex 0", Surface(*grid(8, 8)), block((4, 4))),
    ("1 handle", TORUS, np.arange(len(TORUS.vertices)) == 40),
    ("2 boundary loops", Surface(*grid(8, 8, hole=[(5, 5)])), block((0, 0), (0, 1), (1, 0))),
    ("2 components.*each hemisphere in a file of its own", TWO, np.append(CAP, CAP)),
]


@pytest.mark.parametrize("message, surface, mask", REFUSED)
def test_masks_that_leave_no_disk_are_refused(message, surface, mask):
    with pytest.raises(SurfaceError, match=message):
        open_surface(surface, mask)


@pytest.mark.parametrize(
    "hemisphere, wall, n_vertices, n_rim", [("left", "cortex", 9204, 136), ("right", "thickness", 9933, 110)]
)
def test_fsaverage5_opens_to_corresponding_disks(hemisphere, wall, n_vertices, n_rim):
    kinds = {kind: fsaverage5(hemisphere, kind, wall) for kind in ("pial", "white", "inflated", "sphere")}
    for surface in kinds.values():
        require_disk(surface)
        require_outward(surface)
        assert (len(surface.vertices), len(surface.boundary)) == (n_vertices, n_rim)
        assert len(chords(surface)) == 0
        np.testing.assert_array_equal(surface.faces, kinds["pial"].faces)
    medial = {"left": 1, "right": -1}[hemisphere] * kinds["sphere"].vertices[:, 0]
    assert medial[kinds["sphere"].boundary].mean() > medial.mean() + 50


def test_fsaverage5_names_what_it_has(monkeypatch):
    for wrong in (("Left", "pial"), ("left", "flat")):
        with pytest.raises(SurfaceError, match="left and right.*pial, white, inflated, sphere"):
            fsaverage5(*wrong)
    with pytest.raises(SurfaceError, match="no wall 'aparc'; walls are cortex and thickness"):
        fsaverage5("left", "pial", "aparc")
    monkeypatch.setattr(sys.modules["qclearn.io.fsaverage"], "find_spec", lambda name: None)
    with pytest.raises(SurfaceError, match="pip install nilearn"):
        fsaverage5("left", "white")
