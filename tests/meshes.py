"""Meshes that the tests of the geometric core share, beside those of `qclearn.plane.grids`."""

import numpy as np
from scipy.spatial import Delaunay

from qclearn.plane.beltrami import signed_areas
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.surfaces.surface import Surface


def random_disk(seed, n_boundary=48):
    """Delaunay mesh of a jittered grid in the unit disk: (z, faces); neither 0 nor 1 is a vertex."""
    rng = np.random.default_rng(seed)
    step = 2 * np.pi / n_boundary
    rim = np.exp(1j * step * (np.arange(n_boundary) + 0.5 + 0.3 * rng.uniform(-1, 1, n_boundary)))
    line = np.arange(-1, 1 + step, step)
    grid = (line[:, None] + 1j * line[None, :]).ravel()
    grid = grid + 0.3 * step * (rng.uniform(-1, 1, len(grid)) + 1j * rng.uniform(-1, 1, len(grid)))
    z = np.concatenate([grid[abs(grid) < 1 - 0.6 * step], rim])
    faces = Delaunay(np.stack([z.real, z.imag], 1)).simplices.astype(int)
    clockwise = signed_areas(z, faces) < 0
    faces[clockwise] = faces[clockwise][:, ::-1]
    return z, faces


def boundary_loop(faces):
    """`Disk.loop` (B,) of faces alone."""
    return Disk(np.zeros(faces.max() + 1), faces).loop


def random_mu(rng, z, faces, largest):
    """Smooth random coefficient on the faces with max|mu| = largest, complex (F,)."""
    centre = z[faces].mean(1)
    powers = np.stack([centre**j * centre.conj() ** k for j in range(4) for k in range(4)])
    mu = (rng.normal(size=16) + 1j * rng.normal(size=16)) @ powers
    return largest * mu / abs(mu).max()


def bowl(height, rings=8, lean=0.0, curves=None):
    """A bowl, bottom up, steeper on one side with `lean`; vertices as in `polar_disk(rings, 3 * rings)`."""
    z, faces = polar_disk(rings, 3 * rings)
    rise = height * (1 - abs(z) ** 2) * (1 + lean * z.real)
    return Surface(np.stack([z.real, z.imag, rise], axis=1), faces, curves or {})


def strip(n_long=60, n_wide=3):
    """A triangulated rectangle [0, 1] x [0, 1] as complex numbers, counter-clockwise faces."""
    x, y = np.meshgrid(np.linspace(0, 1, n_long + 1), np.linspace(0, 1, n_wide + 1))
    a = (np.arange(n_wide)[:, None] * (n_long + 1) + np.arange(n_long)).ravel()
    b, c, d = a + 1, a + n_long + 2, a + n_long + 1
    return (x + 1j * y).ravel(), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
