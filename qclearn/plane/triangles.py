"""Triangles by their corners, in the plane or in space: lengths, angles, and the stiffness of a surface."""

import numpy as np
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy import sparse

from .linear import assemble


def edge_lengths(corners):
    """Length of the edge opposite each corner, (F, 3), of corners in the plane, (F, 3) complex, or space, (F, 3, 3)."""
    side = np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)
    return abs(side) if np.iscomplexobj(side) else np.linalg.norm(side, axis=2)


def middles(m):
    """Barycentric coordinates (m^2, 3) of the centroids of the m^2 equal parts of a triangle."""
    i, j = np.array([(i, j) for i in range(m) for j in range(m - i)]).T
    upward = np.stack([i + 1 / 3, j + 1 / 3, m - 2 / 3 - i - j], axis=1)
    i, j = i[i + j < m - 1], j[i + j < m - 1]
    downward = np.stack([i + 2 / 3, j + 2 / 3, m - 4 / 3 - i - j], axis=1)
    return np.concatenate([upward, downward]) / m


def corner_angles(lengths):
    """Interior angles (F, 3) in radians from edge lengths opposite the corners (F, 3)."""
    opposite, left, right = lengths, np.roll(lengths, -1, axis=1), np.roll(lengths, -2, axis=1)
    # Half-angle form: accurate for slivers, where the law of cosines cancels.
    upper, lower = opposite**2 - (left - right) ** 2, (left + right) ** 2 - opposite**2
    return 2 * np.arctan2(np.sqrt(np.maximum(upper, 0)), np.sqrt(np.maximum(lower, 0)))


def cotangent_stiffness(
    vertices: Float[ndarray, " V 3"], faces: Integer[ndarray, " F 3"]
) -> Float[sparse.csc_array, " V V"]:
    """The surface's stiffness matrix, off-diagonal `-(cot a + cot b)/2`: K(mu) of any embedding with coefficient mu."""
    corners = np.asarray(vertices, float)[faces]
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)  # edge k lies opposite corner k
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    blocks = np.einsum("fia,fja->fij", edges, edges) / (4 * area[:, None, None])
    return assemble(np.asarray(faces), blocks, len(vertices))
