"""The landmark fit, linearised at the identity: where CP-Net starts from, and what its corrections look at."""

import torch

from .torchplane import fit_mobius, mobius, mobius_columns


class Linearised:
    """One batch of landmark problems, linearised at the identity: the Born step `nu` and what it promises.

    ranges (2, 2): of log10 of beta / alpha and gamma / alpha, to which the conditions of the U-Nets are cut.
    """

    def __init__(self, grid, born, ranges, p, q, mask, weights):
        self.p, self.q, self.mask, self.weights = p, q, mask, weights
        b, g = weights.unbind(1)
        self.parameters = a, theta = fit_mobius(p, q, mask)
        w = mobius(p, a, theta)
        self.slope = torch.exp(1j * theta)[:, None] * (1 - a.abs() ** 2)[:, None] / (1 - a.conj()[:, None] * p) ** 2
        self.scale = (g / mask.sum(1)).sqrt()[:, None] * mask
        self.places = grid.locate(p)
        self.J = born.jacobian(self.places)
        self.step = born.prepare(self.J, self.slope, mobius_columns(w), self.scale, torch.ones_like(b), b)
        self.residual = (w - q) * mask
        self.c, self.promised = self.step(self.residual * self.scale)
        self.nu = grid.field(self.c)
        self.displacement = (q - w) / self.slope
        self.born_displacement = self.linear(self.c)
        low, high = torch.tensor(ranges).to(weights).T
        logs = torch.log10(weights.clamp(min=1e-12)).clamp(low, high)
        self.conditions = torch.stack([logs[:, 0], logs[:, 1] - 4, torch.log10(mask.sum(1)) - 2], 1)

    def linear(self, c):
        """What coefficients c (B, modes) do to the landmarks, to first order, before the Möbius map: (B, M)."""
        v = torch.einsum("bmkn,bn->bmk", self.J.conj(), c).real
        return torch.complex(v[..., 0], v[..., 1])
