"""The plane in torch, batched: the paper's activation, disk Möbius maps, the square."""

import torch

from ..plane.mobius import nearest_mobius

STEPS = 8  # Gauss-Newton steps of a Möbius map


def bounded(nu):
    """The paper's activation `tanh(|nu|) nu / |nu|`, |mu| at most 1 - 1e-6 in float32."""
    size = nu.abs().clamp(min=1e-6)
    return torch.tanh(size).clamp(max=1 - 1e-6) / size * nu


def mobius(w, a, theta):
    """`exp(i theta) (w - a) / (1 - conj(a) w)` for w (B, n), a and theta (B,)."""
    a = a[:, None]
    return torch.exp(1j * theta)[:, None] * (w - a) / (1 - a.conj() * w)


def fit_mobius(f, q):
    """Parameters (a, theta), (B,) each, of the Möbius map that brings f (B, M) closest to q."""
    f, goal = (x.detach().cpu().numpy().astype(complex) for x in (f, q))
    (a, theta), _ = nearest_mobius(f, goal, 1, STEPS)
    return torch.from_numpy(a).to(q), torch.from_numpy(theta).to(q.real)


def square_places(points):
    """Places (..., 2) in [-1, 1] on the square, column and row upwards, of points of the disk."""
    size = points.abs().clamp(min=1e-12)
    square = points * size / torch.maximum(points.real.abs(), points.imag.abs()).clamp(min=1e-12)
    return torch.view_as_real(square)
