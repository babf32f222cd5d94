"""The map with a free boundary by the logarithm of its quotient with a linear map: the second form,
a check of `solve_beltrami_disk`."""

import numpy as np

from qclearn.plane import Dirichlet, Disk
from qclearn.plane.checks import check_coefficient
from qclearn.plane.coefficients import diffuse
from qclearn.plane.solver import DiskSolver


def solve_beltrami_disk_log(z, faces, mu):
    """The disk self-map with Beltrami coefficient mu, free boundary, f(0) = 0 and f(1) = 1, (V,).

    Away from the pole `F = log f` solves `F_zbar = mu F_z`. With `L = z + mu0 conj(z)`, mu0 the
    mean of mu around the pole, `F = log L + u + iv` with bounded u (Dirichlet, `u = -log|L|` on the
    circle) and v (natural condition): `int A grad u . grad phi = -int A grad log|L| . grad phi - 2
    pi phi(0)`, the same with arg L and without the pole for v; then `f = L exp(u + iv)`. Not
    certified: twice the work of `solve_beltrami_disk`, and the boundary can run backwards on ragged
    meshes. Errors: BeltramiError, SurfaceError.
    """
    disk = Disk(z, faces)
    solver = DiskSolver(disk)
    mu = check_coefficient(mu, len(disk.faces))
    matrix = disk.stiffness(mu)
    loop, pole = solver.loop, solver.pole
    around = (disk.faces == pole).any(1)
    mu0 = np.average(mu[around], weights=disk.areas[around])
    z = disk.z - disk.z[pole]
    L = z + mu0 * np.conj(z)
    # d(log L) = ((1 + mu0) dx + i (1 - mu0) dy) / L: real part for log|L|, imaginary part for arg
    # L.
    x, y = np.array([1 + mu0, 1j * (1 - mu0)])[:, None] * mean_reciprocal(disk.at(L))

    def load(gradient):
        flux = diffuse(mu, gradient)[:, None]
        per_corner = disk.areas[:, None] * (disk.gradients.conj() * flux).real
        return -np.bincount(disk.faces.ravel(), per_corner.ravel(), len(z))

    source = load(x.real + 1j * y.real)
    source[pole] -= 2 * np.pi
    u = Dirichlet(matrix, loop).solve(-np.log(abs(L[loop])), source)
    # A constant in v is a rotation, which the normalisation removes.
    v = Dirichlet(matrix, loop[:1]).solve(0.0, load(x.imag + 1j * y.imag))
    return solver.normalise(L * np.exp(u + 1j * v))


def mean_reciprocal(picture):
    """Exact mean of 1/L over each triangle, (F,), of the picture under L, affine there; at most a
    corner lies at 0.

    Stokes: `int dA / L = (1/2i) sum over edges of (conj(a) - a conj(b - a)/(b - a)) log(b / a)`, a,
    b = L at its ends.
    """
    a = picture.z[picture.faces]
    b = np.roll(a, -1, axis=1)
    touching = (a == 0) | (b == 0)  # such an edge contributes 0, the limit of the formula
    ratio = np.where(touching, 1, b) / np.where(touching, 1, a)
    terms = (a.conj() - a * (b - a).conj() / (b - a)) * np.log(ratio)
    return terms.sum(1) / (2j * picture.areas)
