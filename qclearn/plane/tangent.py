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

from .coefficients import bounded_pullback

REACH = 1.8  # cells: from where on a node stands for its cell in the integral
FINER = 3  # into so many squared a triangle is cut, nearer than that


class Carrier:
    """A polar `Disk` that carries nu beside the disk of a `DiskSolver` that is mapped, whatever points.

    z (N,), areas (N,): the nodes and their cells; values (N, V): what a mapped mesh's values are there; slope (V, V):
    f_z at the mapped mesh's vertices; hats (9 T, N): nu on the parts of the triangles; fine, areas_fine, values_fine:
    the middles of these parts.
    """

    def __init__(self, solver, mesh):
        self.z, self.mapped, triangles = mesh.z, solver.disk, mesh.faces
        faces = self.mapped.faces
        starts, shape = np.arange(0, faces.size + 1, 3), (len(faces), len(self.mapped.z))
        table = self.mapped.gradients.conj().ravel() / 2, faces.ravel(), starts
        self.slope = (self.mapped.to_vertices @ sparse.csr_array(table, shape=shape)).tocsr()
        self.areas = np.bincount(triangles.ravel(), np.repeat(mesh.areas, 3)) / 3
        self.values, at = self.values_at(self.z)
        self.tree = scipy.spatial.cKDTree(np.stack([self.z.real, self.z.imag], axis=1))
        self.hats = hats_inside(triangles, len(self.z))
        self.fine, self.areas_fine = self.hats @ self.z, np.repeat(mesh.areas, FINER**2) / FINER**2
        self.values_fine, _ = self.values_at(self.fine, at[np.repeat(triangles[:, 0], FINER**2)])

    def values_at(self, points, guess=None):
        """Sparse (P, V) from values on the mapped mesh to those at points (P,), and the faces that hold them."""
        face, weights = self.mapped.lookup(points, guess)
        starts = np.arange(0, 3 * len(points) + 1, 3)
        table = weights.ravel(), self.mapped.faces[face].ravel(), starts
        return sparse.csr_array(table, shape=(len(points), len(self.mapped.z))), face


class Tangent:
    """Derivatives of maps at points `samples @ z` with respect to a field nu on a polar mesh, mu = T(nu).

    solver: a `DiskSolver` of the mapped mesh; mesh: the polar `Disk` that carries nu; samples (P, V) sparse,
    three corners a row; carrier: that of both meshes, if there is one already. Near a point the integral is taken on
    finer triangles, and at the corners of the triangle that holds it, between which the discrete map is linear.
    """

    def __init__(self, solver, mesh, samples, carrier=None):
        self.carrier = carrier or Carrier(solver, mesh)
        at_0 = sparse.csr_array((solver.weights, (np.zeros(3, int), solver.origin)), shape=(1, len(solver.disk.z)))
        shares = np.array([1 - solver.share, solver.share])
        at_1 = sparse.csr_array((shares, (np.zeros(2, int), solver.loop[:2])), shape=(1, len(solver.disk.z)))
        self.points = sparse.vstack([samples, at_0, at_1]).tocsr()  # all, in the mapped mesh
        self.close = self.close_pairs(solver.disk.z)
        self.find_parts()

    def close_pairs(self, z):
        """Sparse (P + 2, N), 1 where a node lies within its reach, and the size of the point's triangle, of a point."""
        carrier, centre, table = self.carrier, self.points @ z, self.points.tocoo()
        size = np.zeros(len(centre))
        np.maximum.at(size, table.row, abs(z[table.col] - centre[table.row]))
        reach = REACH * np.sqrt(carrier.areas)
        near = carrier.tree.query_ball_point(np.stack([centre.real, centre.imag], axis=1), 2 * size + reach.max())
        rows, columns = np.repeat(np.arange(len(near)), [len(some) for some in near]), np.concatenate(near).astype(int)
        inside = abs(carrier.z[columns] - centre[rows]) <= 2 * size[rows] + reach[columns]
        shape = len(centre), len(carrier.z)
        return sparse.csr_array((np.ones(inside.sum()), (rows[inside], columns[inside])), shape=shape)

    def find_parts(self):
        """The parts of triangles that stand for the nodes of the close pairs, and what each of them gives to whom.

        point, part (E,): which part is needed for which point; spread (pairs, E): to which close pairs it belongs;
        corners, shares (P + 2, 3): of the triangles that hold the points.
        """
        carrier, close = self.carrier, self.close
        needed = (close @ carrier.hats.T).tocsr()
        self.point = np.repeat(np.arange(len(needed.indptr) - 1), np.diff(needed.indptr))
        wanted = np.zeros(len(carrier.areas_fine), bool)
        wanted[needed.indices] = True
        self.used, self.part = np.flatnonzero(wanted), (np.cumsum(wanted) - 1)[needed.indices]
        self.hats, self.areas = carrier.hats[self.used], carrier.areas_fine[self.used]
        self.values = carrier.values_fine[self.used]
        number = np.full(close.shape, -1)
        number[close.nonzero()] = np.arange(close.nnz)
        node, share = (part.reshape(-1, 3)[self.part] for part in (self.hats.indices, self.hats.data))
        pair = number[self.point[:, None], node]
        counted = pair >= 0
        starts = np.concatenate([[0], np.cumsum(counted.sum(1))])
        self.spread = sparse.csc_array((share[counted], pair[counted], starts), shape=(close.nnz, len(self.point)))
        inside = np.arange(3) < np.diff(self.points.indptr)[:, None]
        self.corners, self.shares = np.zeros(inside.shape, int), np.zeros(inside.shape)
        self.corners[inside], self.shares[inside] = self.points.indices, self.points.data
        reach = np.zeros(len(inside))
        row, node = close.nonzero()
        centre = self.points @ carrier.mapped.z
        np.maximum.at(reach, row, abs(carrier.z[node] - centre[row]))
        rim = 1 - abs(centre) < reach  # of these points the mirror images are near, too
        self.mirrored, self.replaced = np.flatnonzero(rim[self.point]), np.flatnonzero(rim[row])

    def gradients(self, nu, f):
        """Gradients of Re f(p) and Im f(p) with respect to nu (N,), complex (2, P, N), for the solver's map f (V,)."""
        at, (P, Q) = self.points @ f, self.variation(nu, f)
        moved = np.stack([P.conj() + Q, 1j * (P.conj() - Q)])  # gradients of Re k and Im k
        (zero_re, _), (zero_im, one_im) = moved[:, -2:]
        moved, at, spin = moved[:, :-2], at[:-2, None], 2 * zero_im - one_im
        square = at**2
        moved[0] += (square.real - 1) * zero_re + square.imag * zero_im - at.imag * spin
        moved[1] += square.imag * zero_re - (square.real + 1) * zero_im + at.real * spin
        return moved

    def variation(self, nu, f, dtype=complex):
        """P, Q (P + 2, N) with `dk(p) = sum P dnu + Q conj(dnu)`, the points' own change up to that of a Möbius map;
        the last two rows are those of 0 and 1. dtype: complex64 takes half the time, to four digits."""
        both = np.stack([f, self.carrier.slope @ f], axis=1)
        P, Q = self.kernel(nu, both, dtype)
        self.mend((P, Q), nu, both, dtype)
        along, across = (bounded_pullback(nu, unit) for unit in (1.0, 1j))
        a, b = ((along - 1j * across) / 2).real, (along + 1j * across) / 2  # dmu = a dnu + b conj(dnu)
        a, b = a.astype(P.real.dtype), b.astype(dtype)
        return P * a + Q * b.conj(), P * b + Q * a

    def kernel(self, nu, both, dtype):
        """P, Q (P + 2, N) with `dk(p) = sum P dmu + Q conj(dmu)`, a node for its cell."""
        w, size, mass = cells(self.carrier.areas, nu, self.carrier.values @ both, dtype)
        at = (self.points @ both[:, 0]).astype(dtype)[:, None]
        return mass * inverse(w - at, size), mass.conj() * at**3 * inverse(1 - at * w.conj(), size)

    def mend(self, PQ, nu, both, dtype):
        """The entries of P, and of Q where mirror images are near, at close pairs: by the parts and the corners."""
        w, size, mass = cells(self.areas, self.hats @ nu, self.values @ both, dtype)
        at, share, (P, Q) = both[self.corners, 0].astype(dtype), self.shares.astype(size.dtype), PQ
        (row, node), part, point = self.close.nonzero(), self.part, self.point
        average = np.einsum("ek,ek->e", share[point], inverse(w[part, None] - at[point], size[part, None]))
        P[row, node] = self.spread @ (mass[part] * average)
        part, point = self.part[self.mirrored], self.point[self.mirrored]
        turned = inverse(1 - at[point] * w[part, None].conj(), size[part, None])
        average = np.zeros(len(self.part), complex)
        average[self.mirrored] = mass[part].conj() * np.einsum("ek,ek->e", (share * at**3)[point], turned)
        Q[row[self.replaced], node[self.replaced]] = (self.spread @ average)[self.replaced]


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


def cells(areas, nu, places, dtype):
    """Of cells around places (n, 2), w = f and f_z: w, the size of their images as disks, radius squared, and their
    mass in the integral."""
    w, slope = places.astype(dtype).T
    square = slope**2
    areas = (areas / np.pi).astype(square.real.dtype)
    size = areas * abs(square) * (1 - np.tanh(abs(nu)) ** 2)
    return w, size.astype(areas.dtype), -areas * square


def inverse(d, size):
    """`1 / d`, no larger than on the rim of a disk of this radius squared."""
    return d.conj() * (1 / np.maximum(d.real**2 + d.imag**2, size))  # NumPy divides by a real in complex numbers
