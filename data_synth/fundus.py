"""Vertex paths along the fundi of the folded surface near given courses."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree


def concavity(x, normal, start, index):
    """Smoothed umbrella curvature (V,) times the edge length: positive in sulci, negative on
    crowns."""
    count = len(x)
    owner = np.repeat(np.arange(count), np.diff(start))
    degree = np.diff(start)
    value = (
        np.bincount(owner, np.einsum("ij,ij->i", x[index] - x[owner], normal[owner]), count)
        / degree
    )
    for _ in range(2):
        value = 0.5 * value + 0.5 * np.bincount(owner, value[index], count) / degree
    return value / np.linalg.norm(x[owner] - x[index], axis=1).mean()


def valley_path(x, sheet, valley, distance, ends, guidance):
    """Vertices (k,) of the cheapest path: an edge costs its length over the valley's quality.

    valley (V,) in 0..1, 1 = fundus; distance (V,) from the course on the rest surface; guidance:
    `generations.Guidance`, for the corridor around the course.
    """
    first, last = ends
    owner, index, length = sheet.owner, sheet.index, sheet.lengths(x)
    # Added, not only multiplied: in a perfect valley a factor costs nothing, and the path would
    # jump to a neighbour.
    aside = (distance / guidance.aside) ** 2
    node = (1.02 - valley) ** 2 * (1 + aside) + 0.02 + guidance.aside_cost * aside
    # Three edges wide at least, so that coarse meshes keep a connected corridor.
    width = max(guidance.corridor, 3 * sheet.lengths(sheet.rest).mean())
    keep = (distance[owner] < width) & (distance[index] < width)
    weight = (length * (node[owner] + node[index]))[keep]
    graph = coo_matrix((weight, (owner[keep], index[keep])), shape=(len(x), len(x))).tocsr()
    _, previous = dijkstra(graph, indices=first, return_predecessors=True)
    path = [last]
    while path[-1] != first:
        path.append(previous[path[-1]])
    return np.array(path[::-1], dtype=np.int64)


def trace(x, sheet, normal, depth, course, guidance):
    """Fundus path (k,) along a course (m, 3) on the rest surface; depth (V,) below the hull.

    x, normal (V, 3): the folded surface; sheet: the same one at rest, a `growth.Sheet`; guidance:
    how closely.
    """
    distance, _ = cKDTree(course).query(sheet.rest)
    curve = concavity(x, normal, sheet.start, sheet.index)
    spread = np.percentile(depth, 95)
    valley = np.clip(0.5 + 3 * curve, 0, 1) * np.clip(0.15 + depth / spread, 0, 1)
    _, ends = cKDTree(sheet.rest).query(course[[0, -1]])
    return valley_path(x, sheet, valley, distance, ends, guidance)


def trim(x, path, depth, longest):
    """The path (k,) without as much of its shallower ends as makes it longer than `longest`."""
    step = np.linalg.norm(np.diff(x[path], axis=0), axis=1)
    first, last = 0, len(path) - 1
    while step[first:last].sum() > longest:
        if depth[path[first]] < depth[path[last]]:
            first += 1
        else:
            last -= 1
    return path[first : last + 1]
