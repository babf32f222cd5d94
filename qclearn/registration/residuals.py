"""The residuals of a fit: mismatches of landmarks and of features, and changes of area. Terms of
the map f have `residual(f)` and the sparse derivative `rows(f)`."""

import numpy as np
from scipy import sparse

from ..plane.linear import opposite_edges, three_a_row
from .features import vertex_slopes

TANGENTIAL_WEIGHT = 0.1  # of a sliding landmark's residual along its target curve


class LandmarkTerm:
    """`sqrt(gamma / M) conj(t) (w - q)` of mapped landmarks w with targets q (M,), t the target
    curve's tangent, 1 for points that do not slide. Real parts, along t and weighted down for those
    that do, stand before imaginary ones."""

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

    def residual(self, points, gamma):
        """Components (2 M,) of mapped points (M,) less their targets."""
        off = points - self.target
        return self.components(off.real, off.imag, gamma)

    def rows(self, samples, gamma):
        """Sparse complex R (2 M, N) for points `samples @ w`: the components change by `Re(conj(R)
        dw)`."""
        along, across = self.weights
        turns = np.concatenate([along * self.tangent, 1j * across * self.tangent])
        scale = np.sqrt(gamma / self.count)
        return (sparse.diags_array(scale * turns) @ sparse.vstack([samples, samples])).tocsr()

    def components(self, by_re, by_im, gamma):
        """Components (2 M, ...) from the parts Re w and Im w of changes, or from their gradients,
        (M, ...) each."""
        shape = (-1,) + (1,) * (by_re.ndim - 1)
        turn = self.tangent.conj().reshape(shape)
        along, across = (part.reshape(shape) for part in self.weights)
        along = along * (turn.real * by_re - turn.imag * by_im)
        across = across * (turn.imag * by_re + turn.real * by_im)
        return np.sqrt(gamma / self.count) * np.concatenate([along, across])


class Places:
    """Where points of the mapped mesh lie in the control's `Disk`.

    samples (P, N): from the mesh's vertices to the points; None: the vertices themselves.
    """

    def __init__(self, disk, samples=None):
        self.disk, self.samples = disk, samples

    def locate(self, f):
        """(face, weights) of the points after a map f (N,)."""
        return self.disk.locate(f if self.samples is None else self.samples @ f)


class FeatureTerm:
    """`delta sum_c a_c sum_k w_k (s_c(x_k) - t_c(M f(x_k)))^2` over the moving vertices, at scale
    sigma.

    s, t: standardised features of both sides; a: their weights; w: the vertices' shares of the
    moving area; a sum is 2 (1 - r) where features keep their variance. judges: `Features.judges`
    (None: all vertices); places: theirs, if they are not the mapped mesh's vertices.
    """

    def __init__(self, features, sigma, delta, places=None, judges=None):
        self.disk, self.places = features.disk, places or Places(features.disk)
        self.here, self.there, weights = features.compared(sigma)
        self.slopes, areas = vertex_slopes(features.disk, self.there), features.areas
        if judges is not None:
            some, areas = judges
            self.here = self.here[some]
        self.scale = np.sqrt(delta * areas[:, None] * weights)

    def residual(self, f):
        """`sqrt(delta a_c w_k) (s_c - t_c)`, (C V,), feature after feature, for a map f (N,)."""
        there = self.disk.interpolate(self.there, self.places.locate(f))
        return (self.scale * (self.here - there)).T.ravel()

    def rows(self, f):
        """Sparse complex R (C V, N): the residual changes by `Re(conj(R) df)`."""
        slopes = -self.scale * self.disk.interpolate(self.slopes, self.places.locate(f))
        rows = sparse.vstack([sparse.diags_array(column) for column in slopes.T])
        if self.places.samples is not None:
            rows = rows @ self.places.samples
        return rows.tocsr()


class AreaTerm:
    """`eta sum_T w_T (log J_T)^2`, J the areal scale of the map from surface to surface, total
    areas made equal.

    `log J_T = log(|f(T)| / |T|) + mean l_C(f(x)) - l_M(T)` over the corners x of a face T of the
    mapped mesh: l_C, l_M, log of the shares of the surfaces' area over those of their disks', are
    the control's and the moving one's densities; w_T: the share of the moving area in T. With
    `alpha |nu|^2` by the same area and eta = alpha / 4 the sum is alpha / 2 times that of the
    squared logs of both principal stretches (Hencky 1928). A face smaller than FLOOR of itself
    counts as that small: the term is a barrier before a fold, and finite.
    """

    FLOOR = 1e-3

    def __init__(self, disk, shares, moving, control, eta, places):
        """disk: the mapped mesh; shares, moving (F,): w and l_M; control (W,): l_C; places: the
        mapped vertices'."""
        self.disk, self.control, self.places = disk, control, places
        there = places.disk
        self.slopes = np.einsum("fk,fk->f", there.gradients, control[there.faces])
        self.scale = np.sqrt(eta * shares)
        self.floor = self.FLOOR * disk.areas
        self.here = moving + np.log(disk.areas)

    def log_areal(self, f):
        """log J (F,)."""
        there = self.places.disk.interpolate(self.control, self.places.locate(f))
        areas = np.maximum(self.disk.at(f).areas, self.floor)
        return np.log(areas) + there[self.disk.faces].mean(1) - self.here

    def residual(self, f):
        """`sqrt(eta w_T) log J_T` (F,) for a map f (N,)."""
        return self.scale * self.log_areal(f)

    def rows(self, f):
        """Sparse complex R (F, N): the residual changes by `Re(conj(R) df)`."""
        faces, areas = self.disk.faces, self.disk.at(f).areas
        corners = f[faces]
        growth = 0.5j * opposite_edges(corners) / np.maximum(areas, self.floor)[:, None]
        growth[areas <= self.floor] = 0  # the floor has no slope
        slopes = self.slopes[self.places.locate(f)[0]][faces] / 3
        return three_a_row(self.scale[:, None] * (growth + slopes), faces, len(f))
