"""Even triangle meshes of a star-shaped initial surface with the medial wall left out."""

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from .compiled import compiled
from .template import (
    CENTRE,
    WALL_AXES,
    WALL_CENTRE,
    area_vectors,
    fibonacci_sphere,
    unit,
    wall_curve,
    wall_level,
)


def even_points(position, count, rng, iterations=14, samples_per_point=9):
    """Directions (count, 3) outside the wall, its rim first, spread evenly over position(u).

    Centroidal Voronoi points by Lloyd's iteration over weighted samples; rim points stay on the
    wall's curve. Returns (directions, number of rim points).
    """
    rim = wall_curve(2000)
    rim_length = np.linalg.norm(np.diff(position(rim), axis=0), axis=1).sum()
    samples, area = _even_samples(position, samples_per_point * count, rng)
    rim = wall_curve(round(rim_length / np.sqrt(area / count * 2 / np.sqrt(3))))
    where, rim_position = position(samples), position(rim)
    inner = count - len(rim)
    points = where[((np.arange(inner) + rng.random(inner)) / inner * len(where)).astype(int)]
    for _ in range(iterations):
        _, nearest = cKDTree(np.vstack([rim_position, points])).query(where)
        nearest = nearest[nearest >= len(rim)] - len(rim), nearest >= len(rim)
        weight = np.bincount(nearest[0], minlength=inner)
        sums = [np.bincount(nearest[0], where[nearest[1], k], inner) for k in range(3)]
        points = position(unit(np.column_stack(sums) / np.maximum(weight, 1)[:, None] - CENTRE))
        # A point without samples, such as one of two that fell together, starts again elsewhere.
        empty = np.flatnonzero(weight == 0)
        points[empty] = where[rng.integers(len(where), size=len(empty))]
    return np.vstack([rim, _clear_of_wall(unit(points - CENTRE), len(rim))]), len(rim)


def _clear_of_wall(directions, rim_count):
    """Directions (k, 3), moved out of the wall and half an edge away from its rim.

    Then the rim's own edges belong to the Delaunay mesh: its circles over them are empty.
    """
    least = 1 + np.pi / rim_count * WALL_AXES.mean() / WALL_AXES.min()
    level = wall_level(directions)
    near = level < least
    depth = -directions[near, :1]
    plane = CENTRE[1:] + directions[near, 1:] * CENTRE[0] / depth
    plane = WALL_CENTRE + (plane - WALL_CENTRE) * (least / level[near])[:, None]
    directions[near] = unit(np.column_stack([np.zeros(near.sum()), plane]) - CENTRE)
    return directions


def _even_samples(position, count, rng):
    """Random directions (about count, 3) outside the wall, even on the surface, and its area."""
    u = fibonacci_sphere(2 * count)
    u = u[wall_level(u) > 1]
    area = np.cumsum(np.linalg.norm(area_vectors(position, u), axis=1))
    picks = u[np.searchsorted(area, (np.arange(count) + rng.random(count)) / count * area[-1])]
    picks = unit(picks + rng.normal(scale=np.sqrt(4 * np.pi / (2 * count)), size=picks.shape))
    return picks[wall_level(picks) > 1], area[-1] * 2 * np.pi / count


def triangulate(rim_count, vertices, template):
    """Faces (F, 3), outward, of a nearly Delaunay mesh without faces that span the wall.

    Starts from the spherical Delaunay mesh of the template, which is one-to-one; an edge is flipped
    where the angles opposite it sum to more than pi, unless a triangle would turn over on the
    template.
    """
    faces = ConvexHull(template).simplices.astype(np.int64)
    turned = np.linalg.det(template[faces]) < 0
    faces[turned] = faces[turned][:, ::-1]
    spans = (faces < rim_count).all(1) & (wall_level(unit(template[faces].mean(1))) < 1)
    faces = np.ascontiguousarray(faces[~spans])
    for _ in range(40):
        if _flip_pass(faces, vertices, template, *interior_edges(faces)) == 0:
            break
    return faces


def interior_edges(faces):
    """Pairs of faces and of corners: face a's corner i and b's corner j face a shared edge."""
    edge = np.sort(np.concatenate([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]]), axis=1)
    key = edge[:, 0] * (faces.max() + 1) + edge[:, 1]
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    first, second, count = order[same], order[same + 1], len(faces)
    return first % count, first // count, second % count, second // count


@compiled
def _cosine(p, q, r):
    a, b = q - p, r - p
    return (a @ b) / np.sqrt((a @ a) * (b @ b))


@compiled
def _volume(p, q, r):
    return (
        p[0] * (q[1] * r[2] - q[2] * r[1])
        + p[1] * (q[2] * r[0] - q[0] * r[2])
        + p[2] * (q[0] * r[1] - q[1] * r[0])
    )


@compiled
def _flip_pass(faces, x, u, face_a, corner_a, face_b, corner_b):
    """One pass of Lawson flips over edges of untouched faces; the number of flips."""
    touched = np.zeros(len(faces), np.bool_)
    degree = np.zeros(len(x), np.int64)
    for f in range(len(faces)):
        for k in range(3):
            degree[faces[f, k]] += 1
    flips = 0
    for e in range(len(face_a)):
        f, g = face_a[e], face_b[e]
        if touched[f] or touched[g]:
            continue
        p, q = faces[f, corner_a[e]], faces[g, corner_b[e]]
        a, b = faces[f, (corner_a[e] + 1) % 3], faces[f, (corner_a[e] + 2) % 3]
        if degree[a] <= 4 or degree[b] <= 4:
            continue
        alpha, beta = _cosine(x[p], x[a], x[b]), _cosine(x[q], x[a], x[b])
        if np.arccos(alpha) + np.arccos(beta) <= np.pi + 1e-6:
            continue
        if _volume(u[p], u[a], u[q]) <= 0 or _volume(u[p], u[q], u[b]) <= 0:
            continue
        faces[f, 0], faces[f, 1], faces[f, 2] = p, a, q
        faces[g, 0], faces[g, 1], faces[g, 2] = p, q, b
        degree[a] -= 1
        degree[b] -= 1
        degree[p] += 1
        degree[q] += 1
        touched[f] = touched[g] = True
        flips += 1
    return flips
