"""What a registration begins with: two aligned surfaces and the landmarks sampled on both."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Complex
from numpy import ndarray
from scipy.sparse import vstack

from ..plane.mobius import best_mobius, mobius
from ..surfaces.conformal import ParameterizedSurface, apply_mobius
from .curves import POINTS_PER_CURVE, curve_lines, resample, sample_curve
from .features import Directions, FeatureError, Features, mobius_by_features
from .problem import LandmarkError, Problem, distinct, meeting


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two `ParameterizedSurface`s, the `Curve`s to fit, those held out, and `Features` or None."""

    moving: ParameterizedSurface
    control: ParameterizedSurface
    curves: list
    held: list
    features: Features | None = None

    @cached_property
    def directions(self):
        """The features' `Directions`, which lay the surfaces on each other by places in space."""
        return Directions(self.features, self.moving.surface, self.control.surface)

    @property
    def messages(self):
        """What was repaired in the two disk maps."""
        return [
            f"{name}: {message}"
            for name in ("moving", "control")
            for message in getattr(self, name).messages
        ]


@dataclass(frozen=True, eq=False)
class SampledLandmarks:
    """The landmarks of a `SurfacePair`: ten per curve, equally spaced by arc length, ends included.

    problem: the `Problem` of the distinct ones; samples: sparse (10 K, V) and (10 K, W), moving and
    control; mobius_before: (a, theta) of the best Möbius map of all 10 K, with the least `mean
    |M(p) - q|^2`, the identity without curves; a report's `_before` is after it (a fit begins at
    `Problem.mobius`, of the distinct ones); lines, held: name -> (moving, control) line of a fitted
    or held-out curve in the disks; messages: on failed detection.
    """

    problem: Problem
    samples: tuple
    mobius_before: tuple
    lines: dict
    held: dict
    messages: list

    @cached_property
    def map_before(self) -> Complex[ndarray, " V"]:
        """The moving vertices after `mobius_before`."""
        return mobius(self.problem.disk.z, *self.mobius_before)


def align_disks(pair):
    """The pair with its moving disk aligned to the control's by a Möbius map: of the points that
    its curves give, or without curves of its features."""
    if pair.curves:
        return replace(pair, moving=align(pair.moving, pair.control, pair.curves))
    parameters = mobius_by_features(pair.features, pair.moving.disk.z)
    moving = apply_mobius(pair.moving, parameters)
    if not moving.is_embedded:
        raise FeatureError(
            "the features pull the moving disk onto its rim; give a landmark curve or two"
        )
    return replace(pair, moving=moving)


def align(moving, control, curves):
    """The moving `ParameterizedSurface` after the Möbius map that best carries the given points of
    `Curve`s to the control's: of their ends, or of whole paths where both sides have these. It
    changes the disk itself; the best Möbius maps of a `Problem` and of `SampledLandmarks` come
    after it."""
    p, q = [], []
    for curve in curves:
        whole = min(len(curve.moving), len(curve.control)) > 2
        count = POINTS_PER_CURVE if whole else 2
        p.append(sample_curve(moving.surface, curve.moving, count) @ moving.disk.z)
        q.append(sample_curve(control.surface, curve.control, count) @ control.disk.z)
    aligned = apply_mobius(moving, best_mobius(np.concatenate(p), np.concatenate(q)))
    if not aligned.is_embedded:
        raise LandmarkError(
            f"curve {farthest_curve(curves, p, q)!r} pulls the moving disk onto its rim: no room "
            "is left for the rest; check this curve's ends on both sides, keep them off the rim, "
            "or give curves elsewhere as well"
        )
    return aligned


def farthest_curve(curves, p, q):
    """The name of the curve without which the best Möbius map of the other curves' points p, q
    (lists of arrays) moves 0 the least."""

    def shift(left_out):
        others = [k for k in range(len(curves)) if k != left_out]
        if not others:
            return 0.0
        a, _ = best_mobius(*(np.concatenate([side[k] for k in others]) for side in (p, q)))
        return abs(a)

    return curves[int(np.argmin([shift(k) for k in range(len(curves))]))].name


def sample_landmarks(pair, detect=None, sliding=False):
    """The `SampledLandmarks` of an aligned `SurfacePair`; where only a curve's ends are given, the
    path between them is detected by `detect`, or else a shortest path."""
    moving = pair.moving
    control = pair.control
    held, _ = lines_by_name(pair, pair.held)
    if not pair.curves:
        problem = Problem(moving.disk, [], [], fewest=0, pair=pair)
        return SampledLandmarks(problem, (), problem.mobius, {}, held, [])
    lines, messages = lines_by_name(pair, pair.curves, detect)
    lines_moving, lines_control = zip(*lines.values())
    samples = sample_lines(moving, lines_moving), sample_lines(control, lines_control)
    p = samples[0] @ moving.disk.z
    q = samples[1] @ control.disk.z
    # A point that curves share is one landmark of the fit.
    once = distinct_landmarks(pair.curves, p, q)
    problem = Problem(moving.disk, p[once], q[once], once // POINTS_PER_CURVE, sliding, pair=pair)
    return SampledLandmarks(problem, samples, best_mobius(p, q), lines, held, messages)


def lines_by_name(pair, curves, detect=None):
    """name -> (moving, control) line of `Curve`s in both disks of a pair, and messages."""
    moving, messages = curve_lines(pair.moving, curves, "moving", detect)
    control, more = curve_lines(pair.control, curves, "control", detect)
    names = [curve.name for curve in curves]
    return dict(zip(names, zip(moving, control))), messages + more


def sample_lines(own, lines):
    """Landmarks of K lines in the disk of a `ParameterizedSurface`: sparse (10 K, V)."""
    stops = np.cumsum([0, *map(len, lines)])
    corners = own.disk.interpolation(
        np.concatenate(lines)
    )  # of all at once: looking up places is slow
    matrices = [
        resample(own.surface, corners[start:stop], POINTS_PER_CURVE)
        for start, stop in pairwise(stops)
    ]
    return vstack(matrices).tocsr()


def distinct_landmarks(curves, p, q):
    """The landmarks of (10 K,) to fit, (k,) int: `distinct`, or LandmarkError where two meet on one
    side only."""
    meet_p = meeting(p)
    torn = np.argwhere(meet_p != meeting(q))
    if len(torn):
        first, second = (curves[k // POINTS_PER_CURVE].name for k in torn[0])
        side = "moving" if meet_p[tuple(torn[0])] else "control"
        raise LandmarkError(
            f"curves {first!r} and {second!r} share a point on the {side} side only, and a "
            "bijection cannot part points; let them meet on both sides or on neither"
        )
    return distinct(p, q)
