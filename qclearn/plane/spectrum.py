"""Fields on a polar mesh in the eigenvectors of its Laplace operator, by the fast Fourier transform along the rings."""

import numpy as np
import scipy

from .grids import polar


class Spectrum:
    """Fields nu on a polar mesh of rings and spokes in all eigenvectors E of (Laplace, lumped mass A), `E^* A E = pi`.

    values (spokes rings,): the eigenvalues, by angular mode, then radial, as the coefficients.
    """

    def __init__(self, rings, spokes):
        self.rings, self.spokes, self.mesh = rings, spokes, polar(rings, spokes)
        area, *weights = ring_tables(self.mesh, spokes)
        self.radial, values, kept = eigenvectors(area, *weights, spokes, rings * spokes)
        self.areas, self.values = np.repeat(area, spokes), np.empty(rings * spokes)
        self.values[kept] = values
        self.cell = np.sqrt(area.mean())

    def gradients(self, fields):
        """`E^* fields` (n, modes) of gradients (n, 1 + rings spokes) by nu at the mesh's vertices."""
        nodal = fields[:, 1:].reshape(-1, self.rings, self.spokes)
        waves = scipy.fft.fft(nodal, norm="ortho").transpose(2, 0, 1)  # (spokes, n, rings)
        waves[0, :, 0] += fields[:, 0] / np.sqrt(self.spokes)  # the centre is the mean of the first ring
        parts = np.concatenate([waves.real, waves.imag], 1) @ self.radial.astype(waves.real.dtype)
        found = np.empty((len(fields), self.spokes, self.rings), waves.dtype)
        found.real, found.imag = parts.transpose(1, 0, 2).reshape(2, *found.shape)
        return found.reshape(len(fields), -1)

    def coefficients(self, nu):
        """`E^* A nu / pi` of a field (1 + rings spokes,) with the mean of its first ring in the centre."""
        return self.gradients(np.concatenate([[0], self.areas * nu[1:]])[None])[0] / np.pi

    def field(self, coefficients):
        """nu at the mesh's vertices (1 + rings spokes,) of coefficients (modes,)."""
        waves = (self.radial @ coefficients.reshape(self.spokes, self.rings, 1))[..., 0]
        nu = np.fft.ifft(waves.T, norm="ortho")
        return np.concatenate([[nu[0].mean()], nu.ravel()])


def ring_tables(mesh, nt):
    """Of the rings of a polar `Disk`: lumped areas (nr,), Laplace's weights along spokes (nr - 1,) and rings (nr,)."""
    nr = (len(mesh.z) - 1) // nt
    area = np.bincount(mesh.faces.ravel(), np.repeat(mesh.areas, 3))[1::nt] / 3
    K, first = mesh.laplace, np.arange(nr) * nt + 1
    spokes = -np.asarray(K[first[:-1], first[1:]]).ravel()
    return area, spokes, -np.asarray(K[first, first + 1]).ravel()


def eigenvectors(area, spokes, arcs, nt, count):
    """Radial parts (nt, nr, nr) of all eigenvectors by angular mode; values and places of the smoothest, (count,)."""
    nr, inner = len(area), np.arange(len(area) - 1)
    radial = np.zeros((nr, nr))
    radial[inner, inner + 1] = radial[inner + 1, inner] = -spokes
    radial -= np.diag(radial.sum(1))
    angular = 2 - 2 * np.cos(2 * np.pi * np.arange(nt) / nt)
    root = 1 / np.sqrt(area)
    matrices = root[:, None] * (radial + angular[:, None, None] * np.diag(arcs)) * root
    values, vectors = np.linalg.eigh(matrices)  # (nt, nr), (nt, nr, nr)
    kept = np.argsort(values, axis=None, kind="stable")[:count]
    return np.sqrt(np.pi) * root[:, None] * vectors, values.ravel()[kept].clip(min=0), kept
