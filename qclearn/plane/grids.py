"""Meshes of the unit disk that no surface has given.

First the radial map between square and disk, and the square, polar and thinned meshes; then
`Spectrum`, the eigenvectors of Laplace's matrix on a polar mesh."""

from functools import lru_cache

import numpy as np
import scipy
from jaxtyping import Complex, Integer
from numpy import ndarray

from .checks import complex_numbers
from .disk import Disk, pairs
from .linear import around_vertices

POWER = 1.4  # by which the rings of the usual polar meshes crowd towards the centre
# Rings and spokes: of the mesh of CP-Net's answers, and of their exact maps.
COARSE, FINE = (24, 72), (32, 96)


def square_to_disk(w: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Radial map of the square [-1, 1]^2 onto the unit disk, `w max(|cos t|, |sin t|)`, t = arg w;
    0 to 0."""
    w = complex_numbers(w, "w")
    return w * _radius_ratio(w)


def disk_to_square(z: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Inverse of `square_to_disk`: `z / max(|cos t|, |sin t|)` (the paper's formula with its
    absolute values)."""
    z = complex_numbers(z, "z")
    return z / _radius_ratio(z)


def _radius_ratio(w):
    size = abs(w)
    largest = np.maximum(abs(w.real), abs(w.imag))
    return np.divide(largest, size, out=np.ones_like(size), where=size > 0)


def square_disk(n: int) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Disk mesh (z, faces) with the topology of an n x n square grid, n even.

    The diagonal of a cell runs into the square's corner of its quadrant; the other would put a
    triangle with three boundary vertices at each corner, which carries no boundary flux.
    """
    if n < 2 or n % 2:
        raise ValueError(f"square_disk needs an even number of cells a side, at least 2; got {n}")
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    # Counter-clockwise from the lower left.
    a = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    b = a + 1
    c = a + n + 2
    d = a + n + 1
    row, column = np.divmod(np.arange(n * n), n)
    rising = ((row >= n // 2) == (column >= n // 2))[:, None]
    first = np.where(rising, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(rising, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return square_to_disk((x + 1j * y).ravel()), np.concatenate([first, second])


def polar_disk(
    nr: int, nt: int, power: float = 1.0
) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Graded polar disk mesh (z (1 + nr nt,), faces): vertex 0 at 0, then nr rings of nt at radius
    (j / nr)^power.

    The mesh is invariant under rotation by 2 pi / nt. Vertex `1 + (nr - 1) nt` lies at 1.
    """
    if nr < 1 or nt < 3:
        raise ValueError(f"polar_disk needs at least 1 ring and 3 angles; got {nr} and {nt}")
    radius = (np.arange(1, nr + 1) / nr) ** power
    spokes = np.exp(2j * np.pi * np.arange(nt) / nt)
    z = np.concatenate([[0], (radius[:, None] * spokes).ravel()])
    k = np.arange(nt)
    following = (k + 1) % nt
    faces = [np.stack([np.zeros(nt, int), 1 + k, 1 + following], 1)]
    for j in range(nr - 1):
        inner = 1 + j * nt
        outer = 1 + (j + 1) * nt
        faces += [
            np.stack([inner + k, outer + k, outer + following], 1),
            np.stack([inner + k, outer + following, inner + following], 1),
        ]
    return z, np.concatenate(faces)


@lru_cache(maxsize=16)
def polar(rings, spokes=None):
    """The polar `Disk` crowded by POWER, made once; three times as many spokes as rings unless
    given."""
    return Disk(*polar_disk(rings, spokes or 3 * rings, POWER))


def pixel_centres(size):
    """Pixel centres of the image of [-1, 1]^2, complex (size, size): x grows with the column, y
    with the row."""
    axis = (2 * np.arange(size) + 1) / size - 1
    return axis[None, :] + 1j * axis[:, None]


def joined(z: Complex[ndarray, " V"]) -> Disk:
    """The `Disk` of points z (V,) in Delaunay's triangles."""
    faces = scipy.spatial.Delaunay(pairs(z)).simplices.astype(np.int64)
    return Disk(z, np.where((Disk(z, faces).areas < 0)[:, None], faces[:, ::-1], faces))


def thinned(disk, shares, count):
    """The rim and `count` vertices of a `Disk`, chosen by shares (V,) of 1 (None: equal): numbers
    (N,), `joined`."""
    chosen = np.random.default_rng(0).choice(len(disk.z), count, replace=False, p=shares)
    some = np.union1d(disk.loop, chosen)
    return some, joined(disk.z[some])


class Spectrum:
    """Fields nu on a polar mesh of rings and spokes in all eigenvectors E of (Laplace, lumped mass
    A), `E^* A E = pi`.

    radial (spokes, rings, rings): their radial parts by angular mode; values (spokes rings,): the
    eigenvalues, by angular mode, then radial, as the coefficients; areas (rings spokes,): of the
    lumped mass.
    """

    def __init__(self, rings, spokes):
        self.rings, self.spokes = rings, spokes
        self.mesh = polar(rings, spokes)
        area, along, arcs = ring_tables(self.mesh, spokes)
        self.areas = np.repeat(area, spokes)
        # Each angular mode of the mesh has its own matrix of the rings.
        coupling = np.diag(along, 1) + np.diag(along, -1)
        radial = np.diag(coupling.sum(1)) - coupling
        angular = 2 - 2 * np.cos(2 * np.pi * np.arange(spokes) / spokes)
        root = 1 / np.sqrt(area)
        matrices = root[:, None] * (radial + angular[:, None, None] * np.diag(arcs)) * root
        values, vectors = np.linalg.eigh(matrices)  # (spokes, rings), (spokes, rings, rings)
        self.radial = np.sqrt(np.pi) * root[:, None] * vectors
        self.values = values.ravel().clip(min=0)

    def gradients(self, fields):
        """`E^* fields` (n, modes) of gradients (n, 1 + rings spokes) by nu at the vertices."""
        nodal = fields[:, 1:].reshape(-1, self.rings, self.spokes)
        waves = scipy.fft.fft(nodal, norm="ortho").transpose(2, 0, 1)  # (spokes, n, rings)
        # The centre is the mean of the first ring.
        waves[0, :, 0] += fields[:, 0] / np.sqrt(self.spokes)
        # A real product for both parts: half the work of a complex one.
        parts = np.concatenate([waves.real, waves.imag], 1) @ self.radial.astype(waves.real.dtype)
        modes = np.empty((len(fields), self.spokes, self.rings), waves.dtype)
        modes.real, modes.imag = parts.transpose(1, 0, 2).reshape(2, *modes.shape)
        return modes.reshape(len(fields), -1)

    def coefficients(self, nu):
        """`E^* A nu / pi` of a field (1 + rings spokes,) with the mean of its first ring in the
        centre."""
        return self.gradients(np.concatenate([[0], self.areas * nu[1:]])[None])[0] / np.pi

    def field(self, coefficients):
        """nu at the mesh's vertices (1 + rings spokes,) of coefficients (modes,)."""
        waves = (self.radial @ coefficients.reshape(self.spokes, self.rings, 1))[..., 0]
        nu = np.fft.ifft(waves.T, norm="ortho")
        return np.concatenate([[nu[0].mean()], nu.ravel()])


def ring_tables(mesh, nt):
    """Of the rings of a polar `Disk`: lumped areas (nr,), Laplace's weights along spokes (nr - 1,)
    and rings (nr,)."""
    nr = (len(mesh.z) - 1) // nt
    area = around_vertices(mesh.areas, mesh.faces)[1::nt] / 3
    K = mesh.laplace
    first = np.arange(nr) * nt + 1
    spokes = -np.asarray(K[first[:-1], first[1:]]).ravel()
    return area, spokes, -np.asarray(K[first, first + 1]).ravel()
