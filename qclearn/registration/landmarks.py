"""Landmark curves on a surface: sampling by arc length, and sulci found between two endpoints without a network."""

import numpy as np
import scipy
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Surface
from .problem import LandmarkError

POINTS_PER_CURVE = 10
SAMPLES = 400  # on a curve whose distance to another is measured
CURVATURE_WEIGHT, DEPTH_WEIGHT = 0.5, 2.0  # exponents of the fundus metric


def sample_curve(
    surface: Surface, path: Integer[ndarray, " k"], count: int = 10
) -> Float[sparse.csr_array, " count V"]:
    """Sparse (count, V): per-vertex data at points of a vertex path, equally spaced by arc length in space, ends
    included.

    `sample_curve(s, p) @ s.vertices` are the points, `sample_curve(s, p) @ z` their images in the disk (linear along
    each segment). LandmarkError for fewer than two distinct points or vertices out of range.
    """
    path = check_path(surface, path)
    return resample(surface, sparse.eye_array(len(surface.vertices), format="csr")[path], count)


def curves_of_both(moving, control):
    """The curves that both surfaces carry under one name, as entries of a landmarks file, not to be detected."""
    return [
        {"name": name, "moving": path.tolist(), "control": control.curves[name].tolist(), "detect": False}
        for name, path in moving.curves.items()
        if name in control.curves
    ]


def resample(surface, corners, count=10):
    """Equally spaced points by arc length in space on the polyline through `corners @ vertices`: sparse (count, V)."""
    lengths = np.linalg.norm(np.diff(corners @ surface.vertices, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if not along[-1] > 0:
        raise LandmarkError("a curve has no length: its points coincide; give its endpoints apart")
    wanted = np.linspace(0, along[-1], count)
    segment = np.clip(np.searchsorted(along, wanted, side="right") - 1, 0, len(lengths) - 1)
    share = sparse.diags_array(np.clip((wanted - along[segment]) / lengths[segment], 0, 1))  # rounding, at the end
    return (corners[segment] + share @ (corners[segment + 1] - corners[segment])).tocsr()


def check_path(surface, path):
    """A vertex path as integers, or LandmarkError."""
    try:
        path = np.asarray(path)
    except ValueError:
        raise LandmarkError("a curve must be a list of vertex indices; got lists of unequal lengths") from None
    if path.ndim != 1 or len(path) < 2 or not np.issubdtype(path.dtype, np.integer):
        found = f"{path.dtype} of the shape {path.shape}"
        raise LandmarkError(f"a curve must be a list of at least two vertex indices; got {found}")
    outside = path[(path < 0) | (path >= len(surface.vertices))]
    if len(outside):
        found = f"curve vertices out of range 0..{len(surface.vertices) - 1}: {outside[:5].tolist()}"
        raise LandmarkError(f"{found}; were the indices taken from another mesh (before it was cut open, say)?")
    repeated = np.flatnonzero(path[1:] == path[:-1])
    if len(repeated):
        raise LandmarkError(f"a curve repeats vertex {path[repeated[0]]} at position {repeated[0]}; drop the repeat")
    return path


def fundus_metric(surface: Surface) -> Float[ndarray, " E"]:
    """Length of every edge of `surface.edges` in a metric that is short along the floor of sulci.

    An edge's length in space times the mean over its ends of `exp(H/(2 s) - 2 d/m)`, with H the mean curvature (limited
    to two of its standard deviations s) and d the sulcal depth (limited to 1.5 times m, its 95th percentile).
    """
    return weigh_edges(surface, fundus_cost(surface, mean_curvature(surface)))


def fundus_cost(surface, H, curvature_weight=CURVATURE_WEIGHT, depth_weight=DEPTH_WEIGHT):
    """What a unit of length costs at each vertex (V,): the exponential in `fundus_metric`."""
    depth = sulcal_depth(surface)
    H = np.clip(H / (H.std() or 1.0), -2, 2)
    deep = np.percentile(depth, 95) or depth.max() or 1.0  # a surface without folds has no depth
    return np.exp(curvature_weight * H - depth_weight * np.minimum(depth / deep, 1.5))


def weigh_edges(surface, cost):
    """Length in space of every edge (E,) of `surface.edges` times the mean cost (V,) over its ends."""
    first, second = surface.edges.T
    length = np.linalg.norm(surface.vertices[first] - surface.vertices[second], axis=1)
    return length * (cost[first] + cost[second]) / 2


def edge_graph(surface, lengths):
    """The graph of a surface's edges with their lengths (E,): sparse (V, V)."""
    return sparse.csr_array((lengths, tuple(surface.edges.T)), shape=(len(surface.vertices),) * 2)


def fundus_path(
    surface: Surface, start: int, end: int, metric: Float[ndarray, " E"] | None = None
) -> Integer[ndarray, " k"]:
    """Vertex path of a sulcus between two endpoints: the shortest one in `fundus_metric` (computed if not given), or
    LandmarkError where they coincide or are out of range."""
    check_path(surface, np.array([start, end]))
    graph = edge_graph(surface, fundus_metric(surface) if metric is None else metric)
    return walked(dijkstra(graph, directed=False, indices=int(start), return_predecessors=True)[1], end)


def walked(previous, end):
    """The vertices from the start of `dijkstra`'s tree of predecessors (V,) to `end`."""
    path = [int(end)]
    while previous[path[-1]] >= 0:
        path.append(int(previous[path[-1]]))
    return np.array(path[::-1])


def detect_curves(
    surface: Surface, z: Complex[ndarray, " V"], endpoints: Integer[ndarray, " K 2"]
) -> list[Complex[ndarray, " _"]]:
    """The sulci between pairs of endpoints as curves in the disk z: shortest paths in `fundus_metric`, as LD-Net's."""
    metric = fundus_metric(surface)
    return [z[fundus_path(surface, start, end, metric)] for start, end in np.asarray(endpoints)]


def curves_in_space(side, curves, count=SAMPLES):
    """Points (count, 3), equally spaced by arc length, on a `Side`'s surface for each curve (k,) in its disk."""
    fine = [_subdivide(np.asarray(curve, complex), count) for curve in curves]
    points = side.lift(np.concatenate(fine))
    return [_equally_spaced(part, count) for part in np.split(points, np.cumsum([len(part) for part in fine])[:-1])]


def _subdivide(points, count):
    """At least `count` points on the polyline through `points` (k, ...), the corners among them."""
    per_segment = -(-count // (len(points) - 1))
    return np.append(np.linspace(points[:-1], points[1:], per_segment, endpoint=False, axis=1).ravel(), points[-1])


def _equally_spaced(points, count):
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0, along[-1], count)
    return np.stack([np.interp(wanted, along, column) for column in points.T], axis=1)


def curve_distance(one, other):
    """Mean distance in space from the points of either curve (n, 3), (m, 3) to the nearest of the other."""
    trees = scipy.spatial.cKDTree(one), scipy.spatial.cKDTree(other)
    return (trees[0].query(other)[0].mean() + trees[1].query(one)[0].mean()) / 2
