"""Surfaces that tests share: small meshes, and surfaces with known curvature and depth."""

from functools import cache

import numpy as np
import pyvista

from qclearn.plane.grids import polar_disk
from qclearn.surfaces.surface import Surface


def icosphere(level, keep_above=-1.1):
    """Unit sphere of 10 * 4^level + 2 vertices, open below the height `keep_above`."""
    mesh = pyvista.Icosphere(nsub=level)
    vertices = np.asarray(mesh.points, float)  # single precision in the mesh
    vertices /= np.linalg.norm(vertices, axis=1, keepdims=True)
    faces = mesh.regular_faces[(vertices[mesh.regular_faces, 2] > keep_above).all(1)]
    used, faces = np.unique(faces, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3))


def latitude(longitude):
    """Where the groove runs on the unit sphere, radians."""
    return 0.45 + 0.25 * np.sin(3 * longitude)


def longitudes(points):
    return np.arctan2(points[:, 1], points[:, 0])


def distance_to_floor(points):
    """How far in latitude points (k, 3) of the grooved sphere lie from the middle of its groove, radians."""
    return abs(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])) - latitude(longitudes(points)))


def grooved_sphere():
    """A sphere of 2045 vertices, open below, with a winding groove 0.2 deep; and two vertices on the groove's floor."""
    ball = icosphere(4, -0.6)
    along, away = longitudes(ball.vertices), distance_to_floor(ball.vertices)
    depth = 0.2 * np.exp(-((away / 0.12) ** 2)) * (abs(along) < 1.6)
    ends = [int(np.argmin((along - at) ** 2 + away**2)) for at in (-1.3, 1.3)]
    return Surface(ball.vertices * (1 - depth)[:, None], ball.faces), ends


def sheet(n=61, width=1.0, height=None):
    """The graph of height(x, y), or 0, over [0, width]^2 in n x n vertices, faces looking up; and x, y (V,)."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, width, n)] * 2))
    z = 0 * x if height is None else height(x, y)
    return Surface(np.stack([x, y, z], 1), grid_faces(n, n)), x, y


def grid_faces(rows, columns):
    """Faces of a grid numbered row by row, counter-clockwise where x grows with the column and y with the row."""
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    above = a + columns
    return np.concatenate([np.stack([a, a + 1, above + 1], 1), np.stack([a, above + 1, above], 1)])


def revolution(profile, nt=96):
    """A body around the z axis, open at its last ring: profile (K,), distance + i height, from a pole down outside."""
    _, faces = polar_disk(len(profile) - 1, nt)
    ring = profile.real[1:, None] * np.exp(2j * np.pi * np.arange(nt) / nt)
    height = np.broadcast_to(profile.imag[1:, None], ring.shape)
    points = np.stack([ring.real, ring.imag, height], -1).reshape(-1, 3)
    return Surface(np.concatenate([[[0, 0, profile[0].imag]], points]), faces)


def torus(large, n=120, m=60):
    """Torus of radii `large` and 1, outward; its principal curvatures are 1 and the second result (V,)."""
    u, v = (np.linspace(0, 2 * np.pi, k, endpoint=False) for k in (n, m))
    u, v = (axis.ravel() for axis in np.meshgrid(u, v))
    distance = large + np.cos(v)
    index = np.pad(np.arange(n * m).reshape(m, n), (0, 1), mode="wrap").ravel()
    points = np.stack([distance * np.cos(u), distance * np.sin(u), np.sin(v)], 1)
    return Surface(points, index[grid_faces(m + 1, n + 1)]), np.cos(v) / distance


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


def torus_mesh(n=12, m=9):
    """Vertices and faces of a torus of n x m cells."""
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    vertices = np.stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)], axis=-1).reshape(-1, 3)
    faces = grid(n, m)[1]
    i, j = np.divmod(faces, m + 1)
    return vertices, (i % n) * m + j % m


def with_seam(vertices, faces, side):
    """The mesh whose faces on one side (F,) bool have vertices of their own, the last."""
    seam = np.intersect1d(faces[side], faces[~side])
    new = np.arange(len(vertices))
    new[seam] = len(vertices) + np.arange(len(seam))
    return np.vstack([vertices, vertices[seam]]), np.where(side[:, None], new[faces], faces), seam


@cache
def sphere():
    """642 vertices, unit radius, outward."""
    mesh = pyvista.Icosphere(radius=1, nsub=3).clean()
    return Surface(mesh.points, mesh.regular_faces)
