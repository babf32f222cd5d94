"""Measures of triangles, of planar and of spatial meshes: lengths and angles."""

import numpy as np


def edge_lengths(corners):
    """Length of the edge opposite each corner, (F, 3), of corners in the plane, (F, 3) complex, or space, (F, 3, 3)."""
    side = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)
    return abs(side) if np.iscomplexobj(side) else np.linalg.norm(side, axis=2)


def corner_angles(lengths):
    """Interior angles (F, 3) in radians from edge lengths opposite the corners (F, 3)."""
    opposite, left, right = lengths, np.roll(lengths, -1, axis=1), np.roll(lengths, -2, axis=1)
    # Half-angle form: accurate for slivers, where the law of cosines cancels.
    upper, lower = opposite**2 - (left - right) ** 2, (left + right) ** 2 - opposite**2
    return 2 * np.arctan2(np.sqrt(np.maximum(upper, 0)), np.sqrt(np.maximum(lower, 0)))
