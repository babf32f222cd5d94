"""The Möbius map by features alone: where to begin without landmarks."""

import numpy as np

from ..plane.mobius import compose_mobius, mobius, mobius_fields
from .terms import Image

SCALE = 16.0  # mm, of the features that are compared
TURNS, RADII, DIRECTIONS = 24, (0.25, 0.5), 8  # of the maps to begin with: angles, and which points they send to 0
SCOUTS, POINTS = 300, 1500  # vertices that judge these maps, and those that the best are refined by
BEST, ROUNDS = 6, 15  # how many are refined, in how many steps
DAMPING = 1e-2  # of the first step, in parts of the normal matrix


def mobius_by_features(features, z, near=False):
    """(a, theta) of the disk Möbius map after which the features of a moving disk z (V,) match best, at SCALE.

    The best of many maps on a few vertices, drawn by area, refined by damped Gauss-Newton steps on more of them; near:
    the identity alone is refined.
    """
    inner = np.flatnonzero(abs(z) < 0.999)  # the others leave the control's polygon
    share = features.areas[inner] / features.areas[inner].sum()
    some = np.random.default_rng(0).choice(inner, POINTS, p=share)
    match = Match(features, z, some)
    if near:
        return match.refined((0j, 0.0))
    centres = [0j, *np.multiply.outer(RADII, np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)).ravel()]
    starts = [(a, turn) for a in centres for turn in 2 * np.pi * np.arange(TURNS) / TURNS]
    scouts = Match(features, z, some[:SCOUTS])
    found = [scouts.misfit(start) for start in starts]
    refined = [match.refined(starts[k]) for k in np.argsort(found, kind="stable")[:BEST]]
    return min(refined, key=match.misfit)


class Match:
    """How well features match at some vertices of a moving disk z (V,) after a Möbius map."""

    def __init__(self, features, z, some):
        here, there = features.at(SCALE)
        self.lookup, self.image, self.z = features.disk.lookup, Image(features.disk, there), z[some]
        self.shares, self.here = np.sqrt(features.shares / len(some)), here[some]

    def residual(self, places):
        return (self.shares * (self.here - self.image.at(places))).ravel()

    def misfit(self, parameters):
        """Mean square of the difference after the Möbius map (a, theta)."""
        return (self.residual(self.lookup(mobius(self.z, *parameters))) ** 2).sum()

    def refined(self, parameters):
        """(a, theta) after damped Gauss-Newton steps from there: increments that follow the map."""
        damping, cost = DAMPING, self.misfit(parameters)
        for _ in range(ROUNDS):
            w = mobius(self.z, *parameters)
            places = self.lookup(w)
            slopes = self.shares * self.image.slopes(places)
            J = -(slopes.conj()[:, :, None] * mobius_fields(w)[:, None]).real.reshape(-1, 3)
            normal = J.T @ J
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -J.T @ self.residual(places))
            shift = complex(step[1], step[2])
            found = compose_mobius(parameters, (shift / np.sqrt(1 + abs(shift) ** 2), step[0]))
            lower = (now := self.misfit(found)) < cost
            damping *= 0.2 if lower else 10.0
            if lower:
                parameters, cost = found, now
        return parameters
