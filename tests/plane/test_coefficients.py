"""The paper's activation, which makes any field a coefficient, with its inverse and its pullback."""

import numpy as np

from qclearn.plane.coefficients import bounded, bounded_pullback, unbounded


def complex_normal(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


def test_the_activation_is_the_papers_and_has_its_inverse():
    nu = complex_normal(np.random.default_rng(0), 500) * np.logspace(-9, 0.5, 500)
    np.testing.assert_allclose(bounded(nu), np.tanh(abs(nu)) * np.exp(1j * np.angle(nu)), rtol=1e-14)
    np.testing.assert_allclose(unbounded(bounded(nu)), nu, rtol=1e-6)
    assert abs(bounded(np.array([50 + 50j, -1e9]))).max() < 1
    assert bounded(np.zeros(1, complex)) == 0 and unbounded(np.zeros(1, complex)) == 0


def test_the_activations_pullback_is_its_derivative_also_at_zero():
    rng = np.random.default_rng(1)
    nu, change, grad = (complex_normal(rng, 40) for _ in range(3))
    nu[0] = 0
    step = 1e-6
    slope = (bounded(nu + step * change) - bounded(nu - step * change)) / (2 * step)
    np.testing.assert_allclose((bounded_pullback(nu, grad).conj() * change).real, (grad.conj() * slope).real, atol=1e-8)
