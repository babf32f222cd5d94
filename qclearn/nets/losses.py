"""The losses of the paper in its order, each named after its equation, with their corrections.

All are batched and return one value a sample, (B,): take the mean. Points and maps are complex, (B,
N) and (B, V); coefficients complex, (B, F), |mu| < 1. Losses on a mesh take its `LossMesh` first.
"""

import torch
from torch import nn

from ..plane.linear import around_vertices


class LossMesh(nn.Module):
    """A `Disk` on a network's device: the matrix K(mu), the boundary, and gradients of mu."""

    def __init__(self, disk, precision=torch.float32):
        super().__init__()
        tables = {
            name: getattr(disk, name) for name in ("z", "faces", "loop", "areas", "gradients")
        }
        around = around_vertices(disk.areas, disk.faces, len(disk.z))[disk.faces]
        tables["shares"] = disk.areas[:, None] / around  # of the faces round each corner
        kinds = {"f": precision, "c": precision.to_complex(), "i": torch.int64}
        for name, table in tables.items():
            table = torch.tensor(table)  # a copy: a Disk's arrays are read-only
            kind = kinds["c" if table.is_complex() else "f" if table.is_floating_point() else "i"]
            self.register_buffer(name, table.to(kind), persistent=False)

    def gradient(self, values):
        """Gradients (B, F), `d/dx + i d/dy`, of real vertex values (B, V), linear on each face."""
        return (values[:, self.faces] * self.gradients).sum(-1)

    def wirtinger(self, f):
        """`f_z` and `f_zbar`, (B, F) each, of maps f (B, V)."""
        corners = f[:, self.faces]
        return tuple(0.5 * (corners * g).sum(-1) for g in (self.gradients.conj(), self.gradients))

    def divergence(self, fields):
        """`sum_T |T| grad phi_i . w_T` (B, V) of fields w (B, F): K(mu) u for w = A grad u."""
        corners = self.areas[:, None] * (self.gradients.conj() * fields[..., None]).real
        total = corners.new_zeros(len(fields), len(self.z))
        return total.index_add(1, self.faces.flatten(), corners.flatten(1))

    def apply(self, mu, f):
        """K(mu) f (B, V): `A grad u = ((1 + |mu|^2) grad u - 2 mu conj(grad u)) / (1 - |mu|^2)`."""
        size = mu.real**2 + mu.imag**2
        parts = []
        for u in (f.real, f.imag):
            g = self.gradient(u)
            parts.append(self.divergence(((1 + size) * g - 2 * mu * g.conj()) / (1 - size)))
        return torch.complex(*parts)

    def to_vertices(self, mu):
        """Area-weighted means (B, V) of face values (B, F) round each vertex."""
        values = (mu[..., None] * self.shares).flatten(1)
        return values.new_zeros(len(mu), len(self.z)).index_add(1, self.faces.flatten(), values)


def energy(mesh, mu, f):
    """Dirichlet energy `1/2 int grad f . A grad f` (B,), at least `area`, equal at the right map."""
    return 0.5 * (f.conj() * mesh.apply(mu, f)).real.sum(-1)


def area(mesh, f):
    """Signed area (B,) inside the image of the boundary polygon."""
    boundary = f[:, mesh.loop]
    return 0.5 * (boundary.conj() * boundary.roll(-1, -1)).imag.sum(-1)


def L_Energy(mesh, mu, f):
    """`2 int |f_zbar - mu f_z|^2 / (1 - |mu|^2)` (B,), i.e. `energy - area`: 0 for the right map.

    The square of an H1 norm of the error, face by face, where `L_LBS` is an L1 norm of second
    differences; and blind to Möbius maps after f.
    """
    f_z, f_zbar = mesh.wirtinger(f)
    gap = f_zbar - mu * f_z
    return 2 * ((gap.real**2 + gap.imag**2) / (1 - mu.real**2 - mu.imag**2)) @ mesh.areas


def L_Maps(f, exact, z):
    """`sum |f - f*| / sum |z - f*|`, for maps f and exact maps f* (B, V)."""
    return (f - exact).abs().sum() / (z - exact).abs().sum()


def L_LD(points, target):
    """`sum_i |x_i - x^_i|^2` (B,) over the points (B, ...) of the curves of a sample.

    Printed from i = 0 to N with 'N points': the sum over all points, the endpoints included, is
    meant.
    """
    return ((points - target).abs() ** 2).flatten(1).sum(1)


def L_LBS(mesh, mu, f):
    """`1/(2N) sum_i |Re R_i| + |Im R_i|` (B,), R the gradient of `energy - area`.

    `R_i = (K(mu) f)_i` at interior vertices and `(K(mu) f)_i + (i/2)(f_next - f_previous)` on the
    boundary; f must hold f(0) = 0 and f(1) = 1. Corrected (eqs central_coeff, cv_coeff, LBS_loss): the
    weight Area(T) of each face, A and B of the neighbour itself, the rows of the boundary, and
    1/(2N) for the mean of 2N terms.
    """
    residual = mesh.apply(mu, f)
    boundary = f[:, mesh.loop]
    turned = 0.5j * (boundary.roll(-1, -1) - boundary.roll(1, -1))
    return _mean_size(residual.index_add(1, mesh.loop, turned))


def L_LBS_printed(mesh, mu, f):
    """`1/(2N) sum_i |(K s)_i| + |(K t)_i|` (B,), eq. LBS_loss: it is 0 where f is constant.

    Weights and neighbours are corrected as in `L_LBS`, the rows are not: on the boundary that of the
    right map is not 0, that of the collapse onto the point 1 is. This, not the freedom of Möbius
    maps, is why points cluster there.
    """
    return _mean_size(mesh.apply(mu, f))


def _mean_size(residual):
    return 0.5 * (residual.real.abs() + residual.imag.abs()).mean(-1)


def L_Boundary(angles):
    """`sum_i 1/theta_i` (B,) of the boundary angles (B, N), theta_i > 0, of sum 2 pi.

    At its smallest, `N^2 / (2 pi)`, for equal angles: its weight rho belongs to one N.
    """
    return (1 / angles).sum(-1)


def L_DBSNet(mesh, mu, f, angles, eta=1.0, rho=1e-8, equation=L_LBS):
    """`eta L_LBS + rho L_Boundary` (B,), eq. BSnetLoss; equation: also `L_LBS_printed`."""
    return eta * equation(mesh, mu, f) + rho * L_Boundary(angles)


def L_mu(mu, shares=None):
    """`1/N sum_i |mu_i|^2` (B,) over faces, eq. muloss; shares (F,): of the faces, of sum 1."""
    return _mean(mu.abs() ** 2, shares)


def L_grad_mu(mesh, mu, shares=None):
    """`1/N sum_i |grad mu_i|^2` (B,) over faces, eq. musmooth; shares (F,): of the faces, sum 1.

    The gradient of values that are constant on faces is not defined as printed: here mu is averaged
    to the vertices by area, and |grad mu|^2 is the squares of the four partial derivatives of its
    linear interpolant.
    """
    nodal = mesh.to_vertices(mu)
    return _mean(
        mesh.gradient(nodal.real).abs() ** 2 + mesh.gradient(nodal.imag).abs() ** 2, shares
    )


def L_lost(mesh, mu, shares=None):
    """`1/N sum_i 4 |mu_i - m_i|^2 / |T_i|` (B,) over faces T_i, m_i the corners' mean.

    What the averages of `L_grad_mu` lose, in its measure: where mu is +-a by turns and the averages
    are 0, it is `4 a^2 / |T|`, the squares of the differences of neighbouring pixels over their
    side, in both directions.
    """
    means = mesh.to_vertices(mu)[:, mesh.faces].mean(-1)
    return _mean(4 * (mu - means).abs() ** 2 / mesh.areas, shares)


def _mean(values, shares):
    return values.mean(-1) if shares is None else values @ shares


def L_Landmark(points, target):
    """`1/M sum_i |p_i - p^_i|^2` (B,) over points (B, M), eq. lmloss."""
    return ((points - target).abs() ** 2).mean(-1)


def L_CP(mesh, mu, points, target, weights, shares=None):
    """`alpha L_mu + beta L_grad_mu + gamma L_Landmark` (B,), eq. RegLoss, of a `Weights`."""
    terms = L_mu(mu, shares), L_grad_mu(mesh, mu, shares), L_Landmark(points, target)
    return weights.alpha * terms[0] + weights.beta * terms[1] + weights.gamma * terms[2]
