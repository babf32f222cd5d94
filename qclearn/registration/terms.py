"""The mismatches that a fit makes small, as residuals of the map: of landmarks, and of features at one scale."""

import numpy as np
from scipy import sparse

from .features import Image

TANGENTIAL_WEIGHT = 0.1  # of a sliding landmark's residual along its target curve


class LandmarkTerm:
    """`sqrt(gamma / M) conj(t) (w - q)` of mapped landmarks w with targets q (M,), t the target curve's tangent, 1 for
    points that do not slide. Real parts, along t and weighted down for those that do, stand before imaginary ones."""

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
        return self.jacobian(change.real, change.imag, gamma)

    def residual(self, points, gamma):
        """Components (2 M,) of mapped points (M,) less their targets."""
        return self.components(points - self.target, gamma)

    def rows(self, samples, gamma):
        """Sparse complex R (2 M, N) for points `samples @ w`: the components change by `Re(conj(R) dw)`."""
        turns = np.concatenate([self.weights[0] * self.tangent, 1j * self.weights[1] * self.tangent])
        scale = np.sqrt(gamma / self.count)
        return (sparse.diags_array(scale * turns) @ sparse.vstack([samples, samples])).tocsr()

    def jacobian(self, by_re, by_im, gamma):
        """Components (2 M, ...) from the parts Re w and Im w of changes, or from their gradients, (M, ...) each."""
        shape = (-1,) + (1,) * (by_re.ndim - 1)
        turn, along, across = (part.reshape(shape) for part in (self.tangent.conj(), *self.weights))
        rows = along * (turn.real * by_re - turn.imag * by_im), across * (turn.imag * by_re + turn.real * by_im)
        return np.sqrt(gamma / self.count) * np.concatenate(rows)


class FeatureTerm:
    """`delta sum_c a_c sum_k w_k (I_c(x_k) - J_c(M f(x_k)))^2` over all moving vertices, at scale sigma.

    I, J: standardised features of both sides; a: their shares; w: the vertices' shares of the moving area; a sum is
    2 (1 - r) where features keep their variance. samples (V, N): the mapped mesh to the moving vertices, if another.
    """

    def __init__(self, features, sigma, delta, samples=None):
        self.lookup, self.samples, self.last = features.disk.lookup, samples, (None, None)
        self.here, there = features.at(sigma)
        self.image = Image(features.disk, there)
        self.scale = np.sqrt(delta * features.areas[:, None] * features.shares)

    def residual(self, f):
        """`sqrt(delta a_c w_k) (I_c - J_c)`, (C V,), feature after feature, for a map f (N,)."""
        return (self.scale * (self.here - self.image.at(self.locate(f)))).T.ravel()

    def rows(self, f):
        """Sparse complex R (C V, N): the residual changes by `Re(conj(R) df)`."""
        blocks = [sparse.diags_array(column) for column in (-self.scale * self.image.slopes(self.locate(f))).T]
        return sparse.vstack([block if self.samples is None else block @ self.samples for block in blocks]).tocsr()

    def locate(self, f):
        """Where the moving vertices lie in the control's disk, kept for the last map."""
        if self.last[0] is not f:
            guess = None if self.last[1] is None else self.last[1][0]
            self.last = f, self.lookup(f if self.samples is None else self.samples @ f, guess)
        return self.last[1]
