"""What a registration begins with: disk maps laid upon each other, and landmarks sampled on both."""

import warnings
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.sparse import vstack

from ..plane.beltrami import cotangent_stiffness
from ..plane.bijectivity import RepairWarning, check_embedding, flipped_faces, repair
from ..plane.diskmesh import sampling_matrix
from ..plane.mobius import best_mobius, mobius
from ..plane.triangles import edge_lengths
from ..surfaces.conformal import disk_conformal_map
from ..surfaces.surface import Surface
from .checked import guarded_curves
from .features import FeatureError, Features
from .landmarks import POINTS_PER_CURVE, detect_curves, resample, sample_curve
from .problem import LandmarkError, Problem, distinct, meeting
from .search import mobius_by_features


def conformal(surface):
    """The disk conformal map of a surface (V,), and words on what was repaired, list."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z = disk_conformal_map(surface)
    return z, [str(warning.message) for warning in caught]


@dataclass(eq=False)
class Sides:
    """Two surfaces, the curves to fit and those held out (as `check_curves` returns them), and what is found of them.

    z_moving, z_control: disk maps, the moving one laid upon the control's by `lay_upon`; features: `Features` or None;
    words: what was repaired on the way.
    """

    moving: Surface
    control: Surface
    entries: list
    held: list
    z_moving: np.ndarray | None = None
    z_control: np.ndarray | None = None
    features: Features | None = None
    words: list = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of two `Sides`, ten a curve, and the `Problem` of the distinct ones.

    samples: sparse (10 K, V) of moving and control; lines: name -> (moving, control) curve in the disk; words: what
    was not detected as asked.
    """

    samples: tuple
    lines: dict
    problem: Problem
    words: list


def lay_upon(sides):
    """Lay the moving disk upon the control's by a Möbius map: of the curves' given points, or of features alone."""
    moving, control = sides.moving, sides.control
    if sides.entries:
        sides.z_moving = align(moving, sides.z_moving, control, sides.z_control, sides.entries)
    else:
        parameters = mobius_by_features(sides.features, sides.z_moving)
        sides.z_moving, whole = moved_disk(moving, sides.z_moving, parameters)
        if not whole:
            raise FeatureError("the features pull the moving disk onto its rim; give a landmark curve or two")


def sampled(sides, detect=None, sliding=False):
    """The `Landmarks` of two sides; curves of which ends alone are given by `detect`, or else the shortest paths."""
    moving, control, entries = sides.moving, sides.control, sides.entries
    if not entries:
        return Landmarks((), {}, Problem(sides.z_moving, moving.faces, [], [], fewest=0), [])
    samples_moving, lines_moving, words = sample_side(moving, sides.z_moving, entries, "moving", detect)
    samples_control, lines_control, more = sample_side(control, sides.z_control, entries, "control", detect)
    p, q = samples_moving @ sides.z_moving, samples_control @ sides.z_control
    once = distinct_landmarks(entries, p, q)
    problem = Problem(sides.z_moving, moving.faces, p[once], q[once], once // POINTS_PER_CURVE, sliding)
    lines = {entry["name"]: pair for entry, pair in zip(entries, zip(lines_moving, lines_control))}
    return Landmarks((samples_moving, samples_control), lines, problem, words + more)


def align(moving, z_moving, control, z_control, entries):
    """z_moving after the Möbius map that best carries the given points (ends or whole curves) to the control's."""
    p, q = [], []
    for entry in entries:
        whole = min(len(entry["moving"]), len(entry["control"])) > 2
        count = POINTS_PER_CURVE if whole else 2
        p.append(sample_curve(moving, entry["moving"], count) @ z_moving)
        q.append(sample_curve(control, entry["control"], count) @ z_control)
    z, whole = moved_disk(moving, z_moving, best_mobius(np.concatenate(p), np.concatenate(q)))
    if not whole:
        raise LandmarkError(
            f"curve {farthest_curve(entries, p, q)!r} pulls the moving disk onto its rim: the Möbius map "
            "that carries the given points to the control's leaves no room for the rest; check this "
            "curve's ends on both sides, keep them off the rim, or give curves elsewhere as well"
        )
    return z


def moved_disk(surface, z, parameters):
    """A disk map z (V,) after a Möbius map, mended where that folds it: (z, whether it is whole)."""
    z, loop = mobius(z, *parameters), surface.boundary
    z[loop] /= abs(z[loop])
    if not check_embedding(surface.faces, z).bijective:
        lengths = edge_lengths(surface.vertices, surface.faces)
        z, _, _ = repair(cotangent_stiffness(surface.vertices, surface.faces), surface.faces, lengths, z)
    steps = np.angle(np.roll(z[loop], -1) / z[loop])
    return z, steps.min() > 0 and not len(flipped_faces(surface.faces, z))


def farthest_curve(entries, p, q):
    """The name of the curve without which the best Möbius map of the others, points p, q a curve, moves 0 the least."""

    def shift(left_out):
        kept = [k for k in range(len(entries)) if k != left_out]
        return abs(best_mobius(*(np.concatenate([side[k] for k in kept]) for side in (p, q)))[0]) if kept else 0.0

    return entries[int(np.argmin([shift(k) for k in range(len(entries))]))]["name"]


def sample_side(surface, z, entries, side, detect=None):
    """One side's landmarks: (sampling matrix (10 K, V), list of K curves in the disk, list of words).

    Where only ends are given, by `detect` as in checked.py, or else the shortest paths.
    """
    words = []
    if detect:
        lines, words = guarded_curves(detect, surface, z, entries, side)
    else:
        ends = [entry[side] for entry in entries if entry["detect"][side]]
        found = iter(detect_curves(surface, z, ends) if ends else [])
        lines = [next(found) if entry["detect"][side] else z[entry[side]] for entry in entries]
    stops = np.cumsum([0, *map(len, lines)])
    corners = sampling_matrix(z, surface.faces, np.concatenate(lines))  # of all at once: looking up places is slow
    matrices = [resample(surface, corners[start:stop], POINTS_PER_CURVE) for start, stop in pairwise(stops)]
    return vstack(matrices).tocsr(), lines, words


def distinct_landmarks(entries, p, q):
    """Which of the landmarks (10 K,) to fit, (k,) int: a point that curves share on both sides counts once.

    LandmarkError where two of them meet on one side only.
    """
    meet_p, meet_q = meeting(p), meeting(q)
    torn = np.argwhere(meet_p != meet_q)
    if len(torn):
        first, second = (entries[k // POINTS_PER_CURVE]["name"] for k in torn[0])
        side = "moving" if meet_p[tuple(torn[0])] else "control"
        raise LandmarkError(
            f"curves {first!r} and {second!r} share a point on the {side} side only, and a bijection "
            "can neither part nor merge points; let them meet on both sides or on neither"
        )
    return distinct(p, q)
