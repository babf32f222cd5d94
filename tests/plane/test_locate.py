"""Where points lie in a disk mesh."""

import numpy as np

from meshes import boundary_loop
from qclearn.plane.beltrami import locate
from qclearn.plane.disk import INSET, KEPT, Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius


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
    # Vertices, and the middles of edges inside; on one of the rim rounding decides.
    ends = np.stack([faces.ravel(), np.roll(faces, -1, axis=1).ravel()], 1)
    inner = ~np.isin(ends, boundary_loop(faces)).all(1)
    points = np.concatenate([z, z[ends[inner]].mean(1)])
    face, barycentric = locate(z, faces, points)
    np.testing.assert_allclose((barycentric * z[faces[face]]).sum(1), points, atol=2e-15)


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
    held = barycentric > 1e-12
    assert held.sum(1).max() <= 2 and np.isin(faces[face][held], boundary_loop(faces)).all()


def test_places_in_a_face_turned_over_have_weights_too():
    z, faces = polar_disk(6, 18)
    z = mobius(z, 0.5 + 0.2j, 0.4)
    face, weights = locate(z, faces[:, ::-1], [0.3 + 0.1j, -0.55j])
    np.testing.assert_allclose((z[faces[:, ::-1][face]] * weights).sum(1), [0.3 + 0.1j, -0.55j], atol=1e-15)
    assert weights.min() >= 0


def test_the_last_answers_are_kept_by_what_the_points_are():
    disk, points = Disk(*polar_disk(4, 12)), np.array([0.1, 0.3j])
    first = face, weights = disk.locate(points)
    assert disk.locate(points.copy()) is first and not (face.flags.writeable or weights.flags.writeable)
    points[0] = -0.7  # in place: other points in the same array
    for moved in (points, *(points * np.exp(1j * k) for k in range(1, KEPT + 2))):
        found, shares = disk.locate(moved)
        np.testing.assert_allclose((shares * disk.z[disk.faces[found]]).sum(1), moved, atol=1e-14)
    assert len(disk.answers) == KEPT
