"""The algebra of Beltrami coefficients: of compositions and inverses, the matrix A(mu), and the
paper's activation."""

import numpy as np
from jaxtyping import Complex
from numpy import ndarray

from .checks import complex_numbers

LARGEST = 1 - 1e-10  # of |mu|: tanh rounds to 1 from 19 on, where a step that is too long may lead


def compose_coefficients(
    mu_f: Complex[ndarray, " *F"], f_z: Complex[ndarray, " *F"], mu_g: Complex[ndarray, " *F"]
) -> Complex[ndarray, " *F"]:
    """Coefficient of g after f, mu_g at f(z): `(mu_f + t mu_g) / (1 + conj(mu_f) t mu_g)`, `t =
    conj(f_z)/f_z`."""
    turned = np.conj(f_z) / f_z * mu_g
    return (mu_f + turned) / (1 + np.conj(mu_f) * turned)


def inverse_coefficient(
    mu: Complex[ndarray, " *F"], f_z: Complex[ndarray, " *F"]
) -> Complex[ndarray, " *F"]:
    """Coefficient of the inverse of f at the image points f(z): `-mu f_z / conj(f_z)`."""
    return -complex_numbers(mu, "mu") * f_z / np.conj(f_z)


def diffuse(mu, gradient):
    """A(mu) applied to gradients: `((1 + |mu|^2) g - 2 mu conj(g)) / (1 - |mu|^2)`; A is SPD with
    determinant 1."""
    m = abs(mu) ** 2
    return ((1 + m) * gradient - 2 * mu * np.conj(gradient)) / (1 - m)


def bounded(nu):
    """The paper's activation `T(nu) = tanh(|nu|) nu / |nu|`: any complex field becomes one with
    |mu| < 1."""
    size = abs(nu)
    return _over(np.minimum(np.tanh(size), LARGEST), size) * nu


def unbounded(mu):
    """Inverse of `bounded`: `artanh(|mu|) mu / |mu|`."""
    size = abs(mu)
    return _over(np.arctanh(size), size) * mu


def _over(values, size):
    """`values / size`, and 1 where the size is 0."""
    return np.divide(values, size, out=np.ones_like(values), where=size > 0)


def bounded_pullback(nu, grad_mu):
    """A loss's gradient by nu from its gradient by mu = T(nu)."""
    size = abs(nu)
    across = _over(np.tanh(size), size)
    along = 1 - np.tanh(size) ** 2
    direction = _over(nu, size)
    return 0.5 * ((along + across) * grad_mu + (along - across) * direction**2 * np.conj(grad_mu))
