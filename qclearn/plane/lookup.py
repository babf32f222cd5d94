"""Where points lie in a mesh of the disk, and values there."""

from functools import cached_property

import numpy as np
import scipy
import shapely

WALK = 12  # faces that a point may lie away from where it is looked for first
LOST, BEYOND = -1, -2  # in place of a face: not found on the way there; across the boundary of a convex polygon
FEW = 0.25  # share of the faces of which polygons are built at once
INSET = 1e-4  # share of the radius that points moved onto the boundary polygon stay inside it


class Lookup:
    """Where points lie in one `Disk`: (face, barycentric coordinates), its search trees kept. Nothing is checked.

    `lookup(points, guess)` begins at the faces `guess` (P,), else at the nearest vertices. `once`: a single question.
    """

    def __init__(self, disk):
        self.disk, self.z, self.faces = disk, disk.z, disk.faces

    def __call__(self, points, guess=None):
        inside = self._walk(points, self._nearby(points) if guess is None else guess)
        lost = np.flatnonzero(inside == LOST)
        if len(lost):
            hit, face = self._tree.query(shapely.points(pairs(points[lost])), predicate="intersects")
            inside[lost[hit]] = face
        return self._weighed(points, inside)

    def once(self, points):
        """The same without a tree of the whole mesh, where few faces come near the points."""
        corners, wanted = pairs(self.z[self.faces]), pairs(points)
        low, high = wanted.min(0, initial=np.inf), wanted.max(0, initial=-np.inf)
        near = np.flatnonzero(((corners.max(1) >= low) & (corners.min(1) <= high)).all(1))
        if len(near) >= FEW * len(self.faces):
            return self(points)
        inside = np.full(len(points), LOST)
        hit, face = shapely.STRtree(shapely.polygons(corners[near])).query(shapely.points(wanted), "intersects")
        inside[hit] = near[face]
        return self._weighed(points, inside)

    def _weighed(self, points, inside):
        """The faces and weights of points (P,); those in no face are first moved onto the boundary polygon."""
        outside = np.flatnonzero(inside < 0)
        if len(outside):
            points = points.copy()
            inside[outside], points[outside] = self._project_radially(points[outside])
        return inside, _barycentric(self.z[self.faces[inside]], points)

    @cached_property
    def _tree(self):
        """The search tree of the faces: slow to build, and needed only where points are LOST."""
        return shapely.STRtree(shapely.polygons(pairs(self.z[self.faces])))

    def _walk(self, points, face):
        """The faces that hold points (P,), found from `face` (P,) in a few steps across edges; or LOST, or BEYOND."""
        face, at = face.copy(), np.arange(len(points))
        for _ in range(WALK):
            sides = _edge_distances(self.z[self.faces[face[at]]], points[at])
            first = sides.argmin(1)
            beyond = sides[np.arange(len(at)), first] < 0
            at, first = at[beyond], first[beyond]
            if not len(at):
                return face
            across = self.disk.across[face[at], first]
            if (across < 0).any():  # `_out` is not found before a point needs it
                across[across < 0] = self._out
            face[at] = across
            at = at[across >= 0]
        face[at] = LOST
        return face

    def _nearby(self, points):
        """A face at the vertex nearest each of the points (P,)."""
        tree, face = self._vertices
        return face[tree.query(pairs(points))[1]]

    @cached_property
    def _vertices(self):
        """The search tree of the vertices, and a face at each."""
        at, face = np.flatnonzero(np.bincount(self.faces.ravel())), np.empty(len(self.z), int)
        face[self.faces.ravel()] = np.repeat(np.arange(len(self.faces)), 3)
        return scipy.spatial.cKDTree(pairs(self.z[at]), balanced_tree=False, compact_nodes=False), face[at]

    @cached_property
    def _out(self):
        """The answer for a point across the boundary: BEYOND a convex polygon, else LOST."""
        rim = self.z[self.disk.loop]
        edges = np.roll(rim, -1) - rim
        turns = np.angle(np.roll(edges, -1) / edges)
        return BEYOND if turns.min() >= 0 and turns.sum() < 3 * np.pi else LOST

    @cached_property
    def _rim(self):
        """The boundary vertices by angle, and the face at each one's edge to the next."""
        loop, rim = self.disk.loop, self.disk.open_halfedges  # each boundary vertex begins one half-edge of it
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


def pairs(z):
    return np.stack([z.real, z.imag], axis=-1)


def _edge_distances(corners, points):
    """Twice the signed areas of a point with each edge of a triangle, (P, 3), column k across from corner k."""
    a, b, c = (corners[:, k] - points for k in range(3))
    return np.stack([(b.conj() * c).imag, (c.conj() * a).imag, (a.conj() * b).imag], axis=1)


def _barycentric(corners, points):
    weights = _edge_distances(corners, points)
    weights = np.maximum(weights * np.sign(weights.sum(1, keepdims=True)), 0)  # a face turned over; rounding at an edge
    return weights / weights.sum(1, keepdims=True)
