"""Piecewise linear quasi-conformal geometry in complex arithmetic, and the Linear Beltrami Solver.

A point, a map and the gradient of a real function are complex numbers; on a triangle a map is affine, so that its
Wirtinger derivatives and its Beltrami coefficient are constants of the triangle.
"""

import numpy as np
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

from .checks import (
    BeltramiError,
    check_coefficient,
    check_map,
    check_mesh,
    check_pins,
    check_used,
    planar_points,
)


def signed_areas(z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]) -> Float[ndarray, " F"]:
    """Signed area of each triangle, positive when counter-clockwise: Im(conj(b - a)(c - a)) / 2.

    BeltramiError where a face names a vertex that is not there.
    """
    z, faces = check_mesh(z, faces)
    a, b, c = (z[faces[:, k]] for k in range(3))
    return 0.5 * ((b - a).conj() * (c - a)).imag


def hat_gradients(z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"]) -> Complex[ndarray, " F 3"]:
    """Gradients of the three hat functions of each triangle as complex numbers, in 1/length.

    `grad phi_i = i (z_k - z_j) / (2 |T|)` for a counter-clockwise triangle (i, j, k): the pair (A_i, B_i) of the
    paper's section on the LBS with its factor mended (divided by twice the area). Raises BeltramiError where a
    triangle of the source mesh is clockwise or has no area.
    """
    z, faces = check_mesh(z, faces)
    unknown = np.flatnonzero(~np.isfinite(z))
    if len(unknown):
        raise BeltramiError(f"z is not finite at vertices {unknown[:5].tolist()}; mend the map that made it")
    area = signed_areas(z, faces)
    bad = np.flatnonzero(~(area > 0))
    if len(bad):
        raise BeltramiError(
            f"{len(bad)} source triangles are not counter-clockwise (first: {bad[:5].tolist()}); "
            "use a planar mesh without folds, or reverse every face if all of them are clockwise"
        )
    corners = z[faces]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    return 0.5j * opposite / area[:, None]


def wirtinger(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"] | Float[ndarray, " V 3"]
) -> tuple[Complex[ndarray, " F *c"], Complex[ndarray, " F *c"]]:
    """The derivatives `f_z = (f_x - i f_y)/2` and `f_zbar = (f_x + i f_y)/2` of a piecewise linear map.

    A map into space, real, gives one column a coordinate.
    """
    gradients, corners = hat_gradients(z, faces), check_map(f, len(np.atleast_1d(z)))[np.asarray(faces)]
    f_z = 0.5 * np.einsum("fk,fk...->f...", gradients.conj(), corners)
    f_zbar = 0.5 * np.einsum("fk,fk...->f...", gradients, corners)
    return f_z, f_zbar


def jacobian(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"]
) -> Float[ndarray, " F"]:
    """Jacobian determinant of a planar map on each triangle, `|f_z|^2 - |f_zbar|^2`; negative where it folds."""
    f = planar_points(f, "f")  # a surface (V, 3) has no sign to tell
    f_z, f_zbar = wirtinger(z, faces, f)
    return abs(f_z) ** 2 - abs(f_zbar) ** 2


def beltrami_coefficient(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], f: Complex[ndarray, " V"] | Float[ndarray, " V 3"]
) -> Complex[ndarray, " F"]:
    """The Beltrami coefficient `mu = f_zbar / f_z` of a map on each triangle.

    `f` complex: a planar map; |mu| > 1 where it reverses orientation, infinite where it is anti-conformal.
    `f` real: a surface; then `mu = (E - G + 2iF) / (E + G + 2 sqrt(EG - F^2))` of the induced metric, which
    never exceeds 1 and so cannot show a fold. Source: paper, section 'Quasi-Conformal Theory'.
    """
    f_z, f_zbar = wirtinger(z, faces, f)
    with np.errstate(divide="ignore", invalid="ignore"):
        if f_z.ndim == 1:
            return f_zbar / f_z
        # Summed over the three coordinates: f_zbar^2 is (E - G + 2iF)/4 and |f_z|^2 is (E + G)/4.
        difference, total = (f_zbar**2).sum(1), (abs(f_z) ** 2).sum(1)
        area_element = np.sqrt(np.maximum(total**2 - abs(difference) ** 2, 0.0))
        return difference / (total + area_element)


def compose_coefficients(
    mu_f: Complex[ndarray, " *F"], f_z: Complex[ndarray, " *F"], mu_g: Complex[ndarray, " *F"]
) -> Complex[ndarray, " *F"]:
    """Coefficient of g after f: `(mu_f + t mu_g) / (1 + conj(mu_f) t mu_g)`, `t = conj(f_z)/f_z`.

    `mu_g` holds the coefficient of g at the image points f(z).
    """
    turned = np.conj(f_z) / f_z * mu_g
    return (mu_f + turned) / (1 + np.conj(mu_f) * turned)


def inverse_coefficient(mu: Complex[ndarray, " *F"], f_z: Complex[ndarray, " *F"]) -> Complex[ndarray, " *F"]:
    """Coefficient of the inverse of f at the image points f(z): `-mu f_z / conj(f_z)`."""
    return -np.asarray(mu) * f_z / np.conj(f_z)


def diffuse(mu, gradient):
    """A(mu) applied to gradients: `((1 + |mu|^2) g - 2 mu conj(g)) / (1 - |mu|^2)`; A is SPD with determinant 1."""
    m = abs(mu) ** 2
    return ((1 + m) * gradient - 2 * mu * np.conj(gradient)) / (1 - m)


def stiffness_blocks(gradients, areas, mu):
    """Element matrices `|T| grad phi_i . A(mu) grad phi_j`, real (F, 3, 3)."""
    turned = diffuse(mu[:, None], gradients)
    return areas[:, None, None] * (gradients.conj()[:, :, None] * turned[:, None, :]).real


def assemble(faces, blocks, n_vertices):
    """Sum of element matrices (F, 3, 3) as a sparse matrix (V, V) in CSC form."""
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    return sparse.coo_array((blocks.ravel(), (rows, columns)), shape=(n_vertices, n_vertices)).tocsc()


def corner_average(faces, n_vertices, weights):
    """Sparse (V, F): the average over the faces around each vertex, with the faces' weights (F,)."""
    corners = sparse.csr_array(
        (np.repeat(weights, 3), (faces.ravel(), np.repeat(np.arange(len(faces)), 3))), shape=(n_vertices, len(faces))
    )
    return sparse.diags_array(1 / corners.sum(1)) @ corners


def face_mean(faces, n_vertices):
    """Sparse (F, V): the mean over the corners of each face,
    the value at its centroid of a piecewise linear function."""
    rows = np.repeat(np.arange(len(faces)), 3)
    return sparse.csr_array((np.full(len(rows), 1 / 3), (rows, faces.ravel())), shape=(len(faces), n_vertices))


def stiffness(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], mu: Complex[ndarray, " F"]
) -> Float[sparse.csc_array, " V V"]:
    """The matrix `K(mu)_ij = sum_T |T| grad phi_i . A(mu_T) grad phi_j`, sparse (V, V), positive semi-definite.

    `(K u)_i = 0` is the mended form of the paper's eqs. linear_system_x and linear_system_y (with the area weight).
    """
    z, faces = check_mesh(z, faces)
    mu = check_coefficient(mu, len(faces))
    return assemble(faces, stiffness_blocks(hat_gradients(z, faces), signed_areas(z, faces), mu), len(z))


def cotangent_stiffness(
    vertices: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"]
) -> Float[sparse.csc_array, " V V"]:
    """The surface's own stiffness matrix, sparse (V, V): off-diagonal entries `-(cot a + cot b)/2`.

    It equals K(mu) of any embedding of the surface with Beltrami coefficient mu: no embedding is needed.
    """
    corners = np.asarray(vertices, float)[faces]
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # edge k lies opposite corner k
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    blocks = np.einsum("fia,fja->fij", edges, edges) / (4 * area[:, None, None])
    return assemble(np.asarray(faces), blocks, len(vertices))


def factorise(matrix, ordering="MMD_AT_PLUS_A"):
    """SuperLU factors of a matrix with symmetric pattern, pivots on the diagonal.

    Right for SPD matrices, and for rows of averages among them: looking for larger pivots off the diagonal fills
    the factors of a mesh with slivers up to 35 times as much and is no more accurate. `relax=1`: the default joins
    columns into supernodes so freely that some meshes (fsaverage5, subdivided) fill twice as much.
    """
    try:
        return splu(
            matrix.tocsc(), permc_spec=ordering, diag_pivot_thresh=0.0, relax=1, options={"SymmetricMode": True}
        )
    except RuntimeError as error:
        raise BeltramiError(
            f"the system of equations cannot be solved ({str(error).lower()}): some vertex is in no "
            "face, or triangles are too thin or too small for double precision; remesh"
        ) from None


class Dirichlet:
    """A stiffness matrix with values prescribed at some vertices, factored once for any values and loads.

    order: the free vertices in the order of their elimination, a good one for this pattern; without it one is sought.
    """

    def __init__(self, matrix, pinned, order=None):
        self.pinned, self.size = np.asarray(pinned), matrix.shape[0]
        self.free = np.setdiff1d(np.arange(self.size), self.pinned) if order is None else order
        rows = matrix.tocsr()[self.free]
        self.coupling = rows[:, self.pinned]
        ordering = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        self.factors = factorise(rows[:, self.free], ordering) if len(self.free) else None

    def solve_free(self, load):
        """Free values (len(free), ...) for a real or complex load there and zero at the pins."""
        if self.factors is None:
            return np.zeros(load.shape, load.dtype)
        if np.iscomplexobj(load):  # casting the real matrix to complex would cost many times as much
            return self.solve_free(load.real) + 1j * self.solve_free(load.imag)
        nonzero = load.reshape(len(load), -1).any(0)
        solution = np.zeros((len(load), len(nonzero)))
        if nonzero.any():
            solution[:, nonzero] = self.factors.solve(np.ascontiguousarray(load.reshape(len(load), -1)[:, nonzero]))
        return solution.reshape(load.shape)

    def solve(self, values):
        """The complex x (V,) with x = values at the pins and (matrix x)_i = 0 at every free vertex."""
        x = np.empty(self.size, complex)
        x[self.pinned] = values
        x[self.free] = self.solve_free(-(self.coupling @ x[self.pinned]))
        return x


def solve_beltrami(
    z: Complex[ndarray, " V"],
    faces: Integer[ndarray, " F 3"],
    mu: Complex[ndarray, " F"],
    pinned: Integer[ndarray, " K"],
    values: Complex[ndarray, " K"],
) -> Complex[ndarray, " V"]:
    """The Linear Beltrami Solver: the piecewise linear map with coefficient mu and given values.

    Solves `div(A(mu) grad u) = 0` for both coordinates with `f = values` at the vertices `pinned`.
    Not certified: with pins on the whole boundary the result's own coefficient differs from mu, and pins inside
    can fold it; ask `check_bijective`. Raises BeltramiError for |mu| >= 1, a folded source or unusable pins.
    Source: paper, section 'Linear Beltrami Solver', with the errata of the chapter on it.
    """
    z, faces = check_mesh(z, faces)
    check_used(z, faces)
    pinned, values = check_pins(pinned, values, len(z))
    return Dirichlet(stiffness(z, faces, mu), pinned).solve(values)
