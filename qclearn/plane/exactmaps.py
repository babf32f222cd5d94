"""Catalogue of quasi-conformal maps in closed form: the map, both Wirtinger derivatives and so its exact mu."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ExactMap:
    """`f`, `f_z` and `f_zbar` as functions of z; `largest` is the supremum of |mu| over the unit disk."""

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
        """Exact mu at the centroids of a `Disk` (a convergence test would learn nothing of the interpolant's)."""
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


def sliding_three(c):
    """`z exp(i c |z|^3 sin(3 arg z))`: the boundary slides with three periods."""
    return turn("sliding 3", lambda z: c * (z**3).imag, lambda z: 1.5 * c * z**2 / 1j, 1.5 * c / (1 - 1.5 * c))


def moebius(a, theta):
    """`exp(i theta) (z - a)/(1 - conj(a) z)`, mu = 0."""
    return ExactMap(
        "Möbius",
        lambda z: np.exp(1j * theta) * (z - a) / (1 - np.conj(a) * z),
        lambda z: np.exp(1j * theta) * (1 - abs(a) ** 2) / (1 - np.conj(a) * z) ** 2,
        lambda z: 0j * z,
        0.0,
    )


def after(g, f):
    """g after f, derivatives by the chain rule; `largest` is the bound for quasi-conformal compositions."""

    def f_z(z):
        w = f(z)
        return g.f_z(w) * f.f_z(z) + g.f_zbar(w) * np.conj(f.f_zbar(z))

    def f_zbar(z):
        w = f(z)
        return g.f_z(w) * f.f_zbar(z) + g.f_zbar(w) * np.conj(f.f_z(z))

    return ExactMap(
        f"{g.name} after {f.name}",
        lambda z: g(f(z)),
        f_z,
        f_zbar,
        (f.largest + g.largest) / (1 + f.largest * g.largest),
    )


# The disk maps of the convergence table; all of them hold 0 and 1.
RADIAL, TWIST, SLIDING, SLIDING_THREE = radial_stretch(1.5), twist(0.6), sliding(0.5), sliding_three(0.15)
DISK_MAPS = [RADIAL, TWIST, SLIDING, SLIDING_THREE]
