"""Checks of a surface: each SurfaceError names the indices of what is wrong, and the remedy."""

import numpy as np
import scipy
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..plane.checks import SurfaceError, counted, read_only, some, unmasked
from ..plane.linear import degenerate_faces

LARGEST = 1e60  # of a coordinate: a squared area, its fourth power, is still a number
ONE_PLACE = 1e-10  # of the boundary's length: points that near to each other lie in one place
LOOSE = 0.01  # of the vertices that a cut leaves may lie apart


def origins(numbers, n_vertices):
    """original_vertices as int64, or None."""
    if numbers is None:
        return None
    numbers = unmasked(numbers, "original_vertices", SurfaceError)
    sound = numbers.shape == (n_vertices,) and np.issubdtype(numbers.dtype, np.integer)
    if not sound or numbers.min() < 0 or (np.diff(np.sort(numbers)) == 0).any():
        raise SurfaceError(
            f"original_vertices must be {n_vertices} whole numbers, none negative and not one "
            f"number twice, and not {numbers.dtype} of shape {numbers.shape}; give the second "
            "result of open_surface, or leave them out"
        )
    return read_only(numbers.astype(np.int64))


def vertex_array(vertices, finite=True):
    """Vertices as read-only float64 (V, 3), if `finite` so and at most LARGEST."""
    if np.iscomplexobj(vertices):
        raise SurfaceError(
            "vertices are complex; give a planar mesh as numpy.stack([z.real, z.imag, 0 * z.real], "
            "1)"
        )
    try:
        given = unmasked(vertices, "vertices", TypeError).dtype
        vertices = np.array(vertices, dtype=np.float64, order="C")
        if given.kind not in "fiu":
            raise TypeError(f"they are of the type {given}")
    except (TypeError, ValueError) as error:
        raise SurfaceError(f"vertices must be an array (V, 3) of real numbers: {error}") from None
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise SurfaceError(
            f"vertices must have the shape (V, 3), not {vertices.shape}; pad planar points with z "
            "= 0"
        )
    if not finite:
        return read_only(vertices)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise SurfaceError(
            f"{counted(bad, 'vertex', 'vertices')} with NaN or infinite coordinates: {some(bad)}. "
            "Cut them away (`qclearn open`, --cortex), or export the surface again"
        )
    far = np.flatnonzero((np.abs(vertices) > LARGEST).any(axis=1))
    if far.size:
        raise SurfaceError(
            f"{counted(far, 'vertex', 'vertices')} with coordinates beyond {LARGEST:g}: "
            f"{some(far)}. Areas and volumes would overflow; give the surface in millimetres, or "
            "export it again if it is damaged"
        )
    return read_only(vertices)


def curve_path(name, path, n_vertices):
    """A curve as read-only int64 (k,), vertices of the surface."""
    path = np.array(unmasked(path, f"curve '{name}'", SurfaceError))
    if path.ndim != 1 or path.size == 0 or path.dtype.kind not in "iu":
        raise SurfaceError(f"curve '{name}' must be a non-empty list of vertex indices (integers)")
    bad = path[(path < 0) | (path >= n_vertices)]
    if bad.size:
        raise SurfaceError(
            f"curve '{name}' names vertices that do not exist: {some(bad)}; indices run from 0 to "
            f"{n_vertices - 1}: take the curve from this very surface"
        )
    return read_only(path.astype(np.int64))


def check_shapes(vertices, faces, torn=False):
    """SurfaceError for degenerate faces and, unless `torn`, for unused vertices."""
    unused = np.flatnonzero(np.bincount(faces.ravel(), minlength=len(vertices)) == 0)
    if unused.size and not torn:
        raise SurfaceError(
            f"{counted(unused, 'vertex', 'vertices')} in no face: {some(unused)}. Drop them: used, "
            "corners = numpy.unique(faces, return_inverse=True); Surface(vertices[used], "
            "corners.reshape(-1, 3), original_vertices=used)"
        )
    degenerate = degenerate_faces(vertices, faces)
    if degenerate.size:
        raise SurfaceError(
            f"{counted(degenerate, 'degenerate face')} (a repeated vertex or zero area): "
            f"{some(degenerate)}. Move a corner of each off the line, or delete those that name a "
            "vertex twice: the numbers stay. They do not matter where a label cuts them away "
            "(`qclearn open`, --cortex)"
        )


def check_topology(vertices, faces, torn=None):
    """Edges (E, 2), their faces (E, 2), boundary half-edges (B, 2) of a manifold, oriented,
    connected mesh without a seam; torn: the vertices (V,) bool that matter of one whose wall is
    torn off, and that has to be connected but for LOOSE ones."""
    n_vertices = len(vertices)
    # Half-edge 3 f + k leaves corner k of face f; those of one edge follow each other in `order`.
    tails = faces.ravel()
    heads = np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(tails, heads) * n_vertices + np.maximum(tails, heads)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(first, append=len(key))
    edges = np.stack(np.divmod(key[order[first]], n_vertices), axis=1)
    one = order[first[count == 2]]
    two = order[first[count == 2] + 1]
    crowded = edges[count > 2]
    wrong = tails[one] == tails[two]
    # A cheap test first: where a face is there twice, one of these holds.
    if len(crowded) or wrong.any() or len(faces) == 2:
        # Twice the same face is the plainer word for it.
        corners = np.sort(faces, axis=1)
        alike = np.lexsort(corners.T)
        same = (corners[alike[1:]] == corners[alike[:-1]]).all(axis=1)
        if same.any():
            pairs = np.sort(np.stack([alike[:-1][same], alike[1:][same]], axis=1), axis=1)
            raise SurfaceError(
                f"duplicate faces: {counted(pairs, 'pair')} with the same vertices: {some(pairs)}. "
                "Keep one of each pair"
            )
    if len(crowded):
        raise SurfaceError(
            f"not manifold: {counted(crowded, 'edge')} (vertex pairs) with more than two faces: "
            f"{some(crowded)}. Delete the extra faces"
        )
    if wrong.any():
        pairs = np.stack([one[wrong] // 3, two[wrong] // 3], axis=1)
        raise SurfaceError(
            f"inconsistent orientation: {counted(pairs, 'pair')} of faces that run along their "
            f"common edge in the same direction: {some(pairs)}. Reverse one face of each pair "
            "(pyvista.PolyData.compute_normals(consistent_normals=True) does it for a whole "
            "orientable surface)"
        )
    single = order[first[count == 1]]
    boundary = np.stack([tails[single], heads[single]], axis=1)
    pairs = doubled(vertices, boundary)
    if len(pairs):
        raise SurfaceError(
            f"points doubled along a seam: {counted(pairs, 'pair')} of vertices in one place: "
            f"{some(pairs)}. Merge them: --merge (library: read_surface(..., merge=True)); the "
            "others keep their numbers, in original_vertices"
        )
    # The vertices that matter hang together.
    _, label = components(n_vertices, edges)
    sizes = np.bincount(label, torn).astype(int)
    if sizes.sum() - sizes.max() > (0 if torn is None else LOOSE * sizes.sum()):
        firsts = np.unique(label, return_index=True)[1]
        parts = [k for k in np.argsort(-sizes) if sizes[k]]
        listed = [f"{sizes[k]} vertices around vertex {firsts[k]}" for k in parts]
        raise SurfaceError(
            f"the surface has {len(parts)} components: {some(listed)}. Give each "
            "hemisphere in a file of its own, and name the vertices of loose pieces in the mask of "
            "`qclearn open`: the others keep their numbers"
        )
    if torn is None:
        _check_fans(n_vertices, faces, one, two)
    edge_faces = np.stack([order[first] // 3, np.full(len(edges), -1)], axis=1)
    edge_faces[count == 2, 1] = two // 3
    return read_only(edges), read_only(edge_faces), boundary


def doubled(vertices, boundary):
    """Pairs (n, 2) of vertices in one place at the ends of boundary half-edges (B, 2) that lie on
    each other, one against the other."""
    boundary = boundary[np.isfinite(vertices[boundary]).all(axis=(1, 2))]
    if not len(boundary):
        return boundary
    ends, corners = np.unique(boundary, return_inverse=True)
    near = ONE_PLACE * np.ptp(vertices[ends], axis=0).max()
    pairs = scipy.spatial.cKDTree(vertices[ends]).query_pairs(near, output_type="ndarray")
    tails, heads = components(len(ends), pairs)[1][corners.reshape(-1, 2)].T
    keys = tails * len(ends) + heads, heads * len(ends) + tails
    _, one, other = np.intersect1d(*keys, return_indices=True)
    pairs = np.stack([boundary[one], boundary[other, ::-1]], axis=-1).reshape(-1, 2)
    return np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]]), axis=0)


def merged_numbers(vertices, faces):
    """The lowest number (V,) of each vertex and those that `doubled` joins with it."""
    half_edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    ends = np.sort(half_edges) @ [len(vertices), 1]
    _, edge, count = np.unique(ends, return_inverse=True, return_counts=True)
    _, label = components(len(vertices), doubled(vertices, half_edges[count[edge] == 1]))
    return np.unique(label, return_index=True)[1][label]


def _check_fans(n_vertices, faces, one, two):
    """SurfaceError unless the faces around each vertex form one fan; one, two: half-edges beside
    the inner edges."""
    # The corner at each half-edge's head.
    after = np.roll(np.arange(faces.size).reshape(-1, 3), -1, axis=1).ravel()
    sides = np.stack([np.r_[one, after[one]], np.r_[after[two], two]], axis=1)
    n_fans, label = components(faces.size, sides)
    if n_fans > n_vertices:
        vertex_of_fan = np.empty(n_fans, dtype=np.int64)
        vertex_of_fan[label] = faces.ravel()
        bad = np.flatnonzero(np.bincount(vertex_of_fan, minlength=n_vertices) > 1)
        raise SurfaceError(
            f"not manifold: {counted(bad, 'vertex', 'vertices')} where several fans of faces meet "
            f"in a point: {some(bad)}. Duplicate the vertex for each fan, the copies last"
        )


def components(size, pairs):
    """How many parts things 0 ... size - 1 have that pairs (n, 2) join, and the part of each
    (size,)."""
    graph = csr_array((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(size, size))
    return connected_components(graph, directed=False)
