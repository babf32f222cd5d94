"""The Beltrami core against closed forms, against LaPy and libigl, and against itself by a second route."""

import igl
import lapy
import lapy.conformal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from exactmaps import DISK_MAPS, RADIAL, SLIDING, affine, after, moebius, sliding_three, twist
from meshes import boundary_loop, random_disk, random_mu
from qclearn.plane.beltrami import (
    beltrami_coefficient,
    hat_gradients,
    jacobian,
    signed_areas,
    solve_beltrami,
    solve_beltrami_disk,
    stiffness,
    wirtinger,
)
from qclearn.plane.checks import BeltramiError
from qclearn.plane.coefficients import compose_coefficients, diffuse, inverse_coefficient
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.linear import cotangent_stiffness

Z, FACES = DISK = random_disk(seed=1)
below_one = st.builds(lambda r, t: r * np.exp(1j * t), st.floats(0, 0.95), st.floats(0, 2 * np.pi))


def space(z):
    return np.stack([z.real, z.imag, np.zeros(len(z))], axis=1)


# The catalogue itself: derivatives against central differences.

CATALOGUE = DISK_MAPS + [
    affine(2 + 1j, 0.7 - 0.4j, 3),
    moebius(0.3 - 0.4j, 1.1),
    after(moebius(0.5j, 0.3), SLIDING),
    after(RADIAL, twist(-0.4)),
    after(sliding_three(0.2), SLIDING),
]


@pytest.mark.parametrize("exact", CATALOGUE, ids=lambda exact: exact.name)
def test_catalogue_derivatives(exact):
    rng = np.random.default_rng(0)
    z, h = np.sqrt(rng.uniform(0.02, 0.98, 200)) * np.exp(2j * np.pi * rng.uniform(size=200)), 1e-5
    f_x = (exact(z + h) - exact(z - h)) / (2 * h)
    f_y = (exact(z + 1j * h) - exact(z - 1j * h)) / (2 * h)
    np.testing.assert_allclose(exact.f_z(z), (f_x - 1j * f_y) / 2, atol=2e-8)
    np.testing.assert_allclose(exact.f_zbar(z), (f_x + 1j * f_y) / 2, atol=2e-8)


# Derivatives.


def test_hat_gradients_are_the_papers_mended_formula():
    g, h = Z.real[FACES], Z.imag[FACES]
    area = signed_areas(Z, FACES)[:, None]
    A = (np.roll(h, -1, 1) - np.roll(h, -2, 1)) / (2 * area)
    B = (np.roll(g, -2, 1) - np.roll(g, -1, 1)) / (2 * area)
    np.testing.assert_allclose(hat_gradients(Z, FACES), A + 1j * B, rtol=1e-12)


def test_affine_map_is_recovered():
    exact = affine(1.2 - 0.5j, 0.3 + 0.6j, 2j)
    f_z, f_zbar = wirtinger(Z, FACES, exact(Z))
    np.testing.assert_allclose(f_z, 1.2 - 0.5j, atol=1e-12)
    np.testing.assert_allclose(f_zbar, 0.3 + 0.6j, atol=1e-12)
    np.testing.assert_allclose(beltrami_coefficient(Z, FACES, exact(Z)), exact.mu(Z[:1])[0], atol=1e-12)


@pytest.mark.parametrize("exact", DISK_MAPS, ids=lambda exact: exact.name)
def test_coefficient_of_the_interpolant_converges(exact):
    errors = []
    for n in (16, 32):
        z, faces = square_disk(n)
        error = abs(beltrami_coefficient(z, faces, exact(z)) - exact.on_faces(Disk(z, faces)))
        errors.append(np.sqrt(np.average(error**2, weights=signed_areas(z, faces))))
    assert errors[1] < 0.025 and np.log2(errors[0] / errors[1]) > 0.85


def test_jacobian_is_the_ratio_of_areas_with_its_sign():
    f = SLIDING(Z)
    f[FACES[7, 0]] += 0.5  # folds something
    ratio = signed_areas(f, FACES) / signed_areas(Z, FACES)
    assert (ratio < 0).any()
    np.testing.assert_allclose(jacobian(Z, FACES, f), ratio, atol=1e-12)
    assert ((abs(beltrami_coefficient(Z, FACES, f)) > 1) == (ratio < 0)).all()


def test_coefficient_of_an_anticonformal_map_is_infinite():
    z, faces = polar_disk(1, 4)
    assert np.isinf(abs(beltrami_coefficient(z, faces, np.conj(z)))).all()


def test_surface_target_of_a_lifted_plane_has_the_planar_coefficient():
    f = SLIDING(Z)
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    lifted = 3.0 * space(f) @ turned.T + [1.0, -2.0, 5.0]
    np.testing.assert_allclose(beltrami_coefficient(Z, FACES, lifted), beltrami_coefficient(Z, FACES, f), atol=1e-12)


def test_surface_target_is_the_papers_formula_and_hides_folds():
    points = np.stack([Z.real, Z.imag + Z.real**2, np.sin(3 * Z.imag)], 1)
    gradients = hat_gradients(Z, FACES)
    x, y = (np.einsum("fk,fkc->fc", part, points[FACES]) for part in (gradients.real, gradients.imag))
    E, F, G = (x * x).sum(1), (x * y).sum(1), (y * y).sum(1)
    expected = (E - G + 2j * F) / (E + G + 2 * np.sqrt(E * G - F**2))
    np.testing.assert_allclose(beltrami_coefficient(Z, FACES, points), expected, atol=1e-12)
    assert abs(beltrami_coefficient(Z, FACES, space(np.conj(SLIDING(Z))))).max() < 1


MOVE = moebius(0.3 + 0.4j, 2.0)
PAIRS = [(RADIAL, SLIDING), (SLIDING, RADIAL), (twist(0.6), sliding_three(0.2)), (SLIDING, MOVE), (MOVE, SLIDING)]


@pytest.mark.parametrize("f, g", PAIRS, ids=lambda exact: exact.name)
def test_composition_against_the_chain_rule(f, g):
    z = Z[abs(Z) > 0.05]
    composed = compose_coefficients(f.mu(z), f.f_z(z), g.mu(f(z)))
    np.testing.assert_allclose(composed, after(g, f).mu(z), atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(below_one, below_one, st.floats(0, 2 * np.pi))
def test_composition_stays_below_one_and_undoes_itself(mu_f, mu_g, angle):
    f_z = 0.7 * np.exp(1j * angle)
    composed = compose_coefficients(mu_f, f_z, mu_g)
    assert abs(composed) < 1
    assert abs(compose_coefficients(mu_f, f_z, inverse_coefficient(mu_f, f_z))) < 1e-12
    assert compose_coefficients(mu_f, f_z, 0) == mu_f


def test_moebius_after_the_map_leaves_the_coefficient():
    z = Z[abs(Z) > 0.05]
    np.testing.assert_allclose(after(moebius(0.6 - 0.2j, 0.7), SLIDING).mu(z), SLIDING.mu(z), atol=1e-13)


# The matrix.


@settings(max_examples=50, deadline=None)
@given(below_one, st.complex_numbers(max_magnitude=10))
def test_diffusion_is_the_papers_matrix_with_determinant_one(mu, gradient):
    x, y = mu.real, mu.imag
    matrix = np.array([[(x - 1) ** 2 + y**2, -2 * y], [-2 * y, (x + 1) ** 2 + y**2]]) / (1 - x * x - y * y)
    columns = np.array([[diffuse(mu, 1).real, diffuse(mu, 1j).real], [diffuse(mu, 1).imag, diffuse(mu, 1j).imag]])
    np.testing.assert_allclose(columns, matrix, rtol=1e-11, atol=1e-11)
    assert np.linalg.det(columns) == pytest.approx(1, rel=1e-9)
    assert np.linalg.eigvalsh(columns).min() > 0
    product = matrix @ [gradient.real, gradient.imag]
    assert diffuse(mu, gradient) == pytest.approx(complex(*product), rel=1e-9, abs=1e-9)


def test_diffused_gradient_of_u_is_the_turned_gradient_of_v():
    """`v_y = a1 u_x + a2 u_y`, `-v_x = a2 u_x + a3 u_y`: the paper's eqn3 with its signs mended."""
    exact = affine(1.3 + 0.2j, 0.5 - 0.4j)
    f, mu = exact(Z), exact.mu(Z[:1])[0]
    gradients = hat_gradients(Z, FACES)
    u, v = (np.einsum("fk,fk->f", gradients, part[FACES]) for part in (f.real, f.imag))
    np.testing.assert_allclose(diffuse(mu, u), -1j * v, atol=1e-12)


def test_stiffness_equals_the_cotangent_matrix_of_the_metric():
    """K(mu) is the Laplacian of triangles with edges `e + mu conj(e)`: each laid out alone, then glued."""
    mu = random_mu(np.random.default_rng(0), Z, FACES, 0.8)
    corners = Z[FACES] + mu[:, None] * np.conj(Z[FACES])
    apart = cotangent_stiffness(space(corners.ravel()), np.arange(corners.size).reshape(-1, 3))
    glue = sparse.csr_array((np.ones(FACES.size), (np.arange(FACES.size), FACES.ravel())))
    difference = stiffness(Z, FACES, mu) - glue.T @ apart @ glue
    assert abs(difference).max() < 1e-11 * abs(apart).max()


def test_cotangent_stiffness_equals_libigl():
    points = np.stack([Z.real, Z.imag, np.sin(3 * Z.real) * Z.imag], 1)
    theirs = -igl.cotmatrix(points, FACES.astype(np.int64))
    assert abs(cotangent_stiffness(points, FACES) - theirs).max() < 1e-12


def test_stiffness_of_a_composition_and_of_an_inverse_on_the_image_mesh():
    """The energy of w(f(z)) may be taken in z or in f(z): the same matrix, coefficient by the composition formula."""
    f = SLIDING(Z)
    f_z, mu_f = wirtinger(Z, FACES, f)[0], beltrami_coefficient(Z, FACES, f)
    mu_g = random_mu(np.random.default_rng(0), f, FACES, 0.6)
    composed = compose_coefficients(mu_f, f_z, mu_g)
    assert abs(stiffness(f, FACES, mu_g) - stiffness(Z, FACES, composed)).max() < 1e-12
    undone = inverse_coefficient(mu_f, f_z)
    np.testing.assert_allclose(beltrami_coefficient(f, FACES, Z), undone, atol=1e-13)
    assert abs(stiffness(f, FACES, undone) - stiffness(Z, FACES, 0 * mu_f)).max() < 1e-12


def test_energy_minus_area_vanishes_for_the_map_itself():
    """On every row, boundary included: `K f + (i/2)(f_next - f_prev) = 0` (erratum on L_LBS)."""
    exact = affine(1, 0.4 - 0.3j)
    f = exact(Z)
    residual = stiffness(Z, FACES, exact.mu(Z[FACES[:, 0]])) @ f
    loop = boundary_loop(FACES)
    residual[loop] += 0.5j * (np.roll(f[loop], -1) - np.roll(f[loop], 1))
    assert abs(residual).max() < 1e-12


# The Linear Beltrami Solver.


def interior_share(z, faces, share, seed=0):
    """The boundary and a few pins inside."""
    inside = np.setdiff1d(np.arange(len(z)), boundary_loop(faces))
    chosen = np.random.default_rng(seed).choice(inside, int(share * len(inside)), replace=False)
    return np.concatenate([boundary_loop(faces), chosen])


@pytest.mark.parametrize("pins", [0.0, 0.1])
def test_solver_recovers_affine_maps(pins):
    exact = affine(0.8 + 0.3j, -0.2 + 0.5j, 1 - 1j)
    pinned = interior_share(Z, FACES, pins)
    f = solve_beltrami(Z, FACES, exact.on_faces(Disk(Z, FACES)), pinned, exact(Z[pinned]))
    np.testing.assert_allclose(f, exact(Z), atol=1e-12)


def test_solver_with_every_vertex_pinned():
    z, faces = polar_disk(1, 5)
    values = np.arange(6) + 1j
    assert (solve_beltrami(z, faces, np.zeros(5), np.arange(6), values) == values).all()


def test_l2_rate_on_the_radial_stretch():
    errors = []
    for n in (16, 32, 64):
        z, faces = square_disk(n)
        loop = boundary_loop(faces)
        f = solve_beltrami(z, faces, RADIAL.on_faces(Disk(z, faces)), loop, RADIAL(z[loop]))
        square = (abs(f - RADIAL(z)) ** 2)[faces].mean(1)
        errors.append(np.sqrt((square * signed_areas(z, faces)).sum()))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 1e-4 and (rates >= 1.8).all(), (errors, rates)


def test_solver_equals_lapy():
    mu = random_mu(np.random.default_rng(4), Z, FACES, 0.7)
    pinned = interior_share(Z, FACES, 0.05)
    values = Z[pinned] + 0.1 * np.sin(3 * Z[pinned].imag)
    theirs = lapy.conformal.linear_beltrami_solver(
        lapy.TriaMesh(space(Z), FACES), mu, pinned, np.stack([values.real, values.imag], 1)
    )
    ours = solve_beltrami(Z, FACES, mu, pinned, values)
    np.testing.assert_allclose(ours, theirs[:, 0] + 1j * theirs[:, 1], atol=1e-10)


def with_vertex(value):
    return np.where(np.arange(len(Z)) == FACES[0, 0], value, Z)


def spoiled(position, value):
    mu = np.zeros(len(FACES), complex)
    mu[position] = value
    return mu


@pytest.mark.parametrize("mu, message", [
    (spoiled(4, 1.0), r"1 faces \(first: \[4\]"), (spoiled(9, -1.2j), r"\[9\]"), (spoiled(0, np.nan), r"\[0\]"),
    (spoiled(2, complex(0, np.inf)), r"\[2\]"), (spoiled([3, 5], 2), r"2 faces \(first: \[3, 5\]"),
    (np.zeros(3), r"shape \(3,\)"), (np.zeros((len(FACES), 2)), "a value for each of"),
])  # fmt: skip
def test_unusable_coefficients(mu, message):
    for ask, *more in ((stiffness,), (solve_beltrami, [0], [0]), (solve_beltrami_disk,)):
        with pytest.raises(BeltramiError, match=message):
            ask(*DISK, mu, *more)


@pytest.mark.parametrize("pinned, values, message", [
    ([len(Z)], [1], "out of range"), ([-1], [1], "out of range .*: -1"), ([3, 3], [1, 1], r"once: \[3\]"),
    ([1, 2], [1], "one value a vertex"), ([], [], "at least one"), ([1], [np.nan], "not finite at pins 0"),
    ([1.5], [1], "integer"), ([True, False], [1, 1], "integer"), ([[1, 2]], [[1, 1]], "one value a vertex"),
])  # fmt: skip
def test_unusable_pins(pinned, values, message):
    with pytest.raises(BeltramiError, match=message):
        solve_beltrami(Z, FACES, np.zeros(len(FACES)), pinned, values)


@pytest.mark.parametrize("z, faces, message", [
    (Z.conj(), FACES, "not counter-clockwise"), (Z, FACES[:, ::-1], "not counter-clockwise"),
    (with_vertex(np.nan), FACES, "z is not finite at vertices"), (with_vertex(9), FACES, "not counter-clockwise"),
])  # fmt: skip
def test_unusable_source_meshes(z, faces, message):
    zero = np.zeros(len(faces))
    for ask, *more in ((hat_gradients,), (solve_beltrami, zero, [0], [0]), (solve_beltrami_disk, zero)):
        with pytest.raises(BeltramiError, match=message):
            ask(z, faces, *more)
