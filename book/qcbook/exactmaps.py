"""Catalogue of quasi-conformal maps in closed form: the map, both Wirtinger derivatives and so its
exact mu."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ExactMap:
    """`f`, `f_z` and `f_zbar` as functions of z; `largest` is the supremum of |mu| over the unit
    disk."""

    name: str
    f: Callable
    f_z: Callable
    f_zbar: Callable
    largest: float

    def __call__(self, z):
        return self.f(z)

    def mu(self, z):
        return self.f_zbar(z) / self.f_z(z)

    def on_faces(self, disk):
        """Exact mu at the centroids of a `Disk` (a convergence test would learn nothing of the
        interpolant's)."""
        return self.mu(disk.centroids)


def affine(a, b, c=0.0):
    """`a z + b conj(z) + c`, mu = b / a."""
    return ExactMap(
        "affine", lambda z: a * z + b * np.conj(z) + c, lambda z: a + 0 * z, lambda z: b + 0 * z, abs(b / a)
    )


def radial_stretch(K):
    """`z |z|^(K - 1)`, mu = (K - 1)/(K + 1) z / conj(z); its inverse is the stretch by 1/K."""

    def power(z):
        return abs(z) ** (K - 1)

    return ExactMap(
        "radial stretch",
        lambda z: z * power(z),
        lambda z: (K + 1) / 2 * power(z) + 0j,
        lambda z: (K - 1) / 2 * power(z) * (z / abs(z)) ** 2,
        abs(K - 1) / (K + 1),
    )


def turn(name, h, h_z, largest):
    """`z exp(i h(z))` for a real function h: every circle around 0 slides along itself."""
    return ExactMap(
        name,
        lambda z: z * np.exp(1j * h(z)),
        lambda z: np.exp(1j * h(z)) * (1 + 1j * z * h_z(z)),
        lambda z: np.exp(1j * h(z)) * 1j * z * np.conj(h_z(z)),
        largest,
    )


def twist(c):
    """`z exp(i c (1 - |z|^2))`: the boundary stays; its inverse is the twist by -c."""
    return turn("twist", lambda z: c * (1 - abs(z) ** 2), lambda z: -c * np.conj(z), abs(c) / np.sqrt(1 + c**2))


def sliding(c):
    """`z exp(i c Im(z) |z|)`, which slides the boundary; |mu| is largest on the circle."""
    t = np.linspace(0, np.pi, 20_001)
    bent = c / 2 * (np.cos(t) + 2j * np.sin(t))
    return turn(
        "sliding",
        lambda z: c * z.imag * abs(z),
        lambda z: c / 2 * (abs(z) / 1j + z.imag * np.conj(z) / abs(z)),
        float(abs(bent / (1 + bent)).max()),
    )
