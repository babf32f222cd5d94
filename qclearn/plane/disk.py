"""A triangulated disk in the plane, `Disk`: where points lie in it, its matrices, derivatives of
maps, certificate."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
import shapely
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .checks import (
    BeltramiError,
    check_coefficient,
    check_faces,
    check_map,
    planar_points,
    read_only,
)
from .coefficients import diffuse
from .linear import assemble, interpolate, opposite_edges, three_a_row

PerVertex, PerFace, Faces = Complex[ndarray, " V"], Complex[ndarray, " F"], Integer[ndarray, " F 3"]
OF_FACES = ("loop", "open_halfedges", "across")  # depend on the faces alone: pictures share them
KEPT = 4  # answers of `Disk.locate`
STEPS = 12  # across edges, from the face where a point is looked for first
INSET = 1e-4  # share of the radius that points moved onto the boundary polygon stay inside it


@dataclass(frozen=True)
class Certificate:
    """Outcome of `check_bijective`: `bijective`, the `flipped` faces, and whether the `boundary` is
    simple."""

    bijective: bool
    flipped: Integer[ndarray, " k"]
    boundary: bool


@dataclass(frozen=True, eq=False)
class Disk:
    """A triangulated disk in the plane: vertices z (V,) complex and faces (F, 3) int64, read-only.

    Making a Disk checks the arrays; `gradients` asks for counter-clockwise triangles, `loop` for
    one simple boundary. BeltramiError says what is wrong.
    """

    z: PerVertex
    faces: Faces

    def __post_init__(self):
        z = planar_points(self.z)
        faces = check_faces(self.faces, len(z))
        vars(self).update(z=read_only(z), faces=read_only(faces))

    def __reduce__(self):
        return Disk, (self.z, self.faces)  # a pickle has no cached answers

    def at(self, f: PerVertex) -> "Disk":
        """The picture of this mesh under a planar map f (V,): the same faces with their vertices at
        f."""
        f = check_map(planar_points(f, "f"), len(self.z))
        picture = object.__new__(Disk)
        shared = {name: vars(self)[name] for name in OF_FACES if name in vars(self)}
        vars(picture).update(z=read_only(f), faces=self.faces, **shared)
        return picture

    @cached_property
    def areas(self) -> Float[ndarray, " F"]:
        """Signed area of each triangle, positive when counter-clockwise: `Im(conj(b - a)(c - a)) /
        2`."""
        a, b, c = self.z[self.faces].T
        return 0.5 * ((b - a).conj() * (c - a)).imag

    @cached_property
    def gradients(self) -> Complex[ndarray, " F 3"]:
        """Gradients of the hat functions, `grad phi_i = i (z_k - z_j) / (2 |T|)` on a triangle (i,
        j, k)."""
        unknown = np.flatnonzero(~np.isfinite(self.z))
        if len(unknown):
            raise BeltramiError(
                f"z is not finite at vertices {unknown[:5].tolist()}; mend the map that made it"
            )
        bad = np.flatnonzero(~(self.areas > 0))
        if len(bad):
            raise BeltramiError(
                f"{len(bad)} source triangles are not counter-clockwise (first: "
                f"{bad[:5].tolist()}); use a planar mesh without folds, or reverse every face if "
                "all of them are clockwise"
            )
        return 0.5j * opposite_edges(self.z[self.faces]) / self.areas[:, None]

    @cached_property
    def centroids(self) -> PerFace:
        """The faces' centroids."""
        return self.z[self.faces].mean(1)

    @cached_property
    def loop(self) -> Integer[ndarray, " B"]:
        """The boundary vertices, counter-clockwise, from the smallest index; BeltramiError unless
        it is one loop."""
        rim = self.open_halfedges
        ends = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=-1).reshape(-1, 2)[rim]
        loops = closed_loops(ends)
        if len(loops) != 1 or len(loops[0]) != len(rim):
            raise BeltramiError("the faces do not form a disk with one simple boundary loop")
        return loops[0]

    @cached_property
    def open_halfedges(self):
        """The boundary's half-edges, (B,): 3 f + k from corner k of face f."""
        return np.flatnonzero(np.roll(self.across, 1, axis=1) < 0)

    @cached_property
    def across(self):
        """The face across from each corner of a face, (F, 3); -1 beyond the boundary."""
        tails = self.faces.ravel()
        heads = np.roll(self.faces, -1, axis=1).ravel()
        edge = np.minimum(tails, heads) * len(self.z) + np.maximum(tails, heads)
        order = np.argsort(edge)
        # Both half-edges of an inner edge follow each other in this order.
        one = order[:-1]
        two = order[1:]
        twins = (edge[one] == edge[two]) & (tails[one] == heads[two])
        across = np.full(len(order), -1)
        across[one[twins]] = two[twins] // 3
        across[two[twins]] = one[twins] // 3
        # The edge from corner k is opposite corner k + 2.
        return np.roll(across.reshape(-1, 3), -1, axis=1)

    def locate(
        self, points: Complex[ndarray, " P"]
    ) -> tuple[Integer[ndarray, " P"], Float[ndarray, " P 3"]]:
        """Where points lie, as `qclearn.locate`: (face, barycentric coordinates, non-negative, sum
        1), read-only; the last answers are kept."""
        points = planar_points(points, "points")
        unknown = np.flatnonzero(~np.isfinite(points))
        if len(unknown):
            raise BeltramiError(
                f"points {unknown[:5].tolist()} are not finite: they lie nowhere; leave them out"
            )
        # A fit and its report ask for the same points again and again.
        for known, answer in self.answers:
            if np.array_equal(known, points):
                return answer
        given = read_only(points)
        # From a face at the nearest vertex a walk crosses the edge that a point lies farthest
        # beyond. `at`: the points that still walk.
        tree, face_at = self.vertex_tree
        face = face_at[tree.query(pairs(points))[1]]
        at = np.arange(len(points))
        for _ in range(STEPS):
            sides = _edge_distances(self.z[self.faces[face[at]]], points[at])
            corner = sides.argmin(1)
            beyond = sides[np.arange(len(at)), corner] < 0
            at, corner = at[beyond], corner[beyond]
            face[at] = self.across[face[at], corner]
            at = at[face[at] >= 0]
            if not len(at):
                break
        face[at] = -1
        # Points that it does not reach, or that left the mesh where they could come back, are
        # looked for in a tree of all faces.
        left = np.flatnonzero(face < 0)
        lost = at if len(at) == len(left) or self.is_convex else left
        if len(lost):
            point, some = self.face_tree.query(shapely.points(pairs(points[lost])), "intersects")
            face[lost[point]] = some
        # Points in no face are moved onto the boundary polygon.
        outside = np.flatnonzero(face < 0)
        if len(outside):
            points = points.copy()
            face[outside], points[outside] = self._project_radially(points[outside])
        weights = _edge_distances(self.z[self.faces[face]], points)
        # The sign: a face may be turned over. The maximum: rounding at an edge.
        weights = np.maximum(weights * np.sign(weights.sum(1, keepdims=True)), 0)
        weights /= weights.sum(1, keepdims=True)
        answer = read_only(face), read_only(weights)
        vars(self)["answers"] = ((given, answer), *self.answers)[:KEPT]
        return answer

    @cached_property
    def answers(self):
        """The last points that were located, and where they lie, the latest first."""
        return ()

    @cached_property
    def vertex_tree(self):
        """The search tree of the vertices, and a face at each."""
        at = np.flatnonzero(np.bincount(self.faces.ravel()))
        face = np.empty(len(self.z), int)
        face[self.faces.ravel()] = np.repeat(np.arange(len(self.faces)), 3)
        tree = scipy.spatial.cKDTree(pairs(self.z[at]), balanced_tree=False, compact_nodes=False)
        return tree, face[at]

    @cached_property
    def face_tree(self):
        """The search tree of the faces: slow to build, and rarely needed."""
        return shapely.STRtree(shapely.polygons(pairs(self.z[self.faces])))

    @cached_property
    def is_convex(self):
        """Whether the boundary is a convex polygon: who leaves it does not come back."""
        rim = self.z[self.loop]
        edges = np.roll(rim, -1) - rim
        turns = np.angle(np.roll(edges, -1) / edges)
        return turns.min() >= 0 and turns.sum() < 3 * np.pi

    def _project_radially(self, points):
        """A boundary face for each of the points (P,), and the points moved onto its chord."""
        angles = np.angle(self.z[self.loop])
        order = np.argsort(angles)
        loop = self.loop[order]
        k = np.searchsorted(angles[order], np.angle(points), side="right") - 1
        a = self.z[loop[k]]
        b = self.z[np.roll(loop, -1)[k]]
        rim = self.open_halfedges  # one begins at each boundary vertex
        face = np.empty(len(self.z), int)
        face[self.faces.ravel()[rim]] = rim // 3
        # The ray s p meets the chord a + t (b - a) where Im(conj(b - a)(s p - a)) = 0.
        s = ((b - a).conj() * a).imag / ((b - a).conj() * points).imag
        radius = abs(points)
        gap = 1 - s * radius  # between the chord and the arc: none at a boundary vertex
        inside = np.divide(1 - radius, gap, out=np.zeros_like(gap), where=gap > 0)
        return face[loop[k]], s * (1 - INSET * np.clip(inside, 0, 1)) * points

    def interpolation(self, points: Complex[ndarray, " P"]) -> Float[sparse.csr_array, " P V"]:
        """The matrix from values of the vertices to values at points (P,), linear in each face."""
        face, weights = self.locate(points)
        return three_a_row(weights, self.faces[face], len(self.z)).sorted_indices()

    def interpolate(self, values, places):
        """Values (V, ...) of the vertices at places (face, weights) as `locate` returns them,
        linear in each face."""
        return interpolate(values, self.faces, places)

    def stiffness(self, mu: PerFace) -> Float[sparse.csc_array, " V V"]:
        """`K(mu)_ij = sum_T |T| grad phi_i . A(mu_T) grad phi_j`, semi-definite; |mu| < 1."""
        mu = check_coefficient(mu, len(self.faces))
        turned = diffuse(mu[:, None], self.gradients)
        products = (self.gradients.conj()[:, :, None] * turned[:, None, :]).real
        return assemble(self.faces, self.areas[:, None, None] * products, len(self.z))

    @cached_property
    def laplace(self) -> Float[sparse.csc_array, " V V"]:
        """K(0), the matrix of the Dirichlet energy."""
        return self.stiffness(np.zeros(len(self.faces)))

    @cached_property
    def mass(self) -> Float[sparse.csc_array, " V V"]:
        """The consistent mass matrix."""
        blocks = self.areas[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12
        return assemble(self.faces, blocks, len(self.z))

    @cached_property
    def to_vertices(self) -> Float[sparse.csr_array, " V F"]:
        """From values of the faces to their averages by area around each vertex."""
        areas = np.repeat(self.areas[:, None], 3, axis=1)
        around = three_a_row(areas, self.faces, len(self.z)).T.tocsr()
        return sparse.diags_array(1 / around.sum(1)) @ around

    @cached_property
    def to_faces(self) -> Float[sparse.csr_array, " F V"]:
        """From values of the vertices to the value at each face's centroid."""
        thirds = np.full(self.faces.shape, 1 / 3)
        return three_a_row(thirds, self.faces, len(self.z)).sorted_indices()

    def wirtinger(self, f):
        """`f_z` and `f_zbar` on each face of a map f, complex (V,) or real (V, 3): (F,) or (F, 3)
        each."""
        corners = check_map(f, len(self.z))[self.faces]
        f_z = 0.5 * np.einsum("fk,fk...->f...", self.gradients.conj(), corners)
        return f_z, 0.5 * np.einsum("fk,fk...->f...", self.gradients, corners)

    def coefficient(self, f):
        """mu (F,) of a map f, complex (V,) or real (V, 3), as `qclearn.beltrami_coefficient`."""
        f_z, f_zbar = self.wirtinger(f)
        with np.errstate(divide="ignore", invalid="ignore"):
            if f_z.ndim == 1:
                return f_zbar / f_z
            # Summed over the three coordinates: f_zbar^2 is (E - G + 2iF)/4 and |f_z|^2 is (E +
            # G)/4.
            difference = (f_zbar**2).sum(1)
            total = (abs(f_z) ** 2).sum(1)
            area_element = np.sqrt(np.maximum(total**2 - abs(difference) ** 2, 0.0))
            return difference / (total + area_element)

    @cached_property
    def maybe_flipped(self) -> Integer[ndarray, " k"]:
        """The faces that are flipped, or that rounding leaves in doubt."""
        a, b, c = self.z[self.faces].T
        with np.errstate(all="ignore"):  # what overflows, or is not finite, stays in doubt
            left = (b - a).real * (c - a).imag
            right = (b - a).imag * (c - a).real
            # A determinant of rounded differences is safe in sign once it exceeds this part of its
            # terms (Shewchuk 1997 has 3.3e-16); 1e-300 stands for what products lose below the
            # smallest normal number.
            return np.flatnonzero(~(left - right > 1e-15 * (abs(left) + abs(right)) + 1e-300))

    @cached_property
    def flipped(self) -> Integer[ndarray, " k"]:
        """The faces that are not counter-clockwise, decided exactly: those in doubt in integers."""
        corners = self.z[self.faces[self.maybe_flipped]]
        finite = np.isfinite(corners).all(1)
        vertices, corners = np.unique(self.faces[self.maybe_flipped[finite]], return_inverse=True)
        # 2^1074 times the coordinates are integers, as no double has a larger denominator.
        largest, exact = 2**1074, []
        for part in (self.z[vertices].real, self.z[vertices].imag):
            ratios = map(float.as_integer_ratio, part.tolist())
            whole = np.array([number * (largest // by) for number, by in ratios], dtype=object)
            exact.append(whole[corners.reshape(-1, 3).T])
        (ax, bx, cx), (ay, by, cy) = exact
        sound = np.zeros(len(self.maybe_flipped), bool)
        sound[finite] = (bx - ax) * (cy - ay) > (by - ay) * (cx - ax)
        return self.maybe_flipped[~sound]

    @cached_property
    def certificate(self) -> Certificate:
        """Whether no face is flipped and the boundary is a simple polygon, counter-clockwise."""
        rim = self.z[self.loop]
        simple = bool(np.isfinite(rim).all())
        if simple:
            ring = shapely.linearrings(pairs(rim))
            simple = bool(ring.is_simple and ring.is_ccw)
        return Certificate(simple and len(self.flipped) == 0, self.flipped, simple)

    def certify(self, f):
        """The `Certificate` of a map f (V,); BeltramiError where the mesh itself is folded."""
        if len(self.flipped):
            raise BeltramiError(
                f"{len(self.flipped)} triangles of the source mesh are folded or without area "
                f"(first: {self.flipped[:5].tolist()}): a map of it cannot be certified"
            )
        return self.at(f).certificate


def closed_loops(halfedges):
    """The loops that directed edges (B, 2) form, each from its smallest vertex, in their order."""
    following = dict(halfedges.tolist())
    loops = []
    for start in sorted(following):
        if start in following:
            loop = [start]
            # Edges of no closed loop end where no edge goes on.
            while (vertex := following.pop(loop[-1], None)) not in (start, None):
                loop.append(vertex)
            loops.append(read_only(np.array(loop, dtype=np.int64)))
    return loops


def pairs(z):
    """x and y of points (...,), real (..., 2)."""
    return np.stack([z.real, z.imag], axis=-1)


def _edge_distances(corners, points):
    """Twice the signed areas of a point with each edge of a triangle, (P, 3), column k opposite
    corner k."""
    a, b, c = (corners[:, k] - points for k in range(3))
    return np.stack([(b.conj() * c).imag, (c.conj() * a).imag, (a.conj() * b).imag], axis=1)
