"""A growing elastic shell: explicit dynamics of springs, bending, limits and self-contact."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from .compiled import compiled
from .template import CENTRE, area_vectors, fibonacci_sphere, unit

GROWN = 0.85  # share of the steps after which the rest lengths grow no more


class Sheet(NamedTuple):
    """The surface before it grows: rest (V, 3), faces (F, 3), and its `neighbour_table`."""

    rest: np.ndarray
    faces: np.ndarray
    start: np.ndarray
    index: np.ndarray

    @property
    def owner(self):
        """The vertex (2E,) that each neighbour in `index` is one of."""
        return np.repeat(np.arange(len(self.rest)), np.diff(self.start))

    def lengths(self, x):
        """Lengths (2E,) of the edges between each vertex and its neighbours at positions (V, 3)."""
        return np.linalg.norm(x[self.owner] - x[self.index], axis=1)


def neighbour_table(faces, count):
    """Neighbours in compressed rows: start (V + 1,), index (2E,)."""
    edge = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edge = np.unique(edge, axis=0)
    both = np.concatenate([edge, edge[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=count))])
    return start.astype(np.int64), np.ascontiguousarray(both[:, 1])


def hull_distance(radius, spacing=0.03, samples=40_000):
    """Signed distance to the hull, positive inside: (field (a, b, c), low corner (3,), spacing).

    radius(u) is the hull's distance from CENTRE; it decides the sign far from the hull.
    """
    directions = fibonacci_sphere(samples)

    def position(u):
        return CENTRE + u * radius(u)[:, None]

    points, normals = position(directions), unit(area_vectors(position, directions))
    low = points.min(0) - 3 * spacing
    shape = np.ceil((points.max(0) + 3 * spacing - low) / spacing).astype(int) + 1
    grid = low + spacing * np.stack(
        np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1
    ).reshape(-1, 3)
    # Far from its points a plain tree with large leaves answers three times as fast; the answers
    # are the same.
    far, nearest = cKDTree(points, leafsize=64, compact_nodes=False, balanced_tree=False).query(
        grid
    )
    offset = grid - CENTRE
    reach = np.linalg.norm(offset, axis=1) + 1e-12
    sign = np.where(reach < radius(offset / reach[:, None]), 1.0, -1.0)
    level = -np.einsum("ij,ij->i", grid - points[nearest], normals[nearest])
    return np.where(far < 0.05, level, sign * far).reshape(shape), low, spacing


@compiled
def _cells(x, size):
    """Vertices sorted by grid cell: origin, shape, order, and each cell's start in it."""
    low = np.array([x[:, 0].min(), x[:, 1].min(), x[:, 2].min()])
    high = np.array([x[:, 0].max(), x[:, 1].max(), x[:, 2].max()])
    shape = ((high - low) / size).astype(np.int64) + 1
    cell = np.empty(len(x), np.int64)
    start = np.zeros(shape[0] * shape[1] * shape[2] + 1, np.int64)
    for i in range(len(x)):
        a = int((x[i, 0] - low[0]) / size)
        b = int((x[i, 1] - low[1]) / size)
        c = int((x[i, 2] - low[2]) / size)
        cell[i] = (a * shape[1] + b) * shape[2] + c
        start[cell[i] + 1] += 1
    for k in range(len(start) - 1):
        start[k + 1] += start[k]
    fill, order = start.copy(), np.empty(len(x), np.int64)
    for i in range(len(x)):
        order[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return low, shape, order, start


@compiled
def _close_pairs(x, rest, reach, apart):
    """Pairs (P, 2) closer than `reach` now that lay farther apart than `apart` in the rest surface."""
    low, shape, order, start = _cells(x, reach)
    pairs = np.empty((64 * len(x), 2), np.int64)
    count = 0
    for i in range(len(x)):
        a = int((x[i, 0] - low[0]) / reach)
        b = int((x[i, 1] - low[1]) / reach)
        c = int((x[i, 2] - low[2]) / reach)
        for p in range(max(a - 1, 0), min(a + 2, shape[0])):
            for q in range(max(b - 1, 0), min(b + 2, shape[1])):
                row = (p * shape[1] + q) * shape[2]
                for k in range(start[row + max(c - 1, 0)], start[row + min(c + 2, shape[2])]):
                    j = order[k]
                    if j <= i:
                        continue
                    d = (
                        (x[i, 0] - x[j, 0]) ** 2
                        + (x[i, 1] - x[j, 1]) ** 2
                        + (x[i, 2] - x[j, 2]) ** 2
                    )
                    if d >= reach * reach or count >= len(pairs):
                        continue
                    d = (
                        (rest[i, 0] - rest[j, 0]) ** 2
                        + (rest[i, 1] - rest[j, 1]) ** 2
                        + (rest[i, 2] - rest[j, 2]) ** 2
                    )
                    if d > apart * apart:
                        pairs[count, 0], pairs[count, 1] = i, j
                        count += 1
    return pairs[:count]


@compiled
def _depth_at(point, field, low, spacing, out):
    """The signed distance at a point and its gradient, trilinear, written to out (4,)."""
    cell, part = np.empty(3, np.int64), np.empty(3)
    for k in range(3):
        scaled = (point[k] - low[k]) / spacing
        cell[k] = min(max(int(scaled), 0), field.shape[k] - 2)
        part[k] = min(max(scaled - cell[k], 0.0), 1.0)
    out[:] = 0
    for a in range(2):
        wa, da = (part[0], 1.0) if a else (1 - part[0], -1.0)
        for b in range(2):
            wb, db = (part[1], 1.0) if b else (1 - part[1], -1.0)
            for c in range(2):
                wc, dc = (part[2], 1.0) if c else (1 - part[2], -1.0)
                value = field[cell[0] + a, cell[1] + b, cell[2] + c]
                out[0] += wa * wb * wc * value
                out[1] += da * wb * wc * value / spacing
                out[2] += wa * db * wc * value / spacing
                out[3] += wa * wb * dc * value / spacing


@compiled
def _elastic(x, start, index, rest_length, growth, progress, bending, laplacian, force):
    """Adds edge springs and the umbrella bi-Laplacian to `force`; `laplacian` is work space."""
    for i in range(len(x)):
        sx = sy = sz = 0.0
        for k in range(start[i], start[i + 1]):
            j = index[k]
            dx, dy, dz = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
            sx += dx
            sy += dy
            sz += dz
            length = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
            pull = 1 - rest_length[k] * (1 + (growth[k] - 1) * progress) / length
            force[i, 0] += pull * dx
            force[i, 1] += pull * dy
            force[i, 2] += pull * dz
        degree = start[i + 1] - start[i]
        laplacian[i, 0], laplacian[i, 1], laplacian[i, 2] = sx / degree, sy / degree, sz / degree
    for i in range(len(x)):
        sx = sy = sz = 0.0
        for k in range(start[i], start[i + 1]):
            j = index[k]
            sx += laplacian[j, 0]
            sy += laplacian[j, 1]
            sz += laplacian[j, 2]
        degree = start[i + 1] - start[i]
        force[i, 0] -= bending * (sx / degree - laplacian[i, 0])
        force[i, 1] -= bending * (sy / degree - laplacian[i, 1])
        force[i, 2] -= bending * (sz / degree - laplacian[i, 2])


@compiled
def _contact(x, pairs, distance, stiffness, force):
    for k in range(len(pairs)):
        i, j = pairs[k, 0], pairs[k, 1]
        dx, dy, dz = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
        length = np.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
        if length < distance:
            push = stiffness * (distance - length) / length
            force[i, 0] += push * dx
            force[i, 1] += push * dy
            force[i, 2] += push * dz
            force[j, 0] -= push * dx
            force[j, 1] -= push * dy
            force[j, 2] -= push * dz


@compiled
def depth_below(x, field, low, spacing):
    """Distance (V,) of points below the hull, from the field of `hull_distance`."""
    depth, value = np.empty(len(x)), np.empty(4)
    for i in range(len(x)):
        _depth_at(x[i], field, low, spacing, value)
        depth[i] = value[0]
    return depth


@compiled
def grow(
    x,
    rest,
    normal,
    start,
    index,
    rest_length,
    held,
    growth,
    anchor,
    pull,
    hold,
    field,
    low,
    spacing,
    settings,
    record,
):
    """Positions (V, 3) of the folded shell, from `x` near the rest surface `rest`.

    settings: steps, time step, damping, bending, saturation, outer, depth, contact distance,
    contact stiffness, refresh interval, final factor of the bending, stiffness of hull and floor,
    share of the pull that stays. growth (2E,) final stretch of each edge, anchor (V,) foundation
    stiffness, pull (V,) inward force, hold (V,) another one, which stays; field: signed distance to
    the hull (positive inside) on a grid from corner `low` with `spacing`; record: clock (2,) int64,
    steps done and in all, for whoever watches from another thread, and film (K, V, 3), which
    becomes K positions on the way, evenly spaced from the first one on.
    """
    clock, film = record
    (
        steps,
        dt,
        damping,
        bending,
        saturation,
        outer,
        depth,
        touch,
        stiffness,
        refresh,
        settle,
        wall,
        keep,
    ) = settings
    steps, refresh = int(steps), int(refresh)
    velocity, force, laplacian = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    hull, where = np.zeros((len(x), 4)), x.copy()
    pairs = np.empty((0, 2), np.int64)
    clock[1] = steps
    for step in range(steps):
        clock[0] = step
        for k in range(len(film)):
            if step == k * steps // len(film):
                film[k] = x
        progress = min(1.0, step / (GROWN * steps))
        distance = touch * (1 + (growth.mean() - 1) * progress)
        if step % refresh == 0:
            pairs = _close_pairs(x, rest, 1.25 * distance, 1.25 * touch)
            where[:] = x
            for i in range(len(x)):
                _depth_at(x[i], field, low, spacing, hull[i])
        rise = min(1.0, progress / 0.3)
        pulling = rise * max(keep, min(1.0, (0.85 - progress) / 0.35))
        stiff = bending * (1 + (settle - 1) * max(0.0, step / steps - 0.85) / 0.15)
        force[:] = 0
        _elastic(x, start, index, rest_length, growth, progress, stiff, laplacian, force)
        _contact(x, pairs, distance, stiffness, force)
        for i in range(len(x)):
            if held[i]:
                continue
            d = rest[i] - x[i]
            length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) + 1e-12
            spring = anchor[i] * min(1.0, saturation / length)
            inside = hull[i, 0]
            for k in range(3):
                inside += hull[i, 1 + k] * (x[i, k] - where[i, k])
            limit = max(0.0, -outer - inside) - max(0.0, inside - depth)
            for k in range(3):
                inward = (pulling * pull[i] + rise * hold[i]) * normal[i, k]
                total = force[i, k] + spring * d[k] - inward + wall * limit * hull[i, 1 + k]
                velocity[i, k] = (1 - damping) * (velocity[i, k] + dt * total)
                x[i, k] += dt * velocity[i, k]
    return x
