"""Nodal fields on a disk mesh: the paper's activation, which makes any of them a coefficient, and integrals of
products."""

import numpy as np

from .beltrami import assemble, signed_areas

LARGEST = 1 - 1e-10  # of |mu|: tanh rounds to 1 from 19 on, where a step that is too long may lead


def bounded(nu):
    """The paper's activation `T(nu) = tanh(|nu|) nu / |nu|`: any complex field becomes one with |mu| < 1."""
    size = abs(nu)
    return np.divide(np.minimum(np.tanh(size), LARGEST), size, out=np.ones_like(size), where=size > 0) * nu


def unbounded(mu):
    """Inverse of `bounded`: `artanh(|mu|) mu / |mu|`."""
    size = abs(mu)
    return np.divide(np.arctanh(size), size, out=np.ones_like(size), where=size > 0) * mu


def bounded_pullback(nu, grad_mu):
    """Gradient with respect to nu of a loss whose gradient with respect to mu = T(nu) is grad_mu."""
    size = abs(nu)
    across = np.divide(np.tanh(size), size, out=np.ones_like(size), where=size > 0)
    along = 1 - np.tanh(size) ** 2
    direction = np.divide(nu, size, out=np.ones_like(nu), where=size > 0)
    return 0.5 * ((along + across) * grad_mu + (along - across) * direction**2 * np.conj(grad_mu))


def mass_matrix(z, faces):
    """Consistent mass matrix of piecewise linear functions on a planar mesh, sparse (V, V)."""
    blocks = signed_areas(z, faces)[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12
    return assemble(faces, blocks, len(z))
