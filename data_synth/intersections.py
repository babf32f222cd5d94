"""Where a triangle mesh passes through itself."""

import numpy as np


def self_intersections(vertices, faces):
    """Indices (k,) of the faces that another face pierces or touches off common vertices.

    Two triangles meet exactly where an edge of one meets the other, so that every edge is tried
    against the faces near it that it shares no vertex with (the test of Moeller and Trumbore 1997).
    Double precision, not exact arithmetic: contact within rounding may go either way, and
    triangles folded flat onto each other escape.
    """
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    halfedges = np.sort(
        np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1
    )
    edges, edge_of_halfedge = np.unique(halfedges, axis=0, return_inverse=True)
    edge, face = _box_pairs(vertices[edges], vertices[faces])
    apart = (edges[edge][:, :, None] != faces[face][:, None, :]).all(axis=(1, 2))
    edge, face = edge[apart], face[apart]
    pierced = _pierces(
        *np.moveaxis(vertices[edges[edge]], 1, 0), *np.moveaxis(vertices[faces[face]], 1, 0)
    )
    edge_hit = np.isin(edge_of_halfedge.reshape(-1, 3), edge[pierced]).any(axis=1)
    return np.union1d(np.flatnonzero(edge_hit), face[pierced])


def _pierces(start, end, a, b, c):
    """Whether the segments start-end (P, 3) meet the triangles a, b, c; parallel ones do not."""
    ray, u, v, offset = end - start, b - a, c - a, start - a
    normal = np.cross(u, v)
    across = -np.einsum("pk,pk->p", ray, normal)
    turned = np.cross(offset, ray)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("pk,pk->p", offset, normal) / across
        beta = np.einsum("pk,pk->p", v, turned) / across
        gamma = -np.einsum("pk,pk->p", u, turned) / across
        return (t >= 0) & (t <= 1) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)


def _box_pairs(first, second):
    """All pairs (i, j) of point sets (n, k, 3), (m, l, 3) whose bounding boxes meet."""
    boxes = [(points.min(axis=1), points.max(axis=1)) for points in (first, second)]
    cell = np.mean(boxes[1][1] - boxes[1][0])
    (box_a, key_a), (box_b, key_b) = (
        _cells(low, high, boxes[1][0].min(axis=0) - cell, cell) for low, high in boxes
    )
    order = np.argsort(key_b, kind="stable")
    begin, end = (np.searchsorted(key_b[order], key_a, side) for side in ("left", "right"))
    count = end - begin
    i = np.repeat(box_a, count)
    j = box_b[order[np.repeat(begin - np.cumsum(count) + count, count) + np.arange(count.sum())]]
    (low_a, high_a), (low_b, high_b) = boxes
    meet = ((low_a[i] <= high_b[j]) & (low_b[j] <= high_a[i])).all(axis=1)
    pairs = np.unique(i[meet] * len(second) + j[meet])
    return np.divmod(pairs, len(second))


def _cells(low, high, origin, cell):
    """The grid cells that each box meets: (box index, cell key), one entry a meeting."""
    first, last = (np.floor((corner - origin) / cell).astype(np.int64) for corner in (low, high))
    extent = last - first + 1
    count = extent.prod(axis=1)
    box = np.repeat(np.arange(len(low)), count)
    rank = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    z = rank % extent[box, 2]
    y = rank // extent[box, 2] % extent[box, 1]
    x = rank // (extent[box, 2] * extent[box, 1])
    index = first[box] + np.stack([x, y, z], axis=1)
    return box, (index[:, 0] << 42) + (index[:, 1] << 21) + index[:, 2]
