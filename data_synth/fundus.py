"""Vertex paths along the fundi of the folded surface near given courses."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

CORRIDOR = 0.11


def concavity(x, normal, start, index):
    """Smoothed umbrella curvature (V,) times the edge length: positive in sulci, negative on crowns."""
    count = len(x)
    owner = np.repeat(np.arange(count), np.diff(start))
    degree = np.diff(start)
    value = np.bincount(owner, np.einsum("ij,ij->i", x[index] - x[owner], normal[owner]), count) / degree
    for _ in range(2):
        value = 0.5 * value + 0.5 * np.bincount(owner, value[index], count) / degree
    return value / np.linalg.norm(x[owner] - x[index], axis=1).mean()


def valley_path(x, start, index, valley, distance, ends, spacing):
    """Vertices (k,) of the cheapest path between two regions, an edge costing its length over how good a valley it is.

    valley (V,) in 0..1, 1 = fundus; distance (V,) from the course in the rest surface, whose edges are about
    `spacing` long; ends: two arrays of candidate vertices, of which the best valley is taken.
    """
    first, last = (candidates[np.argmax(valley[candidates])] for candidates in ends)
    owner = np.repeat(np.arange(len(x)), np.diff(start))
    length = np.linalg.norm(x[owner] - x[index], axis=1)
    node = (1.02 - valley) ** 2 * (1 + (distance / (0.5 * CORRIDOR)) ** 2) + 0.02
    # Three edges wide at least, so that coarse meshes keep a connected corridor.
    width = max(CORRIDOR, 3 * spacing)
    keep = (distance[owner] < width) & (distance[index] < width)
    weight = (length * (node[owner] + node[index]))[keep]
    graph = coo_matrix((weight, (owner[keep], index[keep])), shape=(len(x), len(x))).tocsr()
    _, previous = dijkstra(graph, indices=first, return_predecessors=True)
    path = [last]
    while path[-1] != first:
        path.append(previous[path[-1]])
    return np.array(path[::-1], dtype=np.int64)


def trace(x, sheet, normal, depth, course, end_radius=0.045):
    """Fundus path (k,) that follows a course (m, 3) of points on the rest surface; depth (V,) below the hull.

    x, normal (V, 3): the folded surface; sheet: the same one at rest, a `growth.Sheet`.
    """
    rest, _, start, index = sheet
    distance, _ = cKDTree(course).query(rest)
    curve = concavity(x, normal, start, index)
    spread = np.percentile(depth, 95)
    valley = np.clip(0.5 + 3 * curve, 0, 1) * np.clip(0.15 + depth / spread, 0, 1)
    tree = cKDTree(rest)
    ends = []
    for end in (course[0], course[-1]):
        candidates = np.array(tree.query_ball_point(end, end_radius))
        ends.append(candidates if len(candidates) else np.array([tree.query(end)[1]]))
    owner = np.repeat(np.arange(len(x)), np.diff(start))
    spacing = np.linalg.norm(rest[owner] - rest[index], axis=1).mean()
    return valley_path(x, start, index, valley, distance, ends, spacing)


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
