"""Meshes of the disk that are made, not mapped, and the square beside the disk."""

import numpy as np
import pytest

from meshes import boundary_loop, random_disk
from qclearn.plane.beltrami import signed_areas
from qclearn.plane.grids import POWER, disk_to_square, joined, polar, polar_disk, square_disk, square_to_disk


def test_meshes_are_disks_whose_loop_runs_counter_clockwise_from_its_smallest_vertex(mesh):
    z, faces = mesh
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    assert len(z) - len(edges) + len(faces) == 1
    assert (np.unique(faces) == np.arange(len(z))).all()
    assert (signed_areas(z, faces) > 0).all()
    loop = boundary_loop(faces)
    steps = np.angle(np.roll(z[loop], -1) / z[loop])
    assert loop[0] == loop.min() and (steps > 0).all() and steps.sum() == pytest.approx(2 * np.pi)
    np.testing.assert_allclose(abs(z[loop]), 1, rtol=1e-15)
    assert (abs(np.delete(z, loop)) < 1).all()
    polygon = 0.5 * (np.conj(z[loop]) * np.roll(z[loop], -1)).imag.sum()
    assert signed_areas(z, faces).sum() == pytest.approx(polygon, rel=1e-12)


def test_square_disk_has_its_diagonals_run_into_the_corners():
    """No ear: a triangle with three boundary vertices carries no flux."""
    for n in (2, 4, 16):
        z, faces = square_disk(n)
        assert len(z) == (n + 1) ** 2 and len(faces) == 2 * n * n
        rim = boundary_loop(faces)
        assert np.isin(faces, rim).sum(1).max() == 2
        assert z[n // 2 * (n + 1) + n] == 1 and z[(n * n + 2 * n) // 2] == 0


def test_polar_disk_is_numbered_ring_by_ring():
    nr, nt, power = 5, 12, 1.4
    z, faces = polar_disk(nr, nt, power)
    rings = z[1:].reshape(nr, nt)
    np.testing.assert_allclose(abs(rings), np.repeat(((np.arange(nr) + 1) / nr) ** power, nt).reshape(nr, nt))
    np.testing.assert_allclose(np.exp(1j * np.angle(rings)), np.tile(np.exp(2j * np.pi * np.arange(nt) / nt), (nr, 1)))
    assert z[0] == 0 and z[1 + (nr - 1) * nt] == 1
    assert len(faces) == nt * (2 * nr - 1)


def test_square_and_disk_are_inverse_and_keep_directions():
    w = np.array([0, 1, 1 + 1j, -0.5 + 1j, -1 - 0.2j, 0.3 - 0.1j, -1j])
    z = square_to_disk(w)
    np.testing.assert_allclose(disk_to_square(z), w, atol=1e-15)
    np.testing.assert_allclose(abs(z), np.maximum(abs(w.real), abs(w.imag)), atol=1e-15)
    np.testing.assert_allclose(np.angle(z), np.angle(w), atol=1e-15)
    assert square_to_disk(0j) == 0 and disk_to_square(0j) == 0
    assert disk_to_square(np.exp(0.25j * np.pi)) == pytest.approx(1 + 1j)


def test_the_usual_polar_mesh_is_made_once():
    mesh = polar(8)
    assert polar(8) is mesh and polar(8, 24) is polar(8, 24)
    for ours, plain in zip((mesh.z, mesh.faces), polar_disk(8, 24, POWER)):
        np.testing.assert_array_equal(ours, plain)
    assert len(polar(8, 12).z) == 1 + 8 * 12


def test_joined_points_are_counter_clockwise():
    z, faces = random_disk(seed=3)
    mesh = joined(z)
    assert (mesh.z == z).all() and (mesh.areas > 0).all()
    assert {frozenset(face) for face in mesh.faces.tolist()} == {frozenset(face) for face in faces.tolist()}


@pytest.mark.parametrize("make, sizes, message", [
    *((square_disk, [n], "even") for n in (3, 0, -2)),
    *((polar_disk, sizes, "at least 1 ring and 3 angles") for sizes in ((0, 8), (3, 2))),
])  # fmt: skip
def test_sizes_of_no_disk_are_refused(make, sizes, message):
    with pytest.raises(ValueError, match=message):
        make(*sizes)
