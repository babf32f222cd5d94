"""What a registration begins with: two sides laid upon each other, and landmarks sampled on both."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.sparse import vstack

from ..plane.mobius import best_mobius
from ..surfaces.conformal import ParameterizedSurface, apply_mobius
from .curves import POINTS_PER_CURVE, checked_curves, detect_curves, resample, sample_curve
from .features import FeatureError, Features, mobius_by_features
from .problem import LandmarkError, Problem, distinct, meeting


@dataclass(frozen=True, eq=False)
class SurfacePair:
    """Two `ParameterizedSurface`s, the curves to fit and those held out, as `check_curves` returns
    them, and features or None."""

    moving: ParameterizedSurface
    control: ParameterizedSurface
    entries: list
    held: list
    features: Features | None = None

    @property
    def words(self):
        """What was repaired when the two were laid out."""
        return [
            f"{name}: {word}"
            for name in ("moving", "control")
            for word in getattr(self, name).messages
        ]


@dataclass(frozen=True, eq=False)
class SampledLandmarks:
    """The landmarks of two `SurfacePair`, ten a curve, and the `Problem` of the distinct ones;
    samples: sparse (10 K, V), moving and control; lines: name -> (moving, control) curve; words: on
    failed detection."""

    samples: tuple
    lines: dict
    problem: Problem
    words: list


def align_disks(sides):
    """The sides with the moving disk laid upon the control's by a Möbius map of given points, or of
    features alone."""
    if sides.entries:
        return replace(sides, moving=align(sides.moving, sides.control, sides.entries))
    laid = apply_mobius(sides.moving, mobius_by_features(sides.features, sides.moving.disk.z))
    if not laid.whole:
        raise FeatureError(
            "the features pull the moving disk onto its rim; give a landmark curve or two"
        )
    return replace(sides, moving=laid)


def sample_landmarks(sides, detect=None, sliding=False):
    """The landmarks of two `SurfacePair`, `SampledLandmarks`; where only ends are given, by
    `detect` or else shortest paths."""
    moving, control, entries = sides.moving, sides.control, sides.entries
    if not entries:
        return SampledLandmarks((), {}, Problem(moving.disk, [], [], fewest=0, sides=sides), [])
    samples_moving, lines_moving, words = sample_curves(moving, entries, "moving", detect)
    samples_control, lines_control, more = sample_curves(control, entries, "control", detect)
    p, q = samples_moving @ moving.disk.z, samples_control @ control.disk.z
    once = distinct_landmarks(entries, p, q)
    problem = Problem(moving.disk, p[once], q[once], once // POINTS_PER_CURVE, sliding, sides=sides)
    lines = {entry["name"]: pair for entry, pair in zip(entries, zip(lines_moving, lines_control))}
    return SampledLandmarks((samples_moving, samples_control), lines, problem, words + more)


def align(moving, control, entries):
    """The moving `ParameterizedSurface` after the Möbius map that best carries given points (ends
    or whole curves) to the control's."""
    p, q = [], []
    for entry in entries:
        whole = min(len(entry["moving"]), len(entry["control"])) > 2
        count = POINTS_PER_CURVE if whole else 2
        p.append(sample_curve(moving.surface, entry["moving"], count) @ moving.disk.z)
        q.append(sample_curve(control.surface, entry["control"], count) @ control.disk.z)
    laid = apply_mobius(moving, best_mobius(np.concatenate(p), np.concatenate(q)))
    if not laid.whole:
        raise LandmarkError(
            f"curve {farthest_curve(entries, p, q)!r} pulls the moving disk onto its rim: no room "
            "is left for the "
            "rest; check this curve's ends on both sides, keep them off the rim, or give curves "
            "elsewhere as well"
        )
    return laid


def farthest_curve(entries, p, q):
    """The name of the curve without which the best Möbius map of the others' points p, q moves 0
    the least."""

    def shift(left_out):
        kept = [k for k in range(len(entries)) if k != left_out]
        return (
            abs(best_mobius(*(np.concatenate([side[k] for k in kept]) for side in (p, q)))[0])
            if kept
            else 0.0
        )

    return entries[int(np.argmin([shift(k) for k in range(len(entries))]))]["name"]


def sample_curves(own, entries, side, detect=None):
    """The landmarks of a `ParameterizedSurface`, "moving" or "control": sampling matrix (10 K, V),
    K curves in the disk, words."""
    surface, z, words = own.surface, own.disk.z, []
    if detect:
        lines, words = checked_curves(detect, own, entries, side)
    else:
        ends = [entry[side] for entry in entries if entry["detect"][side]]
        found = iter(detect_curves(surface, z, ends) if ends else [])
        lines = [next(found) if entry["detect"][side] else z[entry[side]] for entry in entries]
    stops = np.cumsum([0, *map(len, lines)])
    corners = own.disk.sampling(np.concatenate(lines))  # of all at once: looking up places is slow
    matrices = [
        resample(surface, corners[start:stop], POINTS_PER_CURVE) for start, stop in pairwise(stops)
    ]
    return vstack(matrices).tocsr(), lines, words


def distinct_landmarks(entries, p, q):
    """The landmarks of (10 K,) to fit, (k,) int: `distinct`, or LandmarkError where two meet on one
    side only."""
    meet_p, meet_q = meeting(p), meeting(q)
    torn = np.argwhere(meet_p != meet_q)
    if len(torn):
        first, second = (entries[k // POINTS_PER_CURVE]["name"] for k in torn[0])
        side = "moving" if meet_p[tuple(torn[0])] else "control"
        found = f"curves {first!r} and {second!r} share a point on the {side} side only"
        raise LandmarkError(
            f"{found}, and a bijection cannot part points; let them meet on both sides or on "
            "neither"
        )
    return distinct(p, q)
