"""Meshes of the unit disk, the square beside it, and where a point lies in a disk mesh."""

from functools import cached_property

import numpy as np
import scipy
import shapely
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .checks import BeltramiError, check_faces, check_mesh, planar_points

WALK = 12  # faces that a point may lie away from where it is looked for first
LOST, BEYOND = -1, -2  # in place of a face: not found on the way there; across the boundary of a convex polygon
FEW = 0.25  # share of the faces of which polygons are built at once
INSET = 1e-4  # share of the radius that points moved onto the boundary polygon stay inside it


class SurfaceError(ValueError):
    """A surface, or a file of one, that cannot be used: says what was found, where (indices) and what to do."""


def square_to_disk(w: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Radial map of the square [-1, 1]^2 onto the unit disk, `w max(|cos t|, |sin t|)`, t = arg w; 0 to 0."""
    w = np.asarray(w, complex)
    return w * _radius_ratio(w)


def disk_to_square(z: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Inverse of `square_to_disk`: `z / max(|cos t|, |sin t|)` (the paper's formula with its absolute values)."""
    z = np.asarray(z, complex)
    return z / _radius_ratio(z)


def _radius_ratio(w):
    size = abs(w)
    largest = np.maximum(abs(w.real), abs(w.imag))
    return np.divide(largest, size, out=np.ones_like(size), where=size > 0)


def square_disk(n: int) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Disk mesh with the topology of an n x n square grid, n even: (z, faces).

    Every cell is split by the diagonal that runs into the square's corner of its quadrant; the other choice puts a
    triangle with three boundary vertices at each corner, which carries no boundary flux.
    """
    if n < 2 or n % 2:
        raise ValueError(f"square_disk needs an even number of cells a side, at least 2; got {n}")
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    a, b, c, d = corner, corner + 1, corner + n + 2, corner + n + 1  # counter-clockwise from the lower left
    row, column = np.divmod(np.arange(n * n), n)
    rising = ((row >= n // 2) == (column >= n // 2))[:, None]
    first = np.where(rising, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(rising, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return square_to_disk((x + 1j * y).ravel()), np.concatenate([first, second])


def polar_disk(nr: int, nt: int, power: float = 1.0) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Graded polar disk mesh: vertex 0 at the centre, then nr rings of nt vertices at radius (j / nr)^power.

    Returns (z (1 + nr nt,), faces); all quads are split along the same diagonal, so that the mesh is invariant under
    rotation by 2 pi / nt. Vertex `1 + (nr - 1) nt` lies at 1.
    """
    if nr < 1 or nt < 3:
        raise ValueError(f"polar_disk needs at least 1 ring and 3 angles; got {nr} and {nt}")
    radius = (np.arange(1, nr + 1) / nr) ** power
    spokes = np.exp(2j * np.pi * np.arange(nt) / nt)
    z = np.concatenate([[0], (radius[:, None] * spokes).ravel()])
    k, following = np.arange(nt), (np.arange(nt) + 1) % nt
    faces = [np.stack([np.zeros(nt, int), 1 + k, 1 + following], 1)]
    for j in range(nr - 1):
        inner, outer = 1 + j * nt, 1 + (j + 1) * nt
        faces += [
            np.stack([inner + k, outer + k, outer + following], 1),
            np.stack([inner + k, outer + following, inner + following], 1),
        ]
    return z, np.concatenate(faces)


def boundary_loop(faces):
    """Vertices of the boundary of a triangulated disk, counter-clockwise, from the smallest index: (B,).

    BeltramiError if the faces have no boundary or several, or touch in a vertex.
    """
    faces = check_faces(faces)
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    alone = _alone(faces)
    following = dict(zip(tails[alone].tolist(), heads[alone].tolist()))
    loop = [min(following, default=None)]
    while len(loop) <= len(following) and following.get(loop[-1]) != loop[0]:
        loop.append(following.get(loop[-1]))
    if len(following) != alone.sum() or len(loop) != len(following):
        raise BeltramiError("the faces do not form a disk with one simple boundary loop")
    return np.array(loop)


def _alone(faces):
    """Which of the half-edges (3 F,), 3 f + k from corner k of face f, have no opposite one: those of the boundary."""
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    n = int(faces.max()) + 1
    there, opposite = np.sort(tails * n + heads), heads * n + tails
    return there[np.minimum(np.searchsorted(there, opposite), len(there) - 1)] != opposite


def locate(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], points: Complex[ndarray, " P"]
) -> tuple[Integer[ndarray, " P"], Float[ndarray, " P 3"]]:
    """Where points lie in a disk mesh: (face, barycentric coordinates, non-negative, sum 1).

    A point beyond the boundary polygon (between a chord and its arc, say) is first moved radially onto the polygon;
    one inside the circle stays short of it by up to INSET of its radius, so that triangles there keep an area.
    BeltramiError for a point that is not finite.
    """
    (z, faces), points = check_mesh(z, faces), np.atleast_1d(planar_points(points, "points"))
    unknown = np.flatnonzero(~np.isfinite(points))
    if len(unknown):
        raise BeltramiError(
            f"points {unknown[:5].tolist()} are not finite: they lie nowhere in the mesh; leave them out"
        )
    corners, wanted = _pairs(z[faces]), _pairs(points)
    low, high = wanted.min(0, initial=np.inf), wanted.max(0, initial=-np.inf)
    near = np.flatnonzero(((corners.max(1) >= low) & (corners.min(1) <= high)).all(1))
    return Lookup(z, faces, near if len(near) < FEW * len(faces) else None)(points)


class Lookup:
    """Where points lie in one disk mesh, for many questions: `lookup(points)` as `locate`, its search tree kept.

    z (V,) complex, faces (F, 3), near: the few faces in which points can lie, None for all. Nothing is checked.
    `lookup(points, guess)` tries the faces `guess` (P,) first, and their neighbours: soon done where points have moved
    little since they were found there. Without, it begins at the nearest vertices.
    """

    def __init__(self, z, faces, near=None):
        self.z, self.faces, self.near = z, faces, near

    @cached_property
    def tree(self):
        """The search tree of the faces: what takes the longest to build, and not needed where all ways lead on."""
        faces = self.faces if self.near is None else self.faces[self.near]
        return shapely.STRtree(shapely.polygons(_pairs(self.z[faces])))

    def __call__(self, points, guess=None):
        if guess is None and self.near is None:
            guess = self._nearby(points)
        inside = np.full(len(points), LOST) if guess is None else self._walk(points, guess)
        lost = np.flatnonzero(inside == LOST)
        if len(lost):
            hit, face = self.tree.query(shapely.points(_pairs(points[lost])), predicate="intersects")
            inside[lost[hit]] = face if self.near is None else self.near[face]
        outside = np.flatnonzero(inside < 0)
        if len(outside):
            points = points.copy()
            inside[outside], points[outside] = self._project_radially(points[outside])
        return inside, _barycentric(self.z[self.faces[inside]], points)

    def _walk(self, points, face):
        """The faces that hold points (P,), found from `face` (P,) across edges in a few steps; or LOST, or BEYOND."""
        face, at = face.copy(), np.arange(len(points))
        for _ in range(WALK):
            sides = _edge_distances(self.z[self.faces[face[at]]], points[at])
            first = sides.argmin(1)
            beyond = sides[np.arange(len(at)), first] < 0
            at, first = at[beyond], first[beyond]
            if not len(at):
                return face
            across = self._neighbours[face[at], first]
            if (across < 0).any():
                across[across < 0] = self._out
            face[at] = across
            at = at[across >= 0]
        face[at] = LOST
        return face

    def _nearby(self, points):
        """A face at the vertex nearest each of the points (P,)."""
        tree, face = self._vertices
        return face[tree.query(_pairs(points))[1]]

    @cached_property
    def _vertices(self):
        """The search tree of the vertices, and a face at each."""
        at, face = np.unique(self.faces), np.empty(len(self.z), int)
        face[self.faces.ravel()] = np.repeat(np.arange(len(self.faces)), 3)
        return scipy.spatial.cKDTree(_pairs(self.z[at]), balanced_tree=False, compact_nodes=False), face[at]

    @cached_property
    def _out(self):
        """What a step across the boundary says of a point: in a convex polygon, that it lies BEYOND."""
        rim = self.z[boundary_loop(self.faces)]
        edges = np.roll(rim, -1) - rim
        turns = np.angle(np.roll(edges, -1) / edges)
        return BEYOND if turns.min() >= 0 and turns.sum() < 3 * np.pi else LOST

    @cached_property
    def _neighbours(self):
        """The face across from each corner of a face, (F, 3); -1 beyond the boundary."""
        tails, heads, n = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel(), len(self.z)
        there, back = tails * n + heads, heads * n + tails
        order = np.argsort(there)
        place = order[np.minimum(np.searchsorted(there, back, sorter=order), len(order) - 1)]
        across = np.where(there[place] == back, place // 3, -1).reshape(-1, 3)
        return np.roll(across, -1, axis=1)  # the edge from corner k lies across from corner k + 2

    @cached_property
    def _rim(self):
        """The boundary vertices in the order of their angles, and the face with each one's edge to the next."""
        loop = boundary_loop(self.faces)
        rim = np.flatnonzero(_alone(self.faces))  # each boundary vertex begins one half-edge of the boundary
        face = np.empty(len(self.z), int)
        face[self.faces.ravel()[rim]] = rim // 3
        loop = loop[np.argsort(np.angle(self.z[loop]))]
        return loop, face[loop]

    def _project_radially(self, points):
        loop, face = self._rim
        k = (np.searchsorted(np.angle(self.z[loop]), np.angle(points), side="right") - 1) % len(loop)
        a, b = self.z[loop[k]], self.z[loop[(k + 1) % len(loop)]]
        # The ray s p meets the chord a + t (b - a) where Im(conj(b - a)(s p - a)) = 0.
        s = ((b - a).conj() * a).imag / ((b - a).conj() * points).imag
        radius = abs(points)
        gap = 1 - s * radius  # between the chord and the arc: none at a boundary vertex
        s = s * (1 - INSET * np.clip(np.divide(1 - radius, gap, out=np.zeros_like(gap), where=gap > 0), 0, 1))
        return face[k], s * points


def interpolate(values, faces, face, weights):
    """Per-vertex values (V, ...) at places in a mesh, (P, ...), linear in each face; the places as `locate` gives
    them."""
    return np.einsum("pk,pk...->p...", weights, np.asarray(values)[np.asarray(faces)[face]])


def sampling_matrix(z, faces, points):
    """The sparse real matrix (P, V) that evaluates a piecewise linear function of the disk mesh at points (P,)."""
    face, weights = locate(z, faces, points)
    rows = np.repeat(np.arange(len(weights)), 3)
    return sparse.csr_array((weights.ravel(), (rows, np.asarray(faces)[face].ravel())), shape=(len(weights), len(z)))


def _pairs(z):
    return np.stack([z.real, z.imag], axis=-1)


def _edge_distances(corners, points):
    """Twice the signed areas of a point with each edge of a triangle, (P, 3), column k across from corner k."""
    a, b, c = (corners[:, k] - points for k in range(3))
    return np.stack([(b.conj() * c).imag, (c.conj() * a).imag, (a.conj() * b).imag], axis=1)


def _barycentric(corners, points):
    weights = _edge_distances(corners, points)
    weights = np.maximum(weights * np.sign(weights.sum(1, keepdims=True)), 0)  # a face turned over; rounding at an edge
    return weights / weights.sum(1, keepdims=True)


def pixel_centres(size):
    """Pixel centres of the image of [-1, 1]^2, complex (size, size): x grows with the column, y with the row."""
    axis = (2 * np.arange(size) + 1) / size - 1
    return axis[None, :] + 1j * axis[:, None]
