"""The dense map between two hemispheres that the common template defines."""

import numpy as np
from scipy.spatial import cKDTree

from qclearn.plane.linear import interpolate
from qclearn.surfaces.curvature import sulcal_depth

from .cortex import require_one_generation

CANDIDATES = (6, 40)


def correspondence(a, b):
    """Points (V_a, 3) on b's surface, in mm, that correspond to a's vertices.

    Total: one wall bounds every template, and a rim point between the chords of b's rim goes to the
    nearest face. The map commutes with the sides: homologous points of a left and a right
    hemisphere correspond. CortexError for subjects of two generations.
    """
    require_one_generation([a, b])
    places = locate_on_sphere(b.template, b.surface.faces, a.template)
    return interpolate(b.surface.vertices, b.surface.faces, places)


def depth_correlation(a, b):
    """Correlation over a's vertices of their sulcal depth with that of their true partners on b.

    Near 1, folds correspond, and a method that puts folds on folds is right; else the truth lies
    beside the folds. CortexError for subjects of two generations.
    """
    require_one_generation([a, b])
    places = locate_on_sphere(b.template, b.surface.faces, a.template)
    there = interpolate(sulcal_depth(b.surface), b.surface.faces, places)
    return float(np.corrcoef(sulcal_depth(a.surface), there)[0, 1])


def locate_on_sphere(template, faces, points):
    """Face (P,) and barycentric coordinates (P, 3) of directions on a mesh of the sphere."""
    tree = cKDTree(template[faces].mean(1))
    face, barycentric = np.zeros(len(points), np.int64), np.full((len(points), 3), -np.inf)
    open_points = np.arange(len(points))
    for count in CANDIDATES:
        _, near = tree.query(points[open_points], k=min(count, len(faces)))
        near = near.reshape(len(open_points), -1)
        weights = _central_coordinates(template[faces[near]], points[open_points, None])
        choice = weights.min(axis=2).argmax(axis=1)
        rows = np.arange(len(open_points))
        face[open_points], barycentric[open_points] = near[rows, choice], weights[rows, choice]
        open_points = open_points[barycentric[open_points].min(axis=1) < -1e-9]
        if not len(open_points):
            break
    barycentric = np.maximum(barycentric, 0)
    return face, barycentric / barycentric.sum(axis=1, keepdims=True)


def _central_coordinates(corners, points):
    """Barycentric coordinates (..., 3) of rays from the origin in the triangles' planes."""
    a, b, c = np.moveaxis(corners, -2, 0)
    weights = np.stack(
        [
            np.einsum("...k,...k->...", np.broadcast_to(points, a.shape), np.cross(p, q))
            for p, q in ((b, c), (c, a), (a, b))
        ],
        axis=-1,
    )
    return weights / weights.sum(axis=-1, keepdims=True)
