"""The mismatch of features at one scale, as a residual of the map that a Gauss-Newton step can be taken for."""

import numpy as np
from scipy import sparse

from ..plane.beltrami import corner_average, hat_gradients, signed_areas
from ..plane.diskmesh import interpolate


class Image:
    """The control's features (W, C) at one scale on its disk, at places that the features' lookup found."""

    def __init__(self, features, values):
        z, self.faces = features.lookup.z, features.lookup.faces
        self.values = values
        # Slopes are averaged to the vertices: not the derivative of the interpolant, but one without its jumps.
        by_face = np.einsum("fk,fkc->fc", hat_gradients(z, self.faces), values[self.faces])
        self.by_vertex = corner_average(self.faces, len(z), signed_areas(z, self.faces)) @ by_face

    def at(self, places):
        """Values (P, C)."""
        return interpolate(self.values, self.faces, *places)

    def slopes(self, places):
        """Complex gradients (P, C)."""
        return interpolate(self.by_vertex, self.faces, *places)


class Dense:
    """`delta sum_c a_c sum_k w_k (I_c(x_k) - J_c(M f(x_k)))^2` over all moving vertices, at scale sigma.

    I, J: the standardised features of both sides, a: their shares, w: the vertices' shares of the moving area, so that
    the sum is 2 (1 - r) where the mapped features keep their variance. samples (V, N): from the mesh that is mapped to
    the moving vertices, None where it is their own.
    """

    def __init__(self, features, sigma, delta, samples=None):
        self.lookup, self.samples, self.last = features.lookup, samples, (None, None)
        self.here, there = features.at(sigma)
        self.image = Image(features, there)
        self.scale = np.sqrt(delta * features.areas[:, None] * features.shares)

    def residual(self, f):
        """`sqrt(delta a_c w_k) (I_c - J_c)`, (C V,), feature after feature, for a map f (N,)."""
        return (self.scale * (self.here - self.image.at(self.locate(f)))).T.ravel()

    def rows(self, f):
        """Sparse complex R (C V, N): the residual changes by `Re(conj(R) df)`."""
        blocks = [sparse.diags_array(column) for column in (-self.scale * self.image.slopes(self.locate(f))).T]
        return sparse.vstack([block if self.samples is None else block @ self.samples for block in blocks]).tocsr()

    def locate(self, f):
        """Where the moving vertices lie in the control's disk; kept for the last map that was asked for."""
        if self.last[0] is not f:
            guess = None if self.last[1] is None else self.last[1][0]
            self.last = f, self.lookup(f if self.samples is None else self.samples @ f, guess)
        return self.last[1]
