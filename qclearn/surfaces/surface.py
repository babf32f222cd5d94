"""Triangulated surfaces: validated once, immutable afterwards, with the topology that everything else asks for."""

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra, minimum_spanning_tree

from ..plane.diskmesh import SurfaceError

LARGEST = 1e60  # of a coordinate: a squared area, its fourth power, is still a number


class Surface:
    """An oriented, connected, manifold triangle mesh in space, open or closed; raises SurfaceError if it is not one.

    vertices (V, 3) float64 in any length unit; faces (F, 3) int64, orientation kept as given (outward = positive
    `volume`); curves: dict name -> (k,) int64 vertex path; edges (E, 2) int64, sorted; edge_faces (E, 2), the faces on
    the two sides of each edge, -1 beyond the boundary; original_vertices (V,) int64 or None: where the surface was cut
    out of a whole one, the vertices' numbers there. The arrays are read-only, so what was checked stays true.
    """

    def __init__(self, vertices, faces, curves=None, original_vertices=None):
        self.vertices = _frozen(_vertex_array(vertices))
        self.faces = _frozen(_face_array(faces))
        _check_faces(self.vertices, self.faces)
        self.edges, self.edge_faces, self._boundary_halfedges = _check_topology(len(self.vertices), self.faces)
        self.curves = {name: _frozen(_curve(name, path, len(self.vertices))) for name, path in (curves or {}).items()}
        self.original_vertices = _original(original_vertices, len(self.vertices))

    def __repr__(self):
        curves = f", curves {', '.join(self.curves)}" if self.curves else ""
        return f"Surface({len(self.vertices)} vertices, {len(self.faces)} faces{curves})"

    @cached_property
    def boundary_loops(self):
        """List of (k,) int arrays: each loop runs along its faces' own edges (the surface on its left seen from
        outside), starts at its smallest vertex index; loops in the order of their first vertices."""
        following = dict(self._boundary_halfedges.tolist())
        loops = []
        for start in sorted(following):
            if start in following:
                loop = [start]
                while (vertex := following.pop(loop[-1])) != start:
                    loop.append(vertex)
                loops.append(_frozen(np.array(loop, dtype=np.int64)))
        return loops

    @cached_property
    def boundary(self):
        """The boundary loop (k,) int, from its smallest vertex index; SurfaceError unless there is exactly one."""
        if len(self.boundary_loops) != 1:
            raise SurfaceError(_loops_message(self))
        return self.boundary_loops[0]

    @property
    def euler_characteristic(self):
        """V - E + F: 2 for a sphere, 1 for a disk, less by 1 for each further hole and by 2 for each handle."""
        return len(self.vertices) - len(self.edges) + len(self.faces)

    @cached_property
    def face_areas(self):
        """Areas of the faces (F,), in squared units of the vertices."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        return _frozen(0.5 * _norm(np.cross(b - a, c - a)))

    @cached_property
    def vertex_areas(self):
        """One third of the areas of the faces around each vertex (V,)."""
        total = np.bincount(self.faces.ravel(), weights=np.repeat(self.face_areas, 3), minlength=len(self.vertices))
        return _frozen(total / 3)

    @property
    def area(self):
        """Total area."""
        return float(self.face_areas.sum())

    @cached_property
    def volume(self):
        """Signed enclosed volume, each loop capped by a fan from its centroid; positive = the faces look outward."""
        centred = self.vertices - self.vertices.mean(axis=0)
        six_volumes = np.linalg.det(centred[self.faces]).sum()
        for loop in self.boundary_loops:
            rim = centred[loop]
            centre = np.broadcast_to(rim.mean(axis=0), rim.shape)
            # the cap runs against the loop, as every neighbouring face does
            six_volumes += np.linalg.det(np.stack([centre, np.roll(rim, -1, axis=0), rim], axis=1)).sum()
        return float(six_volumes / 6)


def require_disk(surface):
    """Raise SurfaceError unless the surface is a topological disk: one boundary loop and Euler characteristic 1."""
    if len(surface.boundary_loops) != 1:
        raise SurfaceError(_loops_message(surface))
    if surface.euler_characteristic != 1:
        handles = (1 - surface.euler_characteristic) // 2
        raise SurfaceError(
            f"the surface has {handles} handle{'s' * (handles > 1)} (Euler characteristic "
            f"{surface.euler_characteristic}, a disk has 1); loops through them cross the edges "
            f"{_some(_handle_edges(surface))}. Repair the topology where the surface was made "
            f"(FreeSurfer: mris_fix_topology) or cut the handles out with open_surface(surface, mask)."
        )


def require_outward(surface):
    """Raise SurfaceError unless the faces look outward: positive `volume`, beyond rounding."""
    if abs(surface.volume) <= 1e-12 * surface.area**1.5:
        raise SurfaceError(
            "the surface encloses no volume (it lies in a plane), so its orientation cannot be told; "
            "use the surface in space (pial, white or midthickness) instead of a flat patch."
        )
    if surface.volume < 0:
        raise SurfaceError(
            f"the surface looks inward (signed volume {surface.volume:.6g}). Reverse all faces: "
            f"Surface(vertices, faces[:, ::-1], curves), or `qclearn open --reverse`."
        )


def mirror(surface):
    """The surface with x negated and every face reversed, so that outward stays outward; vertices and curves keep
    their indices."""
    vertices = surface.vertices * [-1.0, 1.0, 1.0]
    return Surface(vertices, surface.faces[:, ::-1], surface.curves, surface.original_vertices)


def _frozen(array):
    array.flags.writeable = False
    return array


def _count(items, one, many=None):
    return f"{len(items)} {one if len(items) == 1 else many or one + 's'}"


def _some(items):
    """The first five of a list or an array, and how many more: for error messages."""
    items = items if isinstance(items, list) else items.tolist()
    shown = ", ".join(str(item) for item in items[:5])
    return shown + (f" and {len(items) - 5} more" if len(items) > 5 else "")


def _original(numbers, n_vertices):
    """original_vertices as checked integers, or None."""
    if numbers is None:
        return None
    numbers = np.asarray(numbers)
    if numbers.shape != (n_vertices,) or not np.issubdtype(numbers.dtype, np.integer):
        raise SurfaceError(
            f"original_vertices must be {n_vertices} whole numbers, one a vertex, not {numbers.dtype} of shape "
            f"{numbers.shape}; give the second result of open_surface, or leave them out."
        )
    if numbers.min() < 0 or len(np.unique(numbers)) < n_vertices:
        raise SurfaceError(
            "original_vertices has negative numbers or one number twice, and a vertex of the whole surface is at most "
            "one of the cut one; give the second result of open_surface, or leave them out."
        )
    return _frozen(numbers.astype(np.int64))


def _vertex_array(vertices):
    if np.iscomplexobj(vertices):
        raise SurfaceError("vertices are complex; give a planar mesh as numpy.stack([z.real, z.imag, 0 * z.real], 1).")
    try:
        given = np.asarray(vertices).dtype
        vertices = np.array(vertices, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise SurfaceError(f"vertices must be a (V, 3) array of real numbers, but {error}.") from None
    if given.kind not in "fiu":
        raise SurfaceError(f"vertices must be a (V, 3) array of real numbers, but they are of the type {given}.")
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SurfaceError(f"vertices must have the shape (V, 3), not {vertices.shape}; pad planar points with z = 0.")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise SurfaceError(
            f"{_count(bad, 'vertex', 'vertices')} with NaN or infinite coordinates: {_some(bad)}. "
            f"Remove them with their faces, or export the surface again."
        )
    far = np.flatnonzero((np.abs(vertices) > LARGEST).any(axis=1))
    if far.size:
        raise SurfaceError(
            f"{_count(far, 'vertex', 'vertices')} with coordinates beyond {LARGEST:g}: {_some(far)}. Areas and volumes "
            f"would overflow; give the surface in millimetres, or export it again if it is damaged."
        )
    return vertices


def _face_array(faces):
    faces = np.asarray(faces)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise SurfaceError(f"faces must have the shape (F, 3), not {faces.shape}; split polygons into triangles.")
    if faces.dtype.kind not in "iu":
        raise SurfaceError(f"faces must be integers, not {faces.dtype}; convert them with faces.astype(int).")
    if not len(faces):
        raise SurfaceError("the surface has no faces; give at least one triangle.")
    return np.array(faces, dtype=np.int64, order="C")


def _curve(name, path, n_vertices):
    path = np.array(path)
    if path.ndim != 1 or path.size == 0 or path.dtype.kind not in "iu":
        raise SurfaceError(f"curve '{name}' must be a non-empty list of vertex indices (integers).")
    bad = path[(path < 0) | (path >= n_vertices)]
    if bad.size:
        raise SurfaceError(
            f"curve '{name}' names vertices that do not exist: {_some(bad)}; "
            f"indices run from 0 to {n_vertices - 1}: take the curve from this very surface."
        )
    return path.astype(np.int64)


def _check_faces(vertices, faces):
    """Index range, unused vertices, degenerate faces."""
    if faces.min() < 0 or faces.max() >= len(vertices):
        out = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
        raise SurfaceError(
            f"{_count(out, 'face')} with corners outside 0 ... {len(vertices) - 1}: {_some(out)}. "
            f"Indices count from 0 (subtract 1 if the source counts from 1)."
        )
    unused = np.flatnonzero(np.bincount(faces.ravel(), minlength=len(vertices)) == 0)
    if unused.size:
        raise SurfaceError(
            f"{_count(unused, 'vertex', 'vertices')} in no face: {_some(unused)}. Drop them: used, corners = "
            f"numpy.unique(faces, return_inverse=True); Surface(vertices[used], corners.reshape(-1, 3))."
        )
    degenerate = degenerate_faces(vertices, faces)
    if degenerate.size:
        raise SurfaceError(
            f"{_count(degenerate, 'degenerate face')} (a repeated vertex or zero area): {_some(degenerate)}. "
            f"Merge coincident vertices and collapse these faces (pyvista.PolyData.clean does both)."
        )


def degenerate_faces(vertices, faces):
    """Indices (k,) of the faces with a repeated vertex, or whose height over their longest side is below rounding."""
    i, j, k = faces.T
    a, b, c = vertices[i], vertices[j], vertices[k]
    sides = np.stack([_norm(b - a), _norm(c - b), _norm(a - c)])
    double_area = _norm(np.cross(b - a, c - a))
    rounding = 8 * np.finfo(float).eps * np.abs(vertices).max()
    return np.flatnonzero((i == j) | (j == k) | (k == i) | (double_area <= rounding * sides.max(axis=0)))


def _norm(vectors):
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _check_duplicates(faces):
    ordered = np.sort(faces, axis=1)
    order = np.lexsort(ordered.T)
    same = (ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)
    if same.any():
        pairs = np.sort(np.stack([order[:-1][same], order[1:][same]], axis=1), axis=1)
        raise SurfaceError(
            f"duplicate faces: {_count(pairs, 'pair')} with the same vertices: {_some(pairs)}. Keep one of each pair."
        )


def _check_topology(n_vertices, faces):
    """Edges (E, 2), their faces (E, 2) and the boundary half-edges (B, 2) of a mesh that is found manifold,
    consistently oriented and connected."""
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()  # half-edge 3 f + k leaves corner k of face f
    key = np.minimum(tails, heads) * n_vertices + np.maximum(tails, heads)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(first, append=len(key))
    edges = np.stack(np.divmod(key[order[first]], n_vertices), axis=1)
    one, two = order[first[count == 2]], order[first[count == 2] + 1]
    crowded, wrong = edges[count > 2], tails[one] == tails[two]
    if len(crowded) or wrong.any() or len(faces) == 2:  # where there are twins, one of these holds: a cheap test first
        _check_duplicates(faces)
    if len(crowded):
        raise SurfaceError(
            f"not manifold: {_count(crowded, 'edge')} (vertex pairs) with more than two faces: {_some(crowded)}. "
            f"Delete the extra faces or duplicate the vertices along these edges."
        )
    if wrong.any():
        pairs = np.stack([one[wrong] // 3, two[wrong] // 3], axis=1)
        raise SurfaceError(
            f"inconsistent orientation: {_count(pairs, 'pair')} of faces that run along their common edge in the same "
            f"direction: {_some(pairs)}. Reverse one face of each pair (pyvista.PolyData.compute_normals("
            f"consistent_normals=True) does it for a whole orientable surface)."
        )
    _check_connected(n_vertices, edges)
    _check_fans(n_vertices, faces, one, two)
    edge_faces = np.stack([order[first] // 3, np.full(len(edges), -1)], axis=1)
    edge_faces[count == 2, 1] = two // 3
    single = order[first[count == 1]]
    return _frozen(edges), _frozen(edge_faces), np.stack([tails[single], heads[single]], axis=1)


def _check_connected(n_vertices, edges):
    n_components, label = _components(n_vertices, edges[:, 0], edges[:, 1])
    if n_components > 1:
        sizes = np.bincount(label)
        firsts = np.unique(label, return_index=True)[1]
        listed = [f"{sizes[k]} vertices around vertex {firsts[k]}" for k in np.argsort(-sizes)]
        raise SurfaceError(
            f"the surface has {n_components} components: {_some(listed)}. Keep one of them "
            f"(pyvista.PolyData.extract_largest) and drop the rest."
        )


def _check_fans(n_vertices, faces, one, two):
    """The faces around a vertex must form one fan; one, two = the half-edges on the two sides of inner edges."""
    corner = np.arange(3 * len(faces))
    after = (corner // 3) * 3 + (corner + 1) % 3  # the corner at the head of half-edge `corner`
    n_fans, label = _components(len(corner), np.r_[one, after[one]], np.r_[after[two], two])
    if n_fans > n_vertices:
        vertex_of_fan = np.empty(n_fans, dtype=np.int64)
        vertex_of_fan[label] = faces.ravel()
        bad = np.flatnonzero(np.bincount(vertex_of_fan, minlength=n_vertices) > 1)
        raise SurfaceError(
            f"not manifold: {_count(bad, 'vertex', 'vertices')} where several fans of faces meet in a point: "
            f"{_some(bad)}. Duplicate the vertex for each fan, or delete all fans but one."
        )


def _components(size, start, end):
    graph = csr_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(size, size))
    return connected_components(graph, directed=False)


def _loops_message(surface):
    loops = surface.boundary_loops
    if not loops:
        return (
            "the surface is closed (no boundary), where a disk is needed; cut it open along the medial wall: "
            "open_surface(surface, mask), or `qclearn open SURFACE --label FILE --out FILE`."
        )
    listed = [f"{len(loop)} vertices from vertex {loop[0]}" for loop in sorted(loops, key=len, reverse=True)]
    return (
        f"the surface has {len(loops)} boundary loops, where a disk has one: {_some(listed)}. Fill the inner holes "
        f"with faces, or cut a new opening that takes them in: open_surface(surface, mask)."
    )


def _handle_edges(surface):
    """Edges (2 x handles, 2): each closes a loop through a handle, one of the shortest from vertex 0 (Erickson and
    Whittlesey 2005: a shortest-path tree, and among the other edges a spanning tree of the faces across the longest
    loops, the outside counting as a face; the edges in neither are the ones)."""
    n_vertices, n_cells = len(surface.vertices), len(surface.faces) + 1
    one, two = surface.edges.T
    graph = csr_array((np.ones(len(one)), (one, two)), shape=(n_vertices, n_vertices))
    depth, parent = dijkstra(graph, directed=False, indices=0, unweighted=True, return_predecessors=True)
    crossing = np.flatnonzero((parent[one] != two) & (parent[two] != one))
    crossing = crossing[np.argsort(-(depth[one] + depth[two])[crossing], kind="stable")]
    low, high = np.sort(surface.edge_faces[crossing] % n_cells, axis=1).T  # -1, the outside, is the last cell
    first = np.unique(low * n_cells + high, return_index=True)[1]
    dual = csr_array((first + 1.0, (low[first], high[first])), shape=(n_cells, n_cells))
    cotree = minimum_spanning_tree(dual).data.astype(np.int64) - 1
    return surface.edges[np.sort(np.delete(crossing, cotree))]
