"""The landmark fit linearised at the identity: its solution as one fixed, differentiable layer (a Born step).

At mu = 0 the map's derivative with respect to nu is known once and for all on a polar mesh; a turn of the disk turns
it. In the eigenvectors of (Laplace, mass) the prior of the fit is diagonal, and the dual Gauss-Newton step of
`fit_landmarks` from nu = 0 is one 2M x 2M system a problem.
"""

import numpy as np
import torch
from torch import nn

from ..plane.beltrami import face_mean
from ..plane.disk import BeltramiDiskSolver
from .polargrid import as_tensor
from .torchplane import least_squares


class Born(nn.Module):
    """Derivatives at mu = 0 of the map at any point of the disk, and the fit's dual step with them.

    one, two (nr, modes): `df = sum conj(one) c + two conj(c)` at the first spoke's nodes for coefficients c of nu.
    response (V, 2, modes): gradients of Re f and Im f at every vertex.
    """

    def __init__(self, grid):
        super().__init__()
        self.grid, (one, two) = grid, _responses(grid)
        mode = grid.kept.numpy() // grid.nr
        turn = 2 * np.pi / grid.nt * np.arange(grid.nt)[:, None]
        # A turn of the disk by t multiplies the two by phases, and each angular mode m of nu.
        first, second = one[:, None] * np.exp(1j * turn * (1 - mode)), two[:, None] * np.exp(1j * turn * (3 - mode))
        rows = np.stack([first + second, 1j * (first - second)], 2).reshape(grid.nr * grid.nt, 2, -1)
        tables = {
            "one": one.conj(),
            "two": two,
            "response": np.concatenate([np.zeros((1, *rows.shape[1:])), rows]),
            "waves": np.concatenate([mode - 1, 3 - mode]) % grid.nt,
        }
        for name, table in tables.items():
            self.register_buffer(name, as_tensor(table), persistent=False)

    def jacobian(self, places):
        """Gradients of Re f and Im f at places (B, M) with respect to the coefficients of nu: (B, M, 2, modes)."""
        corners, weights = places
        return (self.response[corners] * weights[..., None, None]).sum(-3)

    def moved(self, c):
        """Displacements (B, nr, nt) of the nodes by coefficients c (B, modes), to first order."""
        parts = torch.cat([c[:, None] * self.one, c.conj()[:, None] * self.two], 2)  # (B, nr, 2 modes)
        waves = parts.new_zeros(*parts.shape[:2], self.grid.nt).index_add(2, self.waves, parts)
        return torch.fft.ifft(waves, norm="forward")

    def prepare(self, J, slope, columns, scale, alpha, beta):
        """The linearised fit of landmarks (B, M) with `jacobian` J whose map is followed by one of this slope (B, M).

        Returns `step(residual) -> (coefficients, promised)` for complex scaled residuals (B, M).
        """
        factor, real, imaginary = (slope * scale)[..., None], J[:, :, 0], J[:, :, 1]
        turned = factor.real * real - factor.imag * imaginary, factor.imag * real + factor.real * imaginary
        J = torch.stack(turned, 2).flatten(1, 2)  # (B, 2 M, modes): of the real and the imaginary parts by turns
        D = alpha[:, None] + beta[:, None] * self.grid.values  # (B, modes): the prior, diagonal in these coordinates
        rows = torch.view_as_real(J * D.rsqrt()[:, None]).flatten(2)
        columns = torch.view_as_real(columns * scale[..., None]).transpose(2, 3).flatten(1, 2).double()
        inverse = least_squares(columns, None)

        def project(x):  # off what a Möbius map does
            return x - columns @ (inverse @ x)

        S = project(project((rows @ rows.mT).double()).mT)
        S.diagonal(dim1=1, dim2=2).add_(1)
        factors = torch.linalg.cholesky(S)

        def step(residual):
            r = project(torch.view_as_real(residual).flatten(1).double()[..., None])
            y = torch.cholesky_solve(r, factors)
            promised = (r * y).sum((1, 2))
            y = project(y).to(J)
            return -(y.mT @ J)[:, 0] / D, promised.float()

        return step


def _responses(grid):
    """`one`, `two` (nr, modes) of `Born`, in the gauge f(0) = 0 without a mean turn of the circle."""
    (z, faces), nr, nt = grid.mesh, grid.nr, grid.nt
    solver = BeltramiDiskSolver(z, faces)
    solver.solve(np.zeros(len(faces), complex))
    rings, rim = 1 + nt * np.arange(nr), np.arange(len(z) - nt, len(z))
    real = np.zeros((nr, len(z)), complex)
    real[np.arange(nr), rings] = 1
    imaginary = 1j * real
    imaginary[:, rim] -= z[rings, None] * 1j * z[rim] / nt
    grad_mu = solver.pullback(np.concatenate([real, imaginary]))
    grad_nu = grad_mu @ face_mean(faces, len(z))
    nodal = grad_nu[:, 1:]
    nodal[:, :nt] += grad_nu[:, :1] / nt  # the centre is the mean of the first ring
    fields = torch.from_numpy(nodal.reshape(2 * nr, nr, nt)).to(torch.complex64)
    re, im = grid.gradients(fields).numpy().reshape(2, nr, -1)
    return (re - 1j * im) / 2, (re + 1j * im) / 2
