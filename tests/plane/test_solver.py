"""The free-boundary disk solver: accuracy on exact maps, its normalisation, its adjoint, its symmetries."""

import numpy as np
import pytest
from scipy import sparse

from exactmaps import DISK_MAPS, SLIDING, SLIDING_THREE, TWIST, after, assert_accuracy, errors, moebius, normalised
from meshes import boundary_loop, random_disk, random_mu
from qclearn.plane.beltrami import BeltramiDiskSolver, signed_areas, solve_beltrami_disk
from qclearn.plane.bijectivity import RepairWarning, check_bijective
from qclearn.plane.checks import BeltramiError
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import mobius
from qclearn.surfaces.conformal import angle_distortion
from qclearn.surfaces.surface import Surface, SurfaceError


def moved_disk(nr, nt, a=0.4 - 0.3j, theta=0.7):
    z, faces = polar_disk(nr, nt)
    return mobius(z, a, theta), faces


MESHES = {
    "square": square_disk(12), "polar": polar_disk(6, 18), "turned": moved_disk(6, 18, 0, 1.1),
    "moved": moved_disk(10, 30), "random": random_disk(seed=4), "random 2": random_disk(seed=5),
}  # fmt: skip


@pytest.fixture(params=MESHES, ids=str)
def mesh(request):
    return MESHES[request.param]


# Accuracy: largest error over all vertices, as measured when the method was worked out.

MEASURED = {  # square grid 32 and 64, polar 32 x 96 and 64 x 192
    "radial stretch": (3.8e-4, 1.3e-4, 1.2e-4, 3.1e-5),
    "twist": (8.6e-4, 2.2e-4, 2.5e-4, 6.3e-5),
    "sliding": (6.3e-4, 1.8e-4, 7.7e-4, 1.9e-4),
    "sliding 3": (7.2e-4, 1.8e-4, 1.1e-3, 2.9e-4),
}


@pytest.mark.parametrize("exact", DISK_MAPS, ids=lambda exact: exact.name)
def test_error_and_rate_against_closed_forms(exact):
    def certified(z, faces, mu):
        f = solve_beltrami_disk(z, faces, mu)
        assert check_bijective(z, faces, f).bijective
        return f

    least = 1.4 if exact.name == "radial stretch" else 1.7
    assert_accuracy(certified, exact, MEASURED[exact.name], least)


@pytest.mark.parametrize("exact", [TWIST, SLIDING], ids=lambda exact: exact.name)
def test_rate_on_meshes_without_structure(exact):
    """The boundary density must know the lengths of the edges: halving the fluxes instead is of first order."""
    coarse, fine = errors(solve_beltrami_disk, exact, *(random_disk(seed=6, n_boundary=n) for n in (32, 256)))
    assert fine < 6e-4 and np.log2(coarse / fine) / 3 > 1.6, (coarse, fine)


def square_with_ears(n):
    """A square grid split the other way: a triangle with three boundary vertices at each corner, without any flux."""
    z, _ = square_disk(n)
    row, column = np.divmod(np.arange(n * n), n)
    a = row * (n + 1) + column
    b, c, d = a + 1, a + n + 2, a + n + 1
    rising = ((row < n // 2) == (column >= n // 2))[:, None]
    halves = ((a, b, c), (a, b, d)), ((a, c, d), (b, c, d))
    return z, np.concatenate([np.where(rising, *(np.stack(half, 1) for half in pair)) for pair in halves])


@pytest.mark.parametrize("exact", DISK_MAPS, ids=lambda exact: exact.name)
def test_ears_do_not_cost_the_rate(exact):
    """Uncalibrated steps leave an error of first order here, 4e-3 to 6e-3 at 64."""
    meshes = [square_with_ears(n) for n in (32, 64)]
    assert [np.isin(faces, boundary_loop(faces)).all(1).sum() for _, faces in meshes] == [4, 4]
    coarse, fine = errors(solve_beltrami_disk, exact, *meshes)
    least = 1.4 if exact.name == "radial stretch" else 1.7
    assert fine < 6e-4 and np.log2(coarse / fine) >= least, (coarse, fine)


def test_rate_with_a_coefficient_seen_through_a_mobius_map():
    """g = N after f after M, with N back to g(0) = 0, g(1) = 1: another pole for the same coefficient."""
    exact = normalised(after(SLIDING_THREE, moebius(0.3 + 0.2j, 0.8)))
    coarse, fine = errors(solve_beltrami_disk, exact, polar_disk(16, 48), polar_disk(32, 96))
    assert fine < 3.5e-3 and np.log2(coarse / fine) >= 1.7, (coarse, fine)


# Normalisation.


def value_at(z, faces, f, point):
    """The piecewise linear f at a point, by a search over all faces (not by `locate`)."""
    after, last = (np.roll(z[faces] - point, -k, axis=1) for k in (1, 2))
    weights = (after.conj() * last).imag / (2 * signed_areas(z, faces)[:, None])
    face = weights.min(1).argmax()
    return weights[face] @ f[faces[face]]


def angle_at_one(z, faces, f):
    """The angle of f at the boundary point 1, linear in the angle along the edge that holds it."""
    loop = boundary_loop(faces)
    order = np.argsort(np.angle(z[loop]))
    angle, image = np.angle(z[loop[order]]), f[loop[order]]
    near = np.argmin(abs(angle))
    return np.interp(0.0, angle, np.angle(image[near]) + np.angle(image / image[near]))


@pytest.mark.parametrize("largest", [0.0, 0.7])
def test_zero_and_one_are_held_and_the_circle_is_kept(mesh, largest):
    z, faces = mesh
    f = solve_beltrami_disk(z, faces, random_mu(np.random.default_rng(1), z, faces, largest))
    assert abs(value_at(z, faces, f, 0j)) < 5e-15
    assert abs(angle_at_one(z, faces, f)) < 1e-14
    np.testing.assert_allclose(abs(f[boundary_loop(faces)]), 1, rtol=1e-15)


def test_no_coefficient_gives_the_identity(mesh):
    z, faces = mesh
    assert abs(solve_beltrami_disk(z, faces, np.zeros(len(faces))) - z).max() < 6e-4


def test_identity_is_exact_on_the_boundary_of_a_polar_mesh():
    z, faces = polar_disk(6, 18)
    np.testing.assert_allclose(solve_beltrami_disk(z, faces, np.zeros(len(faces)))[-18:], z[-18:], atol=1e-13)


# Symmetries.


@pytest.mark.parametrize("phi", [0.3, 2.0, -2.9])
def test_rotation_of_the_source(mesh, phi):
    """f~(z) = f(exp(-i phi) z) up to the rotation that brings 1 to 1; mu turns with exp(2i phi)."""
    z, faces = mesh
    mu = random_mu(np.random.default_rng(2), z, faces, 0.6)
    f = solve_beltrami_disk(z, faces, mu)
    turned = solve_beltrami_disk(np.exp(1j * phi) * z, faces, np.exp(2j * phi) * mu)
    back = angle_at_one(np.exp(1j * phi) * z, faces, f)
    np.testing.assert_allclose(turned, np.exp(-1j * back) * f, atol=1e-11)


def test_reflection(mesh):
    z, faces = mesh
    mu = random_mu(np.random.default_rng(3), z, faces, 0.6)
    mirrored = solve_beltrami_disk(z.conj(), faces[:, ::-1], mu.conj())
    np.testing.assert_allclose(mirrored, solve_beltrami_disk(z, faces, mu).conj(), atol=1e-11)


def test_vertex_numbering_does_not_matter():
    z, faces = MESHES["random"]
    mu = random_mu(np.random.default_rng(3), z, faces, 0.6)
    order = np.random.default_rng(0).permutation(len(z))
    renumbered = solve_beltrami_disk(z[order], np.argsort(order)[faces], mu)
    np.testing.assert_allclose(renumbered, solve_beltrami_disk(z, faces, mu)[order], atol=1e-11)


def backward_problem():
    """A coefficient that jumps from face to face, on a mesh with obtuse angles: some fluxes turn negative."""
    z, faces = MESHES["random"]
    rng = np.random.default_rng(5)
    return (z, faces, 0.9 * np.sqrt(rng.uniform(size=len(faces))) * np.exp(2j * np.pi * rng.uniform(size=len(faces))))


@pytest.mark.digits
def test_backward_steps_are_raised_and_reported():
    z, faces, mu = backward_problem()
    solver = BeltramiDiskSolver(z, faces)
    f = solver.solve(mu)
    loop = solver.loop
    steps = np.angle(np.roll(f[loop], -1) / f[loop])
    assert solver.floored == 3
    assert (steps > 0).all() and steps.sum() == pytest.approx(2 * np.pi)
    with pytest.warns(RepairWarning, match="3 boundary steps ran backwards or were lost"):
        assert (solve_beltrami_disk(z, faces, mu) == f).all()


def test_boundary_goes_forwards_even_where_0_leaves_the_disk():
    """A hopeless coefficient: the value at 0 lies outside the circle and no Möbius map of the disk brings it to 0."""
    z, faces = random_disk(seed=3, n_boundary=16)
    rng = np.random.default_rng(137)
    solver = BeltramiDiskSolver(z, faces)
    f = solver.solve(0.99 * np.exp(2j * np.pi * rng.uniform(size=len(faces))))
    assert abs(value_at(z, faces, f, 0j)) > 1
    steps = np.angle(np.roll(f[solver.loop], -1) / f[solver.loop]) % (2 * np.pi)  # one is more than half a turn
    assert steps.sum() == pytest.approx(2 * np.pi)
    assert not check_bijective(z, faces, f).bijective


# The adjoint and the tangent.


def random_complex(rng, size):
    return rng.normal(size=size) + 1j * rng.normal(size=size)


def assert_tangent(solver, mu, change, step=1e-5):
    """The pushforward at mu is the central difference of fourth order, and the pullback its transpose."""
    shifted = {k: solver.solve(mu + k * step * change) for k in (-2, -1, 1, 2)}
    expected = (shifted[-2] - 8 * shifted[-1] + 8 * shifted[1] - shifted[2]) / (12 * step)
    solver.solve(mu)
    df = solver.pushforward(change)
    np.testing.assert_allclose(df, expected, atol=1e-7 * abs(expected).max())
    grad_f = random_complex(np.random.default_rng(3), len(df))
    there, back = np.vdot(grad_f, df).real, np.vdot(solver.pullback(grad_f), change).real
    assert there == pytest.approx(back, rel=1e-12, abs=1e-12 * np.linalg.norm(grad_f) * np.linalg.norm(df))


@pytest.mark.parametrize("largest", [0.0, 0.6])
@pytest.mark.digits
def test_pushforward_equals_finite_differences_and_pullback_is_its_transpose(mesh, largest):
    z, faces = mesh
    rng = np.random.default_rng(7)
    mu = random_mu(rng, z, faces, largest)
    assert_tangent(BeltramiDiskSolver(z, faces), mu, random_complex(rng, len(faces)))


@pytest.mark.digits
def test_pushforward_and_pullback_with_raised_steps():
    z, faces, mu = backward_problem()
    assert_tangent(BeltramiDiskSolver(z, faces), mu, random_complex(np.random.default_rng(1), len(faces)), 1e-6)


@pytest.mark.digits
def test_many_at_once_are_many_and_changes_keep_zero_one_and_the_circle():
    z, faces = MESHES["polar"]
    rng = np.random.default_rng(0)
    solver = BeltramiDiskSolver(z, faces)
    f = solver.solve(random_mu(rng, z, faces, 0.5))
    for ask, size in ((solver.pullback, len(z)), (solver.pushforward, len(faces))):
        given = random_complex(rng, (3, size))
        many = ask(given)
        np.testing.assert_allclose(many, [ask(one) for one in given], rtol=1e-10, atol=1e-13)
    assert abs(many[:, z == 0]).max() < 1e-12 and abs(many[:, z == 1]).max() < 1e-12
    assert abs((many * f.conj())[:, -18:].real).max() < 1e-12


WHEEL, FACES = polar_disk(4, 12)


@pytest.mark.parametrize("z, faces, message", [
    (np.append(WHEEL[:-3], [0.99 * WHEEL[-3], *WHEEL[-2:]]), FACES, "boundary vertex 46 is 1.0e-02 off the unit"),
    (np.exp(2j * np.pi * np.arange(3) / 3), [[0, 1, 2]], "no interior vertex"),
    (np.append(WHEEL, 0.2j), FACES, r"vertices \[49\] are in no face"),
    (
        np.append(np.exp([-0.6j, 0.5j, 1.8j]), 0.7 + 0.2j),
        [[0, 1, 3], [1, 2, 3], [2, 0, 3]],
        "does not cover 0: boundary vertex 2",
    ),
])  # fmt: skip
def test_meshes_without_a_map_are_refused(z, faces, message):
    with pytest.raises((SurfaceError, BeltramiError), match=message):
        BeltramiDiskSolver(z, np.array(faces))


def test_angle_distortion_has_the_angle_of_its_own_corner():
    surface = Surface([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[1, 2, 0]])
    distortion = angle_distortion(surface, np.array([0, 1, np.exp(1j * np.pi / 3)]))
    np.testing.assert_allclose(distortion, [[15, 15, -30]], atol=1e-12)


def test_angle_distortion_is_accurate_on_slivers():
    height = 1e-9
    surface = Surface([[0, 0, 0], [1, 0, 0], [0.5, height, 0]], [[0, 1, 2]])
    distortion = angle_distortion(surface, np.array([0, 1, 0.5 + 1j * height]))
    np.testing.assert_allclose(distortion, 0, atol=1e-12)
    flat = angle_distortion(surface, np.array([0, 1, np.exp(1j * np.pi / 3)]))
    np.testing.assert_allclose(flat, [[60, 60, -120]], atol=1e-6)


def test_adjoints_are_those_of_the_pullback_and_of_i_times_its_gradients():
    """The two ways to the gradient: three potentials with their sparse matrices, and face by face at once."""
    z, faces = random_disk(2)
    rng = np.random.default_rng(0)
    solver = BeltramiDiskSolver(z, faces)
    solver.solve(random_mu(rng, z, faces, 0.5))
    grads = sparse.random_array((4, len(z)), density=0.1, rng=rng, format="csr") * (1 + 0.7j)
    grads.data *= np.exp(6j * rng.uniform(size=grads.nnz))
    dense = grads.toarray()
    expected = solver.pullback(np.concatenate([dense, 1j * dense]))
    found = sum(by_mu @ lam for by_mu, lam in zip(solver.sensitivities, solver.adjoints(grads)))
    np.testing.assert_allclose(found.T, expected, atol=1e-11 * abs(expected).max())
