"""Surfaces that tests share."""

from functools import cache

import numpy as np
import pyvista

from qclearn.surfaces.surface import Surface


def grid(n, m, hole=()):
    """An n x m grid of unit cells in the plane, counterclockwise; cells named in hole are left out."""
    x, y = np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(float)
    cells = [(i, j) for i in range(n) for j in range(m) if (i, j) not in hole]
    corner = np.array([i * (m + 1) + j for i, j in cells])
    right, up = m + 1, 1
    faces = np.concatenate(
        [
            np.stack([corner, corner + right, corner + right + up], axis=1),
            np.stack([corner, corner + right + up, corner + up], axis=1),
        ]
    )
    return vertices, faces


def torus(n=12, m=9):
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    vertices = np.stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)], axis=-1).reshape(-1, 3)
    faces = grid(n, m)[1]
    i, j = np.divmod(faces, m + 1)
    return vertices, (i % n) * m + j % m


@cache
def sphere():
    """642 vertices, unit radius, outward."""
    mesh = pyvista.Icosphere(radius=1, nsub=3).clean()
    return Surface(mesh.points, mesh.regular_faces)
