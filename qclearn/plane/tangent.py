"""The derivative of a disk map in closed form: what a change of its coefficient does to some points, without a solve.

For the map f of the unit disk with coefficient mu, f(0) = 0 and f(1) = 1, a change dmu moves f(p) by
    `df(p) = k(p) - k(0) + conj(k(0)) f(p)^2 + i f(p) (2 Im k(0) - Im k(1))`,
    `k(p) = -(1/pi) int f_z^2 dmu / (f - f(p)) - (1/pi) f(p)^3 int conj(f_z^2 dmu) / (1 - f(p) conj(f))`,
integrals over the disk: the first variation at the identity, carried by f, in which 1 - |mu|^2 cancels. Source:
Ahlfors, Lectures on Quasiconformal Mappings, chapter V.
"""

import numpy as np
import scipy
from scipy import sparse

from .beltrami import corner_average, signed_areas
from .diskmesh import Lookup
from .fields import bounded_pullback

REACH = 1.8  # cells: from where on a node stands for its cell in the integral
FINER = 3  # into so many squared a triangle is cut, nearer than that


class Nodes:
    """Quadrature nodes z (N,) with their areas; values: sparse (N, V), what a mapped mesh's values are there."""

    def __init__(self, z, areas, lookup):
        self.z, self.areas = z, areas
        face, weights = lookup(z)
        starts = np.arange(0, 3 * len(z) + 1, 3)
        table = weights.ravel(), lookup.faces[face].ravel(), starts
        self.values = sparse.csr_array(table, shape=(len(z), len(lookup.z)))


class Tangent:
    """Derivatives of maps at points `samples @ z` with respect to a field nu on a polar mesh, mu = T(nu).

    solver: a `BeltramiDiskSolver` of the mapped mesh; mesh (z, faces): the one that carries nu; samples (P, V) sparse.
    Near a point the integral is taken on finer triangles, and at the corners of the triangle that holds it, between
    which the discrete map is linear.
    """

    def __init__(self, solver, mesh, samples):
        at_0 = sparse.csr_array((solver.weights, (np.zeros(3, int), solver.origin)), shape=(1, len(solver.z)))
        shares = np.array([1 - solver.share, solver.share])
        at_1 = sparse.csr_array((shares, (np.zeros(2, int), solver.loop[:2])), shape=(1, len(solver.z)))
        self.points = sparse.vstack([samples, at_0, at_1]).tocsr()  # all, in the mapped mesh
        self.corners = np.unique(self.points.indices)
        self.weights = self.points[:, self.corners].tocsr()
        (z, triangles), lookup = mesh, Lookup(solver.z, solver.faces)
        starts, shape = np.arange(0, solver.faces.size + 1, 3), (len(solver.faces), len(solver.z))
        by_face = sparse.csr_array((solver.gradients.conj().ravel() / 2, solver.faces.ravel(), starts), shape=shape)
        self.slope = (corner_average(solver.faces, len(solver.z), solver.areas) @ by_face).tocsr()  # f_z at vertices
        areas = signed_areas(*mesh)
        self.nodes = Nodes(z, np.bincount(triangles.ravel(), np.repeat(areas, 3)) / 3, lookup)
        self.close = self.close_pairs(solver.z)
        cut = np.flatnonzero(np.isin(triangles, self.close.indices).any(1))
        self.hats = hats_inside(triangles[cut], len(z))
        self.fine = Nodes(self.hats @ z, np.repeat(areas[cut], FINER**2) / FINER**2, lookup)
        self.below = (self.weights.T @ self.close @ self.hats.T).tocoo()  # the fine nodes that each corner needs

    def close_pairs(self, z):
        """Sparse (P + 2, N), 1 where a node lies within its reach, and the size of the point's triangle, of a point."""
        centre, table = self.points @ z, self.points.tocoo()
        size = np.zeros(len(centre))
        np.maximum.at(size, table.row, abs(z[table.col] - centre[table.row]))
        reach = REACH * np.sqrt(self.nodes.areas)
        tree = scipy.spatial.cKDTree(np.stack([self.nodes.z.real, self.nodes.z.imag], axis=1))
        near = tree.query_ball_point(np.stack([centre.real, centre.imag], axis=1), 2 * size + reach.max())
        rows, columns = np.repeat(np.arange(len(near)), [len(some) for some in near]), np.concatenate(near).astype(int)
        inside = abs(self.nodes.z[columns] - centre[rows]) <= 2 * size[rows] + reach[columns]
        shape = len(centre), len(self.nodes.z)
        return sparse.csr_array((np.ones(inside.sum()), (rows[inside], columns[inside])), shape=shape)

    def gradients(self, nu, f):
        """Gradients of Re f(p) and Im f(p) with respect to nu (N,), complex (2, P, N), for the solver's map f (V,)."""
        at = self.points @ f
        both = np.stack([f, self.slope @ f], axis=1)
        P, Q = kernel(self.nodes.areas, nu, *(self.nodes.values @ both).T, at[:, None])
        P[self.close.nonzero()], Q[self.close.nonzero()] = self.nearby(nu, both)
        moved = np.stack([P.conj() + Q, 1j * (P.conj() - Q)])  # gradients of Re k and Im k
        (zero_re, _), (zero_im, one_im) = moved[:, -2:]
        moved, at, spin = moved[:, :-2], at[:-2, None], 2 * zero_im - one_im
        square = at**2
        moved[0] += (square.real - 1) * zero_re + square.imag * zero_im - at.imag * spin
        moved[1] += square.imag * zero_re - (square.real + 1) * zero_im + at.real * spin
        return moved

    def nearby(self, nu, both):
        """The entries of P and Q at close pairs, from the fine nodes and the corners."""
        corner, fine = self.below.row, self.below.col
        w, slope = (self.fine.values @ both)[fine].T
        at = both[self.corners, 0][corner]
        places = self.close.nonzero()
        for part in kernel(self.fine.areas[fine], (self.hats @ nu)[fine], w, slope, at):
            spread = sparse.csr_array((part, (corner, fine)), shape=self.below.shape)
            yield (self.weights @ spread @ self.hats).tocsr()[places]


def hats_inside(triangles, n_vertices):
    """Sparse (FINER^2 T, V): the means over the parts of triangles (T, 3) cut into FINER^2 each, of vertex values."""
    i, j = np.array([(i, j) for i in range(FINER) for j in range(FINER - i)]).T
    upward = np.stack([i + 1 / 3, j + 1 / 3, FINER - 2 / 3 - i - j], axis=1)
    i, j = i[i + j < FINER - 1], j[i + j < FINER - 1]
    downward = np.stack([i + 2 / 3, j + 2 / 3, FINER - 4 / 3 - i - j], axis=1)
    shares = np.tile(np.concatenate([upward, downward]) / FINER, (len(triangles), 1))
    columns = np.repeat(triangles, FINER**2, axis=0)
    starts = np.arange(0, shares.size + 1, 3)
    return sparse.csr_array((shares.ravel(), columns.ravel(), starts), shape=(len(shares), n_vertices))


def kernel(areas, nu, w, slope, at):
    """P, Q with `dk(p) = sum P dnu + Q conj(dnu)` for nodes w = f, slope = f_z and points `at` = f(p), broadcast."""
    along, across = (bounded_pullback(nu, unit) for unit in (1.0, 1j))
    a, b = ((along - 1j * across) / 2).real, (along + 1j * across) / 2  # dmu = a dnu + b conj(dnu)
    size = areas * abs(slope) ** 2 * (1 - np.tanh(abs(nu)) ** 2) / np.pi  # a node's cell, as a disk around it
    mass = -areas * slope**2 / np.pi
    apart, beyond = w - at, 1 - at * w.conj()
    P = mass * apart.conj() / np.maximum(abs(apart) ** 2, size)
    Q = mass.conj() * at**3 * beyond.conj() / np.maximum(abs(beyond) ** 2, size)
    return P * a + Q * b.conj(), P * b + Q * a
