"""Disk meshes, the square beside the disk, and locating points."""

import numpy as np
import pytest
from meshes import random_disk
from qclearn.plane.diskmesh import (
    INSET,
    Lookup,
    boundary_loop,
    disk_to_square,
    locate,
    polar_disk,
    square_disk,
    square_to_disk,
)

from qclearn.plane.beltrami import signed_areas
from qclearn.plane.mobius import mobius

MESHES = {
    "square 2": square_disk(2),
    "square 16": square_disk(16),
    "polar 1 x 3": polar_disk(1, 3),
    "polar 8 x 24": polar_disk(8, 24),
    "graded": polar_disk(8, 24, 1.5),
    "random": random_disk(seed=3),
}


@pytest.fixture(params=MESHES, ids=str)
def mesh(request):
    return MESHES[request.param]


def test_meshes_are_disks(mesh):
    z, faces = mesh
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert len(z) - len(edges) + len(faces) == 1
    assert (np.unique(faces) == np.arange(len(z))).all()
    assert (signed_areas(z, faces) > 0).all()
    loop = boundary_loop(faces)
    np.testing.assert_allclose(abs(z[loop]), 1, rtol=1e-15)
    assert (abs(np.delete(z, loop)) < 1).all()
    polygon = 0.5 * (np.conj(z[loop]) * np.roll(z[loop], -1)).imag.sum()
    assert signed_areas(z, faces).sum() == pytest.approx(polygon, rel=1e-12)


def test_boundary_loop_runs_counter_clockwise_from_its_smallest_vertex(mesh):
    z, faces = mesh
    loop = boundary_loop(faces)
    assert loop[0] == loop.min() and len(set(loop)) == len(loop)
    steps = np.angle(np.roll(z[loop], -1) / z[loop])
    assert (steps > 0).all() and steps.sum() == pytest.approx(2 * np.pi)


def test_square_disk_has_its_diagonals_run_into_the_corners():
    """No ear: a triangle with three boundary vertices carries no flux."""
    for n in (2, 4, 16):
        z, faces = square_disk(n)
        assert len(z) == (n + 1) ** 2 and len(faces) == 2 * n * n
        rim = boundary_loop(faces)
        assert np.isin(faces, rim).sum(1).max() == 2
        assert z[n // 2 * (n + 1) + n] == 1 and z[(n * n + 2 * n) // 2] == 0


def test_square_disk_needs_an_even_number():
    for n in (3, 0, -2):
        with pytest.raises(ValueError, match="even"):
            square_disk(n)


def test_polar_disk_is_numbered_ring_by_ring():
    nr, nt, power = 5, 12, 1.4
    z, faces = polar_disk(nr, nt, power)
    rings = z[1:].reshape(nr, nt)
    np.testing.assert_allclose(abs(rings), np.repeat(((np.arange(nr) + 1) / nr) ** power, nt).reshape(nr, nt))
    np.testing.assert_allclose(np.exp(1j * np.angle(rings)), np.tile(np.exp(2j * np.pi * np.arange(nt) / nt), (nr, 1)))
    assert z[0] == 0 and z[1 + (nr - 1) * nt] == 1
    assert len(faces) == nt * (2 * nr - 1)


def test_polar_disk_is_invariant_under_one_step():
    nr, nt = 4, 9
    z, faces = polar_disk(nr, nt)
    turned = np.concatenate([[0], 1 + (np.arange(nr)[:, None] * nt + (np.arange(nt) + 1) % nt).ravel()])
    np.testing.assert_allclose(z[turned], z * np.exp(2j * np.pi / nt), atol=1e-15)
    assert {frozenset(f) for f in turned[faces].tolist()} == {frozenset(f) for f in faces.tolist()}


@pytest.mark.parametrize("nr, nt", [(0, 8), (3, 2)])
def test_polar_disk_needs_rings_and_angles(nr, nt):
    with pytest.raises(ValueError, match="at least 1 ring and 3 angles"):
        polar_disk(nr, nt)


def test_square_and_disk_are_inverse_and_keep_directions():
    w = np.array([0, 1, 1 + 1j, -0.5 + 1j, -1 - 0.2j, 0.3 - 0.1j, -1j])
    z = square_to_disk(w)
    np.testing.assert_allclose(disk_to_square(z), w, atol=1e-15)
    np.testing.assert_allclose(abs(z), np.maximum(abs(w.real), abs(w.imag)), atol=1e-15)
    np.testing.assert_allclose(np.angle(z), np.angle(w), atol=1e-15)
    assert square_to_disk(0j) == 0 and disk_to_square(0j) == 0
    assert disk_to_square(np.exp(0.25j * np.pi)) == pytest.approx(1 + 1j)


def test_boundary_loop_refuses_what_is_no_disk():
    z, faces = polar_disk(3, 6)
    closed = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    ring = faces[(faces != 0).all(1)]
    bow_tie = np.array([[0, 1, 2], [0, 3, 4]])
    reversed_face = np.concatenate([faces[:1, ::-1], faces[1:]])
    for wrong in (closed, ring, bow_tie, reversed_face, np.concatenate([faces, faces + len(z)])):
        with pytest.raises(ValueError, match="disk with one simple boundary loop"):
            boundary_loop(wrong)


def test_locate_rebuilds_the_points(mesh):
    z, faces = mesh
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(3), 200)
    expected = rng.integers(len(faces), size=200)
    points = (weights * z[faces[expected]]).sum(1)
    face, barycentric = locate(z, faces, points)
    np.testing.assert_allclose((barycentric * z[faces[face]]).sum(1), points, atol=1e-14)
    assert (barycentric >= 0).all()
    np.testing.assert_allclose(barycentric.sum(1), 1, rtol=1e-14)
    clear = weights.min(1) > 1e-6
    assert (face[clear] == expected[clear]).all()


def test_locate_vertices_and_points_on_edges(mesh):
    """On a boundary edge rounding decides whether a point counts as beyond it and so is moved inwards by INSET."""
    z, faces = mesh
    ends = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], 1)
    on_rim = np.isin(ends, boundary_loop(faces)).all(1)
    points = np.concatenate([z, z[ends].mean(1)])
    face, barycentric = locate(z, faces, points)
    moved = abs((barycentric * z[faces[face]]).sum(1) - points)
    assert moved.max() < 1.01 * INSET
    assert moved[np.append(np.full(len(z), True), ~on_rim)].max() < 2e-15


def test_locate_keeps_points_of_the_open_disk_off_the_boundary(mesh):
    z, faces = mesh
    loop = boundary_loop(faces)
    middle = 0.5 * (z[loop] + np.roll(z[loop], -1))
    points = middle * (1 + 0.5 * (1 / abs(middle) - 1))  # half way from the chord to the arc
    face, barycentric = locate(z, faces, points)
    found = (barycentric * z[faces[face]]).sum(1)
    np.testing.assert_allclose(found, middle * (1 - INSET / 2), atol=1e-14)
    assert (barycentric > 0).all()


def test_locate_moves_points_beyond_a_chord_radially_onto_it(mesh):
    z, faces = mesh
    points = np.exp(1j * np.linspace(-np.pi, np.pi, 400)) * np.linspace(1, 1.2, 400)
    face, barycentric = locate(z, faces, points)
    found = (barycentric * z[faces[face]]).sum(1)
    np.testing.assert_allclose(np.angle(found / points), 0, atol=1e-13)
    loop = set(boundary_loop(faces).tolist())
    on_rim = [
        (barycentric[k] > 1e-12).sum() <= 2
        and {int(v) for v, b in zip(faces[face[k]], barycentric[k]) if b > 1e-12} <= loop
        for k in range(400)
    ]
    assert all(on_rim)


def test_locate_in_a_moved_mesh():
    z, faces = polar_disk(12, 36)
    moved = mobius(z, 0.5 + 0.2j, 0.4)
    face, barycentric = locate(moved, faces, [0j, 1.0, -1.0, 0.999j])
    found = (barycentric * moved[faces[face]]).sum(1)
    np.testing.assert_allclose(found, [0, found[1].real, found[2].real, 1j * found[3].imag], atol=1e-14)
    assert (abs(found[1:]) > 0.95).all()


@pytest.mark.parametrize("shift", [0.0, 0.01, 0.3, 2.0])
def test_a_lookup_finds_the_same_faces_from_a_guess(shift):
    """Where points have moved a little, far, out of the polygon, and where nothing has moved."""
    z, faces = random_disk(3, 64)
    lookup, rng = Lookup(z, faces), np.random.default_rng(0)
    before = np.sqrt(rng.uniform(size=300)) * np.exp(2j * np.pi * rng.uniform(size=300))
    points = before + shift * (rng.normal(size=300) + 1j * rng.normal(size=300))
    points /= np.maximum(abs(points), 1)
    guess, _ = lookup(before)
    for found, expected in zip(lookup(points, guess), locate(z, faces, points)):
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_places_in_a_face_turned_over_have_weights_too():
    z, faces = polar_disk(6, 18)
    face, weights = locate(z, faces[:, ::-1], [0.3 + 0.1j, -0.55j])
    np.testing.assert_allclose((z[faces[:, ::-1][face]] * weights).sum(1), [0.3 + 0.1j, -0.55j], atol=1e-15)
    assert weights.min() >= 0
