"""The plane in torch, for batches of complex points: the paper's activation, disk Möbius maps and their fit,
the square."""

import torch

RIDGE = 1e-9  # relative, of the three Möbius columns: fewer than two landmarks leave some of them free


def bounded(nu):
    """The paper's activation `tanh(|nu|) nu / |nu|`; |mu| is 1 - 1e-6 at most, as float32 rounds the limit of
    `plane.coefficients` to 1."""
    size = nu.abs().clamp(min=1e-6)
    return torch.tanh(size).clamp(max=1 - 1e-6) / size * nu


def mobius(w, a, theta):
    """`exp(i theta) (w - a) / (1 - conj(a) w)` for w (B, n), a and theta (B,)."""
    a = a[:, None]
    return torch.exp(1j * theta)[:, None] * (w - a) / (1 - a.conj() * w)


def mobius_columns(w):
    """Changes (B, n, 3) of points w with an increment (theta, Re a, Im a) after a Möbius map."""
    return torch.stack([1j * w, w**2 - 1, -1j * (1 + w**2)], 2)


def fit_mobius(f, q, mask, steps=4):
    """Parameters (a, theta), (B,) each, of the disk Möbius map that brings f (B, M) closest to q:
    Gauss-Newton steps."""
    f, q = f.detach().to(torch.complex128), q.to(torch.complex128)
    a, theta = torch.zeros_like(f[:, 0]), torch.angle((mask * q * f.conj()).sum(1))
    for _ in range(steps):
        w = mobius(f, a, theta)
        columns = torch.view_as_real(mobius_columns(w) * mask[..., None]).mT.flatten(1, 2)
        left = torch.view_as_real((q - w) * mask).flatten(1)
        normal = columns.mT @ columns
        size = normal.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
        normal = normal + RIDGE * (size + 1e-12) * torch.eye(3).to(normal)
        turn, real, imaginary = torch.linalg.solve(normal, columns.mT @ left[..., None])[..., 0].unbind(1)
        step = torch.complex(real, imaginary)
        step = step / (2 * step.abs()).clamp(min=1)  # no further than 1/2 at once
        at_one = mobius(mobius(torch.ones_like(f[:, :1]), a, theta), step, turn)[:, 0]
        step = torch.exp(-1j * theta) * step
        pole = (step + a) / (1 + a.conj() * step)
        a, theta = pole, torch.angle(at_one * (1 - pole.conj()) / (1 - pole))
    return a.to(torch.complex64), theta.float()


def square_places(points):
    """Places (..., 2) in [-1, 1] on the square, column and row upwards, of complex points of the disk."""
    size = points.abs().clamp(min=1e-12)
    square = points * size / torch.maximum(points.real.abs(), points.imag.abs()).clamp(min=1e-12)
    return torch.view_as_real(square)
