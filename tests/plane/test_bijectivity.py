"""The certificate, its rounding, and the repair by row switching."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from exactmaps import SLIDING
from meshes import boundary_loop, random_disk, strip
from operations import lines_run
from qclearn.plane.beltrami import BeltramiDiskSolver, signed_areas, stiffness
from qclearn.plane.bijectivity import check_bijective, check_embedding, mean_value_matrix, repair
from qclearn.plane.checks import BeltramiError
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.linear import edge_lengths

Z, FACES = DISK = random_disk(seed=1)


def bent(w, turns):
    """The rectangle bent along a circle, its first side at angle 0, its lower side outside."""
    return (1 - 0.4 * w.imag) * np.exp(2j * np.pi * turns * w.real)


# The certificate.


def test_flipped_faces_are_named():
    f = SLIDING(Z)
    inner = abs(Z).argmin()
    f[inner] += 0.4
    certificate = check_bijective(Z, FACES, f)
    assert not certificate.bijective and certificate.boundary
    assert certificate.flipped.tolist() == np.flatnonzero(signed_areas(f, FACES) < 0).tolist()
    assert 0 < len(certificate.flipped) < 10 and (FACES[certificate.flipped] == inner).any(1).all()


def doubled():
    """A disk wound around 0 twice."""
    z, faces = polar_disk(4, 25)
    return z, faces, np.divide(z**2, abs(z), out=np.zeros_like(z), where=z != 0)


def rectangle(turns, slope=0.0, touching=False):
    """A rectangle bent into a ring, or a spiral; its first and last corner made one."""
    w, faces = strip()
    f = bent(w, turns) * (1 - slope * w.real)
    f[w == 1] = f[w == 0] if touching else f[w == 1]
    return w, faces, f


@pytest.mark.parametrize("made, bijective", [
    (doubled(), False),
    (rectangle(1.2, 0.1), False),  # the spiral crosses itself
    (rectangle(0.95, touching=True), False),
    (rectangle(0.95), True),  # an image need not be convex
    (rectangle(1.4, 0.7), True),
], ids=["wound twice", "crossing", "touching", "ring", "spiral"])  # fmt: skip
def test_of_maps_whose_triangles_are_positive_the_boundary_decides(made, bijective):
    z, faces, f = made
    assert (signed_areas(f, faces) > 0).all()
    certificate = check_bijective(z, faces, f)
    assert len(certificate.flipped) == 0 and certificate.boundary == certificate.bijective == bijective


@pytest.mark.parametrize("value", [np.nan, np.inf, complex(0, np.nan)])
@pytest.mark.parametrize("vertex", ["inner", "boundary"])
def test_not_finite_is_not_bijective(value, vertex):
    f = Z.copy()
    index = boundary_loop(FACES)[3] if vertex == "boundary" else abs(Z).argmin()
    f[index] = value
    with np.errstate(invalid="ignore"):
        certificate = check_bijective(Z, FACES, f)
    assert not certificate.bijective
    assert set(np.flatnonzero((index == FACES).any(1))) <= set(certificate.flipped.tolist())


# Rounding: the sign of a nearly flat triangle, decided in rational numbers.


def exact_double_area(a, b, c):
    (ax, ay), (bx, by), (cx, cy) = ((Fraction(float(p.real)), Fraction(float(p.imag))) for p in (a, b, c))
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


STAR = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def stars(count, seed, scales=(-160.0, -9.0, 0.0, 9.0, 150.0)):
    """Quadrangles with a vertex on one of their sides, to within a few units in the last place: complex (count, 5)."""
    rng = np.random.default_rng(seed)
    rim = np.array([0, 1.3, 1.2 + 1.1j, -0.1 + 1j]) + 0.1 * (
        rng.normal(size=(count, 4)) + 1j * rng.normal(size=(count, 4))
    )
    side, share = rng.integers(0, 4, count), rng.uniform(0.05, 0.95, count)
    a, b = (np.take_along_axis(rim, ((side + k) % 4)[:, None], 1)[:, 0] for k in (0, 1))
    inner = a + share * (b - a) + 1j * (b - a) * rng.integers(-3, 4, count) * 2.0 ** -rng.integers(51, 56, count)
    return np.column_stack([rim, inner]) * 10.0 ** rng.choice(scales, count)[:, None]


def sound(star):
    return all(exact_double_area(*star[face]) > 0 for face in STAR)


def test_stars_at_the_edge_of_rounding_are_judged_as_in_rational_numbers():
    """No false claim and no false refusal, of the picture and of the source."""
    single = stars(100, 4, (-3.0, 0.0)).astype(np.complex64)  # judged as the doubles that they are
    many = np.concatenate([stars(150, 3), single])
    truth = [sound(star) for star in many]
    assert 30 < sum(truth) < 220
    assert [check_embedding(STAR, star).bijective for star in many] == truth
    good = np.array([0, 1, 1 + 1j, 1j, 0.5 + 0.5j])
    for star, right in zip(many, truth):
        if right:
            assert check_bijective(star, STAR, good).bijective
        else:
            with pytest.raises(BeltramiError, match="cannot be certified"):
                check_bijective(star, STAR, good)


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int16, np.uint16, np.int32, np.uint64])
def test_small_integers_index_as_large_ones_do(kind):
    z, faces = polar_disk(5, 24)
    assert check_bijective(z, faces.astype(kind), z.astype(np.complex64)).bijective
    assert boundary_loop(faces.astype(kind)).tolist() == boundary_loop(faces).tolist()


coordinates = st.floats(-1, 1, allow_subnormal=True) | st.sampled_from([0.0, 1.0, 1 + 2**-52, 2**-53, 1e-300, -1e150])


@given(st.tuples(*[st.tuples(coordinates, coordinates)] * 3))
@example(((5e-324, 0.0), (-1.7e308, 1.0), (1.0, 5e-324)))
@settings(max_examples=60)
def test_a_triangle_turns_over_when_two_corners_are_exchanged(corners):
    f = np.array([complex(*corner) for corner in corners])
    area = exact_double_area(*f)
    for faces, sound in (([[0, 1, 2]], area > 0), ([[0, 2, 1]], area < 0)):
        disk = Disk(f, np.array(faces))
        assert (len(disk.flipped) == 0) == sound and set(disk.flipped) <= set(disk.maybe_flipped)


def test_a_whole_mesh_in_doubt_costs_little_a_vertex():
    """Every triangle on one line, the worst that can be asked: three lines of Python a vertex, none a triangle."""
    z, faces = polar_disk(40, 60)
    disk = Disk((1 + 0.5j) * z.real, faces)
    assert lines_run(lambda: disk.flipped) < 4 * len(z)
    assert len(disk.flipped) > 0.9 * len(faces)


@pytest.mark.parametrize(
    "scale, shift, height", [(1, 0, 1e-13), (1e-8, 0, 1e-13), (1e8, 0, 1e-13), (1e-6, 0.7 - 0.2j, 1e-8)]
)
def test_thin_triangles_beyond_doubt_are_not_flipped(scale, shift, height):
    """Wherever a triangle lies, as long as its coordinates resolve its height (in parts of its length)."""
    f = shift + scale * np.exp(0.4j) * np.array([0, 1, 0.4 + 1j * height, 0.4 - 1j * height])
    assert Disk(f, np.array([[0, 1, 2], [0, 1, 3]])).maybe_flipped.tolist() == [1]


def test_mean_value_rows_are_averages_that_reproduce_linear_functions():
    """Floater's property at every interior vertex, in the plane of the mesh and in the metric of a constant mu."""
    inner = np.setdiff1d(np.arange(len(Z)), boundary_loop(FACES))
    for picture in (Z + (0.5 - 0.3j) * Z.conj(), Z):
        matrix = mean_value_matrix(Disk(picture, FACES), edge_lengths(picture[FACES])).toarray()
        assert abs(matrix @ picture)[inner].max() < 1e-13
    np.testing.assert_allclose(np.diag(matrix), 1, rtol=1e-14)
    np.testing.assert_allclose(matrix.sum(1), 0, atol=1e-13)
    off = matrix - np.diag(np.diag(matrix))
    edges = np.zeros(off.shape, bool)
    edges[FACES, np.roll(FACES, 1, axis=1)] = edges[FACES, np.roll(FACES, -1, axis=1)] = True
    assert ((off < 0) == edges).all()


@pytest.mark.parametrize("height", [1e-5, 1e-9, 1e-12, 0.0])
def test_mean_value_rows_of_slivers_stay_positive(height):
    z = np.array([0, 1, 0.5 + 1j * height, 0.5 + 1j, 0.5 - 1j])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 0, 2], [0, 4, 1]])
    matrix = mean_value_matrix(Disk(z, faces), edge_lengths(z[faces])).toarray()
    assert np.isfinite(matrix).all()
    assert (matrix[2, [0, 1, 3]] < 0).all() and matrix[2].sum() == pytest.approx(0, abs=1e-12)


def folding_problem(seed):
    """A coefficient that jumps from face to face and folds the disk map: (z, faces, mu, f, metric edge lengths)."""
    rng = np.random.default_rng(seed)
    mu = 0.93 * np.sqrt(rng.uniform(size=len(FACES))) * np.exp(2j * np.pi * rng.uniform(size=len(FACES)))
    f = BeltramiDiskSolver(Z, FACES).solve(mu)
    edges = np.roll(Z[FACES], -1, axis=1) - np.roll(Z[FACES], -2, axis=1)
    return Z, FACES, mu, f, abs(edges + mu[:, None] * edges.conj())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.digits
def test_repair_unfolds(seed):
    z, faces, mu, f, lengths = folding_problem(seed)
    before = check_bijective(z, faces, f)
    assert len(before.flipped) and before.boundary
    matrix = stiffness(z, faces, mu)
    picture, switched, problem, _ = repair(matrix, Disk(f, faces), lengths)
    mended = picture.z
    assert check_bijective(z, faces, mended).bijective
    loop = boundary_loop(faces)
    assert (mended[loop] == f[loop]).all()
    # Every interior row is either the Beltrami equation or an average, and what was flipped is switched.
    kept = np.setdiff1d(np.arange(len(z)), np.concatenate([loop, switched]))
    assert len(kept) > 0.2 * len(z) and len(np.intersect1d(switched, loop)) == 0
    assert abs(matrix @ mended)[kept].max() < 1e-11 * matrix.diagonal().max()
    assert abs(mean_value_matrix(Disk(z, faces), lengths) @ mended)[switched].max() < 1e-12
    assert np.isin(np.setdiff1d(faces[before.flipped], loop), switched).all()
    np.testing.assert_allclose(problem.solve(f[loop]), mended, atol=1e-12)


def test_repair_goes_one_ring_further_where_a_flip_survives_on_switched_rows():
    _, faces, mu, f, lengths = folding_problem(0)
    picture = Disk(f, faces)
    first = np.setdiff1d(faces[picture.maybe_flipped], picture.loop)
    mended, switched, *_ = repair(stiffness(*DISK, mu), picture, lengths, first)
    ring = np.setdiff1d(faces[np.isin(faces, first).any(1)], picture.loop)
    assert set(ring) <= set(switched.tolist()) and len(ring) > len(first)
    assert mended.certificate.bijective


def test_nothing_to_repair():
    disk = Disk(*DISK)
    picture = disk.at(SLIDING(disk.z))
    mended, switched, problem, _ = repair(disk.laplace, picture, edge_lengths(disk.z[disk.faces]))
    assert mended is picture and len(switched) == 0 and problem is None


@pytest.mark.parametrize("chord", [False, True])
def test_repair_ends_where_it_cannot_help(chord):
    """A folded boundary survives every row; with a chord across the mesh the rows beyond it are out of reach."""
    z, faces = polar_disk(3, 9)
    first, second = boundary_loop(faces)[:2]
    if chord:
        faces = np.concatenate([faces, [[first, 28, 29], [28, second, 29], [second, first, 29]]])
        z = np.append(z, np.array([1.5, 1.1]) * np.exp(1j * np.pi / 9))
    f = z.copy()
    f[first + 5], f[1] = 0.9, 2  # a boundary vertex drawn across the disk
    disk = Disk(z, faces)
    mended, switched, *_ = repair(disk.laplace, disk.at(f), edge_lengths(z[faces]))
    assert not mended.certificate.bijective
    assert 0 < len(switched) <= 19
