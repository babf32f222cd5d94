"""Removal of the last self-intersections by smoothing small patches."""

import numpy as np

from .intersections import self_intersections

ROUNDS = 8


def untangle(x, faces, start, index, held):
    """Positions (V, 3) without self-intersections where possible: their patches are relaxed.

    A patch is the vertices of the faces at fault and a growing number of rings; umbrella smoothing
    draws what has pierced another bank back to its own side. The rim (`held`) does not move.
    """
    owner = np.repeat(np.arange(len(x)), np.diff(start))
    degree = np.diff(start)
    best, fewest = x, np.inf
    for rings in range(2, 2 + ROUNDS):
        crossing = self_intersections(x, faces)
        if len(crossing) < fewest:
            best, fewest = x, len(crossing)
        if len(crossing) == 0:
            break
        patch = np.zeros(len(x), bool)
        patch[faces[crossing]] = True
        for _ in range(rings):
            patch[index[patch[owner]]] = True
        x = _smooth(x, owner, index, degree, np.flatnonzero(patch & ~held), 4 * rings)
    return best


def _smooth(x, owner, index, degree, moving, steps):
    x = x.copy()
    inside = np.zeros(len(x), bool)
    inside[moving] = True
    rows = inside[owner]
    owner, index = owner[rows], index[rows]
    for _ in range(steps):
        mean = np.stack([np.bincount(owner, x[index, k], len(x)) for k in range(3)], axis=1)[moving]
        x[moving] += 0.3 * (mean / degree[moving, None] - x[moving])
    return x
