"""The mismatch of landmarks as a residual of the map, as points or sliding along their target curves."""

import numpy as np
from scipy import sparse

TANGENTIAL_WEIGHT = 0.1  # of a sliding landmark's residual along its target curve


class Landmarks:
    """The scaled residual of mapped landmarks, as points or sliding along their target curves.

    Residual of one landmark: `sqrt(gamma / M) conj(t) (w - q)`, real part along the target's tangent t (weighted down
    where it slides), imaginary part across it.
    """

    def __init__(self, target, curve, sliding):
        self.target, self.tangent = target, np.ones(len(target), complex)
        self.count = max(len(target), 1)  # of none, where features lead alone, the mean is 0
        self.weights = np.ones((2, len(target)))
        if sliding:
            for label in np.unique(curve):
                on = np.flatnonzero(curve == label)
                inner = on[1:-1]
                along = target[on[2:]] - target[on[:-2]]
                self.tangent[inner] = along / abs(along)
                self.weights[0, inner] = TANGENTIAL_WEIGHT

    def components(self, change, gamma):
        """Complex changes of the points (M, ...) as scaled residual components (2 M, ...)."""
        shape = (-1,) + (1,) * (change.ndim - 1)
        turned = self.tangent.conj().reshape(shape) * change
        along, across = (self.weights[k].reshape(shape) for k in (0, 1))
        return np.sqrt(gamma / self.count) * np.concatenate([along * turned.real, across * turned.imag])

    def residual(self, points, gamma):
        """Components (2 M,) of mapped points (M,) less their targets."""
        return self.components(points - self.target, gamma)

    def rows(self, samples, gamma):
        """Sparse complex R (2 M, N) for points `samples @ w`: the components change by `Re(conj(R) dw)`."""
        turns = np.concatenate([self.weights[0] * self.tangent, 1j * self.weights[1] * self.tangent])
        scale = np.sqrt(gamma / self.count)
        return (sparse.diags_array(scale * turns) @ sparse.vstack([samples, samples])).tocsr()

    def error(self, points):
        """Mean distance of mapped points (M,) from their targets."""
        return abs(points - self.target).mean()

    def jacobian(self, grad_re, grad_im, gamma):
        """Gradients of the components (2 M, n) from those of Re w and Im w, (M, n)."""
        turn = self.tangent.conj()[:, None]
        along, across = self.weights[0][:, None], self.weights[1][:, None]
        return np.sqrt(gamma / self.count) * np.concatenate(
            [along * (turn.real * grad_re - turn.imag * grad_im), across * (turn.imag * grad_re + turn.real * grad_im)]
        )
