"""Sparse systems on triangle meshes: assembled from element matrices, factored, solved with some
values held. Then what triangles alone give: lengths, areas, angles, points inside, the cotangent
matrix.
"""

import contextlib

import numpy as np
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

from .checks import BeltramiError, blendable, unmasked

try:
    from cvxopt import cholmod, matrix, spmatrix  # extra `fast`
except ImportError:
    cholmod = None

HAS_CHOLMOD = cholmod is not None
SYMMETRIC = 1e-12  # of the largest entry: what a matrix may be off its transpose
LARGE = 20_000  # vertices from which on a mesh is mapped and smoothed by way of a smaller one


def assemble(faces, blocks, n_vertices):
    """Sum of element matrices (F, 3, 3), sparse (V, V)."""
    places = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    return sparse.coo_array((blocks.ravel(), places), shape=(n_vertices, n_vertices)).tocsc()


def three_a_row(values, columns, width):
    """Sparse (n, width) from the values and the columns (n, 3) of the three entries of each row."""
    starts = np.arange(0, values.size + 1, 3)
    return sparse.csr_array((values.ravel(), columns.ravel(), starts), shape=(len(values), width))


def factorise(matrix, ordering="MMD_AT_PLUS_A", pattern=None):
    """Factors of a matrix with symmetric pattern, with `solve(load)`: CHOLMOD's where the matrix is
    symmetric and positive definite and cvxopt is installed (extra `fast`), else SuperLU's, pivots
    on the diagonal. SuperLU's, too, where the rows are in their order already ("NATURAL"). pattern:
    of the `Cholesky` factors of a matrix with the same one, symmetric as this one.

    For SPD matrices and rows of averages: with slivers, pivots off the diagonal fill the factors up
    to 35 times as much and are no more accurate; with the default of `relax` some meshes
    (fsaverage5, subdivided) fill twice as much.
    """
    matrix = matrix.tocsc()
    symmetric = pattern or abs(matrix - matrix.T).max() <= SYMMETRIC * abs(matrix).max()
    if ordering != "NATURAL" and HAS_CHOLMOD and symmetric:
        with contextlib.suppress(ArithmeticError):  # not positive definite
            return Cholesky(matrix, pattern)
    try:
        return splu(matrix, ordering, diag_pivot_thresh=0, relax=1, options={"SymmetricMode": True})
    except RuntimeError as error:
        raise BeltramiError(
            f"the system of equations cannot be solved ({str(error).lower()}): some vertex is in "
            "no face, or triangles are too thin or too small for double precision; remesh"
        ) from None


class Pattern:
    """The symbolic factor of matrices of one pattern, and whose numbers fill it. A pickle is empty:
    the factor is made again."""

    factors = key = None

    def __reduce__(self):
        return Pattern, ()


class Cholesky:
    """CHOLMOD's supernodal factors of a symmetric positive definite matrix; ArithmeticError where
    it is none.

    Matrices of one `pattern` share its symbolic factor, and with it the room for the numbers of one
    of them at a time: whichever is solved next computes its own again.
    """

    def __init__(self, matrix, pattern):
        cholmod.options["supernodal"] = 2
        lower = sparse.tril(matrix).tocoo()
        self.lower = spmatrix(lower.data, *lower.coords, matrix.shape)
        self.key = object()
        self.pattern = pattern or Pattern()
        self.fill()

    def fill(self):
        """The pattern's factors, filled with the numbers of this matrix."""
        if self.pattern.factors is None:
            self.pattern.factors = cholmod.symbolic(self.lower)
        if self.pattern.key is not self.key:
            self.pattern.key = None  # of no matrix, if this one turns out not to be definite
            cholmod.numeric(self.lower, self.pattern.factors)
            self.pattern.key = self.key
        return self.pattern.factors

    def solve(self, load):
        """x with `matrix x = load`, (N,) or (N, K)."""
        x = matrix(np.asfortranarray(load.reshape(len(load), -1)))
        cholmod.solve(self.fill(), x)
        return np.asarray(x).reshape(load.shape)


def heat_flow(mass, stiffness, load, steps):
    """Values u (V, ...) after implicit steps `(A + K) u = A u_before` of the heat flow, A the mass,
    K the stiffness times the length of a step; load: A u at the beginning."""
    factors = factorise(mass + stiffness)
    for _ in range(steps):
        values = factors.solve(load)
        load = mass @ values
    return values


class Dirichlet:
    """A stiffness matrix with values prescribed at some vertices, factored once.

    order: the other vertices in the order of their elimination, which minimum degree gives else;
    pattern: of `factorise`.
    """

    def __init__(self, matrix, pinned, order=None, pattern=None):
        self.size = matrix.shape[0]
        self.pinned = np.asarray(pinned)
        self.free = np.setdiff1d(np.arange(self.size), self.pinned) if order is None else order
        rows = matrix.tocsr()[self.free]
        self.coupling = rows[:, self.pinned]
        self.coupling_T = self.coupling.T
        ordering = "MMD_AT_PLUS_A" if order is None else "NATURAL"
        inner = rows[:, self.free]
        self.factors = factorise(inner, ordering, pattern) if len(self.free) else None

    def solve_free(self, load):
        """Free values (len(free), ...) for a real or complex load there and zero at the pins."""
        if self.factors is None:
            return np.zeros(load.shape, load.dtype)
        columns = np.ascontiguousarray(load).reshape(len(load), -1)
        # Real and imaginary parts apart: the real matrix cast to complex would cost many times as
        # much.
        columns = columns.view(float)
        nonzero = columns.any(0)
        solution = np.zeros(columns.shape)
        if nonzero.any():
            solution[:, nonzero] = self.factors.solve(np.ascontiguousarray(columns[:, nonzero]))
        return solution.view(load.dtype).reshape(load.shape)

    def solve(self, values, load=0.0):
        """The complex x (V,), values at the pins and `(matrix x)_i = load_i` at every free vertex,
        for a load (V,) or one number."""
        x = np.full(self.size, load, complex)
        x[self.pinned] = values
        x[self.free] = self.solve_free(x[self.free] - self.coupling @ x[self.pinned])
        return x


def opposite_edges(corners):
    """The edge opposite each corner, from the next corner to the last, as the corners: in the
    plane, (F, 3) complex, or space, (F, 3, 3)."""
    return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)


def edge_lengths(corners):
    """Length of the edge opposite each corner, (F, 3), of corners in the plane, (F, 3) complex, or
    space, (F, 3, 3)."""
    edges = opposite_edges(corners)
    return abs(edges) if np.iscomplexobj(edges) else np.linalg.norm(edges, axis=2)


def face_areas(vertices, faces):
    """Areas (F,) of the faces of vertices (V, 3)."""
    a, b, c = (vertices[corner] for corner in faces.T)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def degenerate_faces(vertices, faces):
    """Indices (k,) of faces with a repeated vertex, or with a height over the longest side below
    rounding."""
    a, b, c = (vertices[corner] for corner in faces.T)
    longest = np.linalg.norm([b - a, c - b, a - c], axis=2).max(0)
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    rounding = 8 * np.finfo(float).eps * np.nanmax(np.abs(vertices))  # NaN: of a torn wall
    twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.flatnonzero(repeated | (twice <= rounding * longest))


def around_vertices(values, faces, n_vertices=0):
    """The sum (V,) of values (F,) over the faces around each vertex."""
    return np.bincount(faces.ravel(), np.repeat(values, 3), n_vertices)


def interpolate(values, faces, places):
    """Values (V, ...) of the vertices at places (face, weights), linear in each; no labels."""
    face, weights = places
    return np.einsum("pk,pk...->p...", weights, blendable(values)[faces[face]])


def middles(m):
    """Barycentric coordinates (m^2, 3) of the centroids of the m^2 equal parts of a triangle."""
    i, j = np.array([(i, j) for i in range(m) for j in range(m - i)]).T
    upward = np.stack([i + 1 / 3, j + 1 / 3, m - 2 / 3 - i - j], axis=1)
    i, j = i[i + j < m - 1], j[i + j < m - 1]
    downward = np.stack([i + 2 / 3, j + 2 / 3, m - 4 / 3 - i - j], axis=1)
    return np.concatenate([upward, downward]) / m


def half_angle_squares(lengths):
    """Two squares (F, 3) whose ratio is tan(a/2)^2 at the corners, from edge lengths opposite them.

    `o^2 - (l - r)^2` and `(l + r)^2 - o^2`; in a sliver rounding can make either negative.
    """
    left = np.roll(lengths, -1, axis=1)
    right = np.roll(lengths, -2, axis=1)
    return lengths**2 - (left - right) ** 2, (left + right) ** 2 - lengths**2


def corner_angles(lengths):
    """Interior angles (F, 3) in radians from edge lengths opposite the corners (F, 3)."""
    # Half-angle form: accurate for slivers, where the law of cosines cancels.
    return 2 * np.arctan2(*np.sqrt(np.maximum(half_angle_squares(lengths), 0)))


def cotangent_stiffness(
    vertices: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"]
) -> Float[sparse.csc_array, " V V"]:
    """The surface's stiffness matrix, off-diagonal `-(cot a + cot b)/2`: K(mu) of any embedding
    with coefficient mu."""
    edges = opposite_edges(unmasked(vertices, "vertices").astype(float)[faces])
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    blocks = np.einsum("fia,fja->fij", edges, edges) / (4 * area[:, None, None])
    return assemble(np.asarray(faces), blocks, len(vertices))
