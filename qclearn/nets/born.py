"""The derivative of the map at the identity by the coefficient (the Born step), as a layer."""

import numpy as np
import torch
from torch import nn

from ..plane.solver import DiskSolver
from .polargrid import as_tensor


class Born(nn.Module):
    """Displacements `df = sum conj(one) c + two conj(c)` of polar nodes by coefficients c of nu.

    one, two (nr, modes): at the first spoke's nodes; a turn of the disk turns them.
    """

    def __init__(self, grid):
        super().__init__()
        self.grid, (one, two) = grid, _responses(grid)
        mode = grid.selected.numpy() // grid.nr
        waves = np.concatenate([mode - 1, 3 - mode]) % grid.nt
        for name, table in {"one": one.conj(), "two": two, "waves": waves}.items():
            self.register_buffer(name, as_tensor(table), persistent=False)

    def moved(self, nu):
        """Displacements (B, nr, nt) of the nodes by a field nu (B, nr, nt), to first order."""
        c = self.grid.coefficients(nu)
        # (B, nr, 2 modes).
        parts = torch.cat([c[:, None] * self.one, c.conj()[:, None] * self.two], 2)
        waves = parts.new_zeros(*parts.shape[:2], self.grid.nt).index_add(2, self.waves, parts)
        return torch.fft.ifft(waves, norm="forward")


def _responses(grid):
    """`one`, `two` (nr, modes) of `Born`, in the gauge f(0) = 0 without a mean turn of the circle."""
    z, nr, nt, solver = grid.mesh.z, grid.nr, grid.nt, DiskSolver(grid.mesh)
    solver.solve(np.zeros(len(grid.mesh.faces), complex))
    rings, rim = 1 + nt * np.arange(nr), np.arange(len(z) - nt, len(z))
    real = np.zeros((nr, len(z)), complex)
    real[np.arange(nr), rings] = 1
    imaginary = 1j * real
    imaginary[:, rim] -= z[rings, None] * 1j * z[rim] / nt
    grad_mu = solver.pullback(np.concatenate([real, imaginary]))
    grad_nu = grad_mu @ grid.mesh.to_faces
    re, im = grid.spectrum.gradients(grad_nu)[:, grid.selected.numpy()].reshape(2, nr, -1)
    return (re - 1j * im) / 2, (re + 1j * im) / 2
