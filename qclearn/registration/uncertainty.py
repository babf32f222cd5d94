"""Per-vertex error radius in mm: a product of powers of the Laplace spread, the distance to a
stiffer fit and the local feature mismatch, calibrated on synthetic pairs.

The Laplace approximation alone is far too confident and hardly ranks: most of the error is folds
that agree and do not correspond. book/studies/calibrate_uncertainty.py measures the factors, and
judges them on other pairs: uncertainty.json.
"""

import json
from dataclasses import replace
from functools import cached_property
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from scipy import linalg

from ..surfaces.units import size_of
from .diagnose import with_folds
from .features import FINEST, FOLDS
from .gauss_newton import MOBIUS_PRIOR, ProductStep
from .levels import GUIDES, Level, MultiresolutionFit, feature_levels, start_field
from .problem import LandmarkError
from .report import quantile

RINGS = 16  # of the polar mesh of the posterior
BATCH = 256  # unknowns whose columns are solved for at once
STIFFER = 10.0  # times beta: the second fit
BLUR = 8.0  # mm over which what is local is averaged
NEAR_MM = 0.05  # added to the distance of both fits before its log
# Powers of the posterior's spread, of the distance of the stiffer fit, both in mm, and of the local
# mismatch. A common factor on the powers of one row keeps the order of the radii; it was chosen so
# that coverage is even over small and large radii on the pairs that calibrate.
BY_FOLDS = (2 / 3, 1 / 3, 1 / 8)
BY_LANDMARKS = (0.48, 0.0, 0.24)
# Times that a weight may be off the calibrated one.
MOST = {"alpha": 4.0, "beta": 4.0, "gamma": 10.0, "delta": 4.0, "eta": 4.0}
VERTICES = 6_000, 20_000  # of a side, between which the factors are calibrated, to a thousand
BLIND = (
    "wrong valleys: a gyrus laid on its neighbour fits well, and errors beyond 10 mm mostly lie "
    "outside the radius; "
    "misses come in patches, so neighbouring vertices are right or wrong together"
)


class ErrorRadius(NamedTuple):
    """radius (V,) at factor 1, mm; vertex: where one more landmark lowers the mean radius most;
    share: to how much."""

    radius: np.ndarray
    vertex: int
    share: float


class Laplace:
    """The posterior of a fit near its answer, dense on a polar mesh of few rings: covariance `G
    H^-1 G^T` of the map.

    H = W + D^T D, W the prior and D the derivative of all residuals of the fit's own objective by
    nu and by the Möbius parameters, (K, K) with K = 2 N + 3; G (N, K) complex: the derivative of M
    f at the N nodes. mu (F,), mobius: the fit's.
    """

    def __init__(self, problem, weights, mu, mobius, features=None, rings=RINGS):
        level = Level(rings, None if features is None else FINEST, 0)
        self.objective = objective = MultiresolutionFit(problem).objective(level, weights, features)
        self.mesh = objective.coefficient_mesh.mesh
        self.state = objective.at(start_field(problem.disk, mu, self.mesh), mobius)
        step = ProductStep(objective, self.state, weights.gamma)
        self.noise = (len(problem.moving) + 1) / weights.gamma
        # G, by the pushforward of every unit change, a BATCH at a time.
        count, to_faces = 2 * len(self.mesh.z), step.to_faces.tocsc()
        self.G = G = np.empty((len(self.mesh.z), count + 3), complex)
        for first in range(0, count, BATCH):
            k = np.arange(first, min(first + BATCH, count))
            unit = to_faces[:, k // 2].toarray() * np.where(k % 2, 1j, 1.0)
            df = self.state.solution.pushforward(step.activated(unit.T))
            G[:, k] = (step.slope * df).T
        G[:, count:] = step.fields
        # H: the prior of nu and of the Möbius parameters, and the residuals' rows D.
        self.H = H = np.zeros((count + 3, count + 3))
        H[:-3:2, :-3:2] = H[1:-3:2, 1:-3:2] = objective.W.toarray()
        H[-3:, -3:] = MOBIUS_PRIOR * np.eye(3)
        a, b = step.rows.real.tocsr(), step.rows.imag.tocsr()
        re, im = G.real.copy(), G.imag.copy()
        cross = a.T @ b
        H += re.T @ ((a.T @ a) @ re + cross @ im) + im.T @ (cross.T @ re + (b.T @ b) @ im)

    @cached_property
    def covariance(self):
        """(N, N) each: covariances of Re with Re, of Re with Im, and of Im with Im of M f between
        the nodes."""
        factor = linalg.cholesky(self.H, lower=True)
        re, im = (
            linalg.solve_triangular(factor, part.T, lower=True)
            for part in (self.G.real, self.G.imag)
        )
        return re.T @ re, re.T @ im, im.T @ im

    def ellipses(self, points):
        """Covariances (P, 2, 2) of (Re M f, Im M f) at points (P,) of the moving disk."""
        rr, ri, ii = (between(part, self.mesh.interpolation(points)) for part in self.covariance)
        return np.moveaxis(np.array([[rr, ri], [ri, ii]]), -1, 0)

    def shrunk(self):
        """Share (N, N) of the mean square at node i that a landmark at node j, as precise as the
        others, leaves."""
        rr, ri, ii = self.covariance
        a, b, d = rr.diagonal() + self.noise, ri.diagonal(), ii.diagonal() + self.noise
        det = a * d - b**2
        less = (d * (rr**2 + ri.T**2) + a * (ri**2 + ii**2) - 2 * b * (rr * ri + ri.T * ii)) / det
        return 1 - less / (rr + ii).diagonal()[:, None]


def uncertainty_of(problem, weights, fit):
    """The `ErrorRadius` of a fit of a `Problem`; where no features took part, the folds judge
    alone."""
    folded, features = with_folds(problem.pair), problem.pair.features
    moving, control, areas = folded.moving, folded.control, folded.features.areas
    places = control.disk.locate(fit.f)

    # Millimetres on the control by one unit of its disk, where the map goes.
    density = control.smoothing.density(FINEST, control.disk)
    scale = np.exp(control.disk.interpolate(density, places) / 2)
    scale *= np.sqrt(control.surface.area / control.disk.areas.sum())
    scale /= size_of(control.surface).mm

    # The local mismatch of the features.
    here, there, by_map = folded.features.compared(FINEST)
    off = (here - control.disk.interpolate(there, places)) ** 2 @ by_map
    local, mean = np.maximum(blurred(moving.smoothing, off), 1e-6), areas @ off

    # The posterior's spread; its noise is the objective's own residual, where it has one.
    laplace = Laplace(problem, weights, fit.mu, fit.mobius, features)
    samples = laplace.mesh.interpolation(moving.disk.z)
    noise = mean if features is None else weights.delta * mean
    variance = between(laplace.covariance[0] + laplace.covariance[2], samples)
    by_posterior, by_fit, by_local = BY_LANDMARKS if features is None else BY_FOLDS
    logs = by_posterior * np.log(np.sqrt(noise * variance) * scale)
    if by_fit:
        distance = abs(stiffer(problem, weights, features, fit) - fit.f) * scale
        logs += by_fit * np.log(distance + NEAR_MM)
    radius = np.exp(blurred(moving.smoothing, logs)) * (local / mean) ** by_local

    # The node where one more landmark lowers the mean radius most.
    share = samples.T @ areas
    by_node = samples.T @ (areas * radius) / np.where(share > 0, share, 1)
    left = np.maximum(laplace.shrunk(), 0) ** (by_posterior / 2)
    means = (share * by_node) @ left / (share @ by_node)
    vertex = int(abs(moving.disk.z - laplace.mesh.z[means.argmin()]).argmin())
    return ErrorRadius(radius, vertex, float(means.min()))


def between(covariance, samples):
    """Variances (P,) at points between the nodes, sampled by sparse (P, N) with three nodes a row,
    from (N, N)."""
    node, share = samples.indices.reshape(-1, 3), samples.data.reshape(-1, 3)
    return np.einsum("pi,pij,pj->p", share, covariance[node[:, :, None], node[:, None, :]], share)


def blurred(smoothing, values):
    """Values (V,) averaged over BLUR."""
    return smoothing.flow(BLUR, (smoothing.mass @ values)[:, None])[:, 0]


def stiffer(problem, weights, features, fit):
    """Where a stiffer fit on the polar levels alone takes the vertices, (V,) complex.

    Without landmarks it begins at the fit: the best Möbius map may be in another valley.
    """
    levels = feature_levels(problem.disk, GUIDES)
    weights = replace(weights, beta=STIFFER * weights.beta)
    multiresolution, resumed = MultiresolutionFit(problem), None
    if not len(problem.moving):
        first = multiresolution.objective(levels[0], weights, features)
        nu = start_field(problem.disk, fit.mu, first.coefficient_mesh.mesh)
        resumed = first, first.at(nu, fit.mobius)
    objective, state, _ = multiresolution.run(levels, weights, None, features, resumed=resumed)
    return objective.moved(state)


def calibrated():
    """What book/studies/calibrate_uncertainty.py measured: uncertainty.json."""
    return json.loads(files(__package__).joinpath("uncertainty.json").read_text())


def check_uncertainty(features, method, sliding, weights):
    """LandmarkError where the factors were not measured: features of one's own, sliding, networks,
    far weights."""
    usual = calibrated()["weights"]["landmarks" if features is None else "folds"]
    own_features = features is not None and list(features) != list(FOLDS)
    for clash, name in (
        (method != "exact", f"method {method!r}"),
        (sliding, "sliding landmarks"),
        (own_features, f"other features than {', '.join(FOLDS)}"),
    ):
        if clash:
            raise LandmarkError(
                f"uncertainty: the radius is not calibrated for {name}; leave one of the two out"
            )
    for name, most in MOST.items():
        given, least = getattr(weights, name), usual[name] / most
        if not least <= given <= usual[name] * most:
            raise LandmarkError(
                f"uncertainty: {name} = {given:g} is far from the {usual[name]:g} that the radius "
                f"is calibrated for; give {least:g} to {usual[name] * most:g}, or no radius"
            )


def uncertainty_report(error, pair):
    """The 90 % radius (V,), mm, and report["uncertainty"] of an `ErrorRadius` of an aligned
    `SurfacePair`."""
    moving, control = pair.moving.surface, pair.control.surface
    measured = calibrated()["folds" if pair.features else "landmarks"]
    areas = moving.vertex_areas / moving.area
    least, most = VERTICES
    calibrated_on = measured["calibrated_on"]
    if not all(least <= round(len(side.vertices), -3) <= most for side in (moving, control)):
        calibrated_on = f"uncalibrated below {least} and beyond {most} vertices"
    radius = measured["factors"]["90"] * error.radius
    mean = float(areas @ radius)
    report = {
        "mean_mm": mean,
        "quantiles_mm": {
            str(share): quantile(radius, areas, share / 100) for share in (10, 50, 90)
        },
        "factors": measured["factors"],
        "guaranteed": measured["guaranteed"],
        "calibrated_on": calibrated_on,
        "blind_to": BLIND,
        "next": {"vertex": error.vertex, "mean_mm": mean * error.share},
    }
    return radius, report
