"""`Disk`: what a mesh of the disk is asked for, and what it refuses when it is asked."""

import pickle

import numpy as np
import pytest

from exactmaps import SLIDING
from meshes import boundary_loop, random_disk
from qclearn.plane.checks import BeltramiError
from qclearn.plane.disk import OF_FACES, Disk
from qclearn.plane.grids import polar_disk

# The value.


def test_the_arrays_cannot_be_changed_and_the_callers_can():
    z, faces = polar_disk(3, 9)
    disk = Disk(z.astype(np.complex64), faces.astype(np.uint8))
    assert disk.z.dtype == complex and disk.faces.dtype == np.int64
    for array in (disk.z, disk.faces, disk.at(z).z):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    mine = Disk(z, faces)
    z[0], faces[0] = 9, 0
    assert mine.z[0] == 0 and mine.faces[0].tolist() == [0, 1, 2]
    view = mine.z[:]  # read-only arrays of somebody who may write to what they are a view of are copied
    assert Disk(mine.z, mine.faces).z is mine.z and Disk(view, mine.faces).z is not view


def test_a_pickle_has_the_arrays_alone():
    disk = Disk(*random_disk(seed=3))
    _ = disk.certificate, disk.locate(np.array([0.1j])), disk.laplace
    copy = pickle.loads(pickle.dumps(disk))
    assert set(vars(copy)) == {"z", "faces"} and not copy.z.flags.writeable
    np.testing.assert_array_equal(copy.z, disk.z)
    np.testing.assert_array_equal(copy.faces, disk.faces)


def test_a_picture_shares_what_depends_on_the_faces_alone():
    disk = Disk(*random_disk(seed=3))
    f = SLIDING(disk.z)
    before = disk.at(f)
    assert set(vars(before)) == {"z", "faces"} and before.faces is disk.faces
    _ = disk.gradients, disk.certificate, disk.locate(np.array([0.1j]))
    picture = disk.at(f)
    assert set(vars(picture)) == {"z", "faces", *OF_FACES}
    assert all(getattr(picture, name) is getattr(disk, name) for name in OF_FACES)
    for fresh in (before, Disk(f, disk.faces)):
        np.testing.assert_array_equal(fresh.loop, picture.loop)
        np.testing.assert_array_equal(fresh.areas, picture.areas)


@pytest.mark.parametrize("f, message", [
    (np.zeros(18), r"f has shape \(18,\): give a value for each of 17 vertices"),
    (np.zeros((17, 3)), r"f has shape \(17, 3\): give complex numbers"),
    (["a"] * 17, "f must be complex numbers"),
])  # fmt: skip
def test_a_picture_has_one_complex_number_a_vertex(f, message):
    with pytest.raises(BeltramiError, match=message):
        Disk(*polar_disk(2, 8)).at(f)


# What is wrong is said when it is asked for.


def test_a_folded_mesh_has_areas_and_folds_but_no_gradients():
    z, faces = polar_disk(2, 8)
    disk = Disk(np.where(np.arange(17) == 1, 5, z), faces)
    assert 0 < (disk.areas < 0).sum() == len(disk.flipped) and not disk.certificate.bijective
    for ask in (lambda: disk.gradients, lambda: disk.laplace, lambda: disk.coefficient(z)):
        with pytest.raises(BeltramiError, match="source triangles are not counter-clockwise"):
            ask()


def test_points_that_are_not_finite_lie_nowhere():
    with pytest.raises(BeltramiError, match=r"points \[1\] are not finite"):
        Disk(*polar_disk(2, 8)).locate([0.1, np.nan])


# The boundary, and what lies across an edge.


def test_boundary_loop_refuses_what_is_no_disk():
    z, faces = polar_disk(3, 6)
    closed = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    ring = faces[(faces != 0).all(1)]
    assert (Disk(z, ring).areas > 0).all() and np.isfinite(Disk(z, ring).gradients).all()
    bow_tie = np.array([[0, 1, 2], [0, 3, 4]])
    reversed_face = np.concatenate([faces[:1, ::-1], faces[1:]])
    for wrong in (closed, ring, bow_tie, reversed_face, np.concatenate([faces, faces + len(z)])):
        with pytest.raises(ValueError, match="disk with one simple boundary loop"):
            boundary_loop(wrong)


def test_the_face_across_from_a_corner_has_the_other_two(mesh):
    disk = Disk(*mesh)
    inside = np.argwhere(disk.across >= 0)
    for face, corner in inside:
        others = set(np.delete(disk.faces[face], corner).tolist())
        assert others < set(disk.faces[disk.across[face, corner]].tolist())
    assert (disk.across < 0).sum() == len(disk.loop) == len(disk.open_halfedges)


# Between vertices, faces and points.


def test_the_mass_matrix_integrates_products():
    disk = Disk(*polar_disk(40, 160))
    assert disk.mass.sum() == pytest.approx(disk.areas.sum())
    assert (disk.z.conj() @ (disk.mass @ disk.z)).real == pytest.approx(np.pi / 2, rel=2e-3)


def test_values_go_from_vertices_to_faces_and_back_by_area(mesh):
    disk = Disk(*mesh)
    np.testing.assert_allclose(disk.to_faces @ disk.z, disk.centroids, atol=1e-15)
    value, vertex = np.random.default_rng(0).normal(size=len(disk.faces)), disk.faces[0, 0]
    around = (disk.faces == vertex).any(1)
    expected = np.average(value[around], weights=disk.areas[around])
    assert (disk.to_vertices @ value)[vertex] == pytest.approx(expected, rel=1e-12)


def test_samples_are_exact_for_linear_functions():
    disk, points = Disk(*random_disk(seed=3)), np.array([0.1, -0.4 + 0.3j, 0.7j])
    values = (2 - 1j) * disk.z + 0.5j * disk.z.conj() + 3
    expected = (2 - 1j) * points + 0.5j * points.conj() + 3
    np.testing.assert_allclose(disk.interpolation(points) @ values, expected, atol=1e-13)
    np.testing.assert_allclose(disk.interpolate(values, disk.locate(points)), expected, atol=1e-13)
    both = disk.interpolate(np.stack([values.real, values.imag], 1), disk.locate(points))
    np.testing.assert_allclose(both @ [1, 1j], expected, atol=1e-13)
