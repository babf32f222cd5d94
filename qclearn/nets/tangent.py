"""`Tangent`, the derivative of a disk map in closed form: what a change of its coefficient does to
some points, without a solve.

For the map f of the unit disk with coefficient mu, f(0) = 0 and f(1) = 1, a change dmu moves f(p)
by
    `df(p) = k(p) - k(0) + conj(k(0)) f(p)^2 + i f(p) (2 Im k(0) - Im k(1))`,
    `k(p) = -(1/pi) int f_z^2 dmu / (f - f(p))
            - (1/pi) f(p)^3 int conj(f_z^2 dmu) / (1 - f(p) conj(f))`,
integrals over the disk: the first variation at the identity, carried by f, in which 1 - |mu|^2
cancels. Source: Ahlfors, Lectures on Quasiconformal Mappings, chapter V.
"""

from functools import lru_cache

import numpy as np
import scipy
from scipy import sparse

from ..plane.coefficients import bounded_pullback
from ..plane.disk import pairs
from ..plane.linear import around_vertices, middles, three_a_row

REACH = 1.8  # cells: from where on a node stands for its cell in the integral
FINER = 3  # nearer than that, a triangle is cut into so many squared


class Carrier:
    """What a `Tangent` needs of the mapped `Disk` and the polar mesh of nu, for any points.

    z (N,), areas (N,): the nodes and their cells; values (N, V): from the mapped mesh to the nodes;
    slope (V, V): f_z at the mapped vertices; hats (9 T, N): nu on the parts of the triangles;
    areas_fine, values_fine: of these parts.
    """

    def __init__(self, disk, mesh):
        self.z = mesh.z
        f_z = three_a_row(disk.gradients.conj() / 2, disk.faces, len(disk.z))
        self.slope = (disk.to_vertices @ f_z).tocsr()
        self.areas = around_vertices(mesh.areas, mesh.faces) / 3
        self.values = disk.interpolation(self.z)
        self.tree = scipy.spatial.cKDTree(pairs(self.z))
        self.hats = hats_inside(mesh.faces, len(self.z))
        self.areas_fine = np.repeat(mesh.areas, FINER**2) / FINER**2
        self.values_fine = disk.interpolation(self.hats @ self.z)


carrier_of = lru_cache(maxsize=8)(Carrier)


class Tangent:
    """Derivatives of maps at points `samples @ z` by a field nu on a polar mesh, mu = T(nu).

    coefficient_mesh: the `CoefficientMesh`; samples (P, V): sparse, three entries a row. Near a
    point the integral is taken over parts of triangles, and for the corners of the triangle that
    holds the point, as the discrete map is linear between them.
    """

    def __init__(self, coefficient_mesh, samples):
        self.carrier = carrier_of(coefficient_mesh.disk, coefficient_mesh.mesh)
        solver = coefficient_mesh.solver
        # The points by the corners of their triangles and barycentric coordinates, (P + 2, 3).
        # After the samples come 0 and 1, which the map holds.
        (first, second), order = solver.loop[:2], np.argsort(solver.origin)
        held = [solver.weights[order], [1 - solver.share, solver.share, 0]]
        corners = [solver.origin[order], [first, second, second]]
        self.barycentric = np.concatenate([samples.data.reshape(-1, 3), held])
        self.corners = np.concatenate([samples.indices.reshape(-1, 3), corners])
        self.points = three_a_row(self.barycentric, self.corners, len(solver.disk.z))
        self.close = self.close_pairs(solver.disk.z)
        # Of the close pairs' nodes, the parts; point, part (E,): which point needs which part.
        needed = (self.close @ self.carrier.hats.T).tocoo()
        used, self.part = np.unique(needed.col, return_inverse=True)
        self.point, self.hats = needed.row, self.carrier.hats[used]
        self.areas, self.values = self.carrier.areas_fine[used], self.carrier.values_fine[used]
        self.spread = self.spread_parts()
        # The needed parts and the close pairs of points whose mirror images are near, too.
        (row, node), centre = self.close.nonzero(), self.points @ solver.disk.z
        reach = np.zeros(len(centre))
        np.maximum.at(reach, row, abs(self.carrier.z[node] - centre[row]))
        rim = 1 - abs(centre) < reach
        self.mirrored, self.replaced = np.flatnonzero(rim[self.point]), np.flatnonzero(rim[row])

    def close_pairs(self, z):
        """Sparse (P + 2, N), 1 where a node lies within its reach, and the size of the point's
        triangle, of a point."""
        carrier = self.carrier
        centre = self.points @ z
        size = abs(z[self.corners] - centre[:, None]).max(1)
        reach = REACH * np.sqrt(carrier.areas)
        near = carrier.tree.query_ball_point(pairs(centre), 2 * size + reach.max())
        rows = np.repeat(np.arange(len(near)), [len(some) for some in near])
        columns = np.concatenate(near).astype(int)
        inside = abs(carrier.z[columns] - centre[rows]) <= 2 * size[rows] + reach[columns]
        places = rows[inside], columns[inside]
        shape = len(centre), len(carrier.z)
        return sparse.csr_array((np.ones(inside.sum()), places), shape=shape)

    def spread_parts(self):
        """Sparse (pairs, E): the share of each needed part that belongs to each close pair."""
        number = np.full(self.close.shape, -1)
        number[self.close.nonzero()] = np.arange(self.close.nnz)
        node = self.hats.indices.reshape(-1, 3)[self.part]
        share = self.hats.data.reshape(-1, 3)[self.part]
        pair = number[self.point[:, None], node]
        counted = pair >= 0
        starts = np.concatenate([[0], np.cumsum(counted.sum(1))])
        entries = share[counted], pair[counted], starts
        return sparse.csc_array(entries, shape=(self.close.nnz, len(self.point)))

    def gradients(self, nu, f):
        """Gradients of Re f(p) and Im f(p) by nu (N,), complex (2, P, N), for the solver's map f
        (V,)."""
        P, Q = self.variation(nu, f)
        rows = np.stack([P.conj() + Q, 1j * (P.conj() - Q)])  # gradients of Re k and Im k
        # What holds 0 and 1 is taken off: k(0) - conj(k(0)) f^2 and the turn about 0.
        (zero_re, _), (zero_im, one_im) = rows[:, -2:]
        rows = rows[:, :-2]
        at = (self.points @ f)[:-2, None]
        spin = 2 * zero_im - one_im
        square = at**2
        rows[0] += (square.real - 1) * zero_re + square.imag * zero_im - at.imag * spin
        rows[1] += square.imag * zero_re - (square.real + 1) * zero_im + at.real * spin
        return rows

    def variation(self, nu, f, dtype=complex):
        """P, Q (P + 2, N), `dk(p) = sum P dnu + Q conj(dnu)`, 0 and 1 last; complex64: four digits
        in half the time."""
        both = np.stack([f, self.carrier.slope @ f], axis=1)
        # `dk(p) = sum P dmu + Q conj(dmu)`, a node for its cell.
        w, size, mass = cells(self.carrier.areas, nu, self.carrier.values @ both, dtype)
        at = (self.points @ both[:, 0]).astype(dtype)[:, None]
        P, Q = mass * inverse(w - at, size), mass.conj() * at**3 * inverse(1 - at * w.conj(), size)
        self.refine_near(P, Q, nu, both)
        # dmu = a dnu + b conj(dnu).
        along, across = (bounded_pullback(nu, unit) for unit in (1.0, 1j))
        a = ((along - 1j * across) / 2).real.astype(P.real.dtype)
        b = ((along + 1j * across) / 2).astype(dtype)
        return P * a + Q * b.conj(), P * b + Q * a

    def refine_near(self, P, Q, nu, both):
        """P at close pairs, and Q where mirror images are near, by the parts and the corners."""
        w, size, mass = cells(self.areas, self.hats @ nu, self.values @ both, P.dtype)
        at = both[self.corners, 0].astype(P.dtype)
        weights = self.barycentric.astype(size.dtype)
        row, node = self.close.nonzero()
        part, point = self.part, self.point
        terms = inverse(w[part, None] - at[point], size[part, None])
        P[row, node] = self.spread @ (mass[part] * np.einsum("ek,ek->e", weights[point], terms))
        part, point = part[self.mirrored], point[self.mirrored]
        terms = inverse(1 - at[point] * w[part, None].conj(), size[part, None])
        sums = np.zeros(len(self.part), complex)
        average = np.einsum("ek,ek->e", (weights * at**3)[point], terms)
        sums[self.mirrored] = mass[part].conj() * average
        Q[row[self.replaced], node[self.replaced]] = (self.spread @ sums)[self.replaced]


def hats_inside(triangles, n_vertices):
    """Sparse (FINER^2 T, V): from vertex values to means over the FINER^2 parts of each triangle
    (T, 3)."""
    shares = np.tile(middles(FINER), (len(triangles), 1))
    return three_a_row(shares, np.repeat(triangles, FINER**2, axis=0), n_vertices)


def cells(areas, nu, places, dtype):
    """Of cells at places (n, 2), f and f_z: f, the images' size as disks (radius squared), the mass
    in the integral."""
    w, slope = places.astype(dtype).T
    square = slope**2
    areas = (areas / np.pi).astype(square.real.dtype)
    size = areas * abs(square) * (1 - np.tanh(abs(nu)) ** 2)
    return w, size.astype(areas.dtype), -areas * square


def inverse(d, size):
    """`1 / d`, no larger than at the rim of a disk of this radius squared."""
    # A product with a real reciprocal: NumPy divides by a real in complex numbers.
    return d.conj() * (1 / np.maximum(d.real**2 + d.imag**2, size))
