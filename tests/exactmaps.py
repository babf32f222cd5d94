"""The catalogue of closed-form maps of `qcbook.exactmaps`, and more of them that tests alone need."""

import numpy as np

from qcbook.exactmaps import ExactMap, affine, radial_stretch, sliding, turn, twist
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk, square_disk
from qclearn.plane.mobius import mobius

__all__ = ["affine", "radial_stretch", "sliding", "twist"]


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


def normalised(exact):
    """A map of the disk with the Möbius map after it that holds 0 and 1."""
    w = exact(np.array([0j, 1.0]))
    return after(moebius(w[0], -np.angle(mobius(w[1], w[0]))), exact)


def errors(solve, exact, *meshes):
    """Largest error over the vertices of each mesh, (z, faces), of a solver: (z, faces, mu) -> f."""
    off = (solve(z, faces, exact.on_faces(Disk(z, faces))) - exact(z) for z, faces in meshes)
    return np.array([abs(each).max() for each in off])


def assert_accuracy(solve, exact, measured, least):
    """Errors on square grids 32, 64 and polar ones 32 x 96, 64 x 192 are as measured, and fall by 2^least and more."""
    off = errors(solve, exact, square_disk(32), square_disk(64), polar_disk(32, 96), polar_disk(64, 192))
    assert (off <= 1.05 * np.array(measured)).all(), off
    assert np.log2(off[::2] / off[1::2]).min() >= least, off


# The disk maps of the convergence table; all of them hold 0 and 1.
RADIAL, TWIST, SLIDING, SLIDING_THREE = (radial_stretch(1.5), twist(0.6), sliding(0.5), sliding_three(0.15))
DISK_MAPS = [RADIAL, TWIST, SLIDING, SLIDING_THREE]
