"""The pipeline: two cortical surfaces and their landmark curves in, a certified point-to-point map out."""

import time
import warnings
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy.sparse import vstack
from tqdm import tqdm

from ..plane.beltrami import cotangent_stiffness
from ..plane.bijectivity import RepairWarning, check_embedding, flipped_faces, repair
from ..plane.diskmesh import sampling_matrix
from ..plane.mobius import best_mobius, mobius
from ..plane.triangles import edge_lengths
from ..surfaces.checks import degenerate_faces
from ..surfaces.conformal import disk_conformal_map
from ..surfaces.surface import Surface, require_disk, require_outward
from .checked import TOLERANCE, bijective_fit, gamma_words, guarded_curves, predicted, refined, unfolded
from .landmarkfile import check_curves
from .landmarks import POINTS_PER_CURVE, detect_curves, resample, sample_curve
from .metrics import coefficient_statistics, mean_rows
from .problem import LandmarkError, Problem, Weights, distinct, meeting
from .suspect import reasons
from .transfer import error_rows, lift

STAGES = {"exact": 5, "network": 9}


@dataclass(frozen=True)
class Registration:
    """Result of `register`.

    points: where each moving vertex lies on the control surface, in its length unit; disk_map: the same in the
    control's disk; mu: measured coefficient of disk_moving -> disk_map; report: dict for JSON; disk_moving,
    disk_control: the two disk maps; curves: name -> (moving, control) curves in their disks, (k,) complex each.
    """

    points: Float[ndarray, " V 3"]
    disk_map: Complex[ndarray, " V"]
    mu: Complex[ndarray, " F"]
    report: dict
    disk_moving: Complex[ndarray, " V"]
    disk_control: Complex[ndarray, " W"]
    curves: dict
    faces_moving: Integer[ndarray, " F 3"]
    faces_control: Integer[ndarray, " G 3"]

    @property
    def surface(self) -> "Unchecked":
        """The moving surface's faces at the registered points, for `write_surface`: an `Unchecked` surface."""
        return Unchecked(self.points, self.faces_moving)


class Unchecked(NamedTuple):
    """A surface that no rule of `Surface` has judged: a face that lands on one edge of the control has no area
    there."""

    vertices: np.ndarray
    faces: np.ndarray
    curves: Mapping = MappingProxyType({})
    original_vertices: np.ndarray | None = None


class Stages:
    """Seconds per named stage, shown as a progress bar once they add up to more than two."""

    def __init__(self, count, progress):
        self.seconds = {}
        self.bar = tqdm(total=count, delay=2, disable=not progress, leave=False)

    @contextmanager
    def __call__(self, name):
        self.bar.set_description(name, refresh=False)
        start = time.perf_counter()
        try:
            yield
        except BaseException:
            self.bar.close()  # so that the message about what went wrong starts a line of its own
            raise
        self.seconds[name] = round(time.perf_counter() - start, 4)
        self.bar.update()

    def report(self):
        self.bar.close()
        return {**self.seconds, "total": round(sum(self.seconds.values()), 4)}


def register(
    moving: Surface,
    control: Surface,
    curves: dict | list,
    method: str = "exact",
    alpha: float = 1.0,
    beta: float = 1e-2,
    gamma: float = 1e5,
    sliding: bool = False,
    progress: bool = False,
    tolerance: float | None = None,
) -> Registration:
    """Register the moving surface to the control surface along landmark curves: a Registration, certified bijective.

    curves: the landmarks file as read from JSON, `{"curves": [{"name", "moving", "control"}, ...]}` with vertex
    indices (two on a side are endpoints and that side's curve is detected, unless "detect" is false), or its list. A
    file that names its "surfaces" is refused for others (`fingerprint` in provenance.py says by what they are known).
    alpha, beta, gamma: weights of |mu|, of its gradient and of the landmark mismatch (paper, eq. RegLoss).
    method: "exact" (shortest paths, Gauss-Newton fit, exact solver) or "network" (LD-Net, CP-Net, DBS-Net, whose map is
    replaced by the exact solver's where it folds and refined by Gauss-Newton steps where its landmark error in the
    disk exceeds `tolerance`: 5e-3 unless given, inf to take what comes). What was done is in `report["fallbacks"]`;
    `report["suspect"]` lists why the result should not be trusted, empty where nothing is (see suspect.py).
    Both surfaces must be outward-oriented disks of the same handedness (`mirror` one of them otherwise).
    Errors: SurfaceError, LandmarkError; BijectivityError if no bijective map was found at any gamma; ImportError if
    the networks are asked for and torch is not installed.
    """
    tolerance = check_method(method, sliding, tolerance)
    weights = Weights(alpha, beta, gamma)
    for surface in (moving, control):
        require_disk(surface)
        require_outward(surface)
    entries = check_curves(curves, moving, control)
    stages, detect, before = Stages(STAGES[method], progress), None, []
    if method == "network":
        with stages("load"):
            detect, predict, solve = load("ldnet").detect, load("cpnet").predict, load("dbsnet").solve
            before += gamma_words(load("cpnet"), weights)
    with stages("disk_moving"):
        z_moving, words_moving = conformal(moving)
    with stages("disk_control"):
        z_control, words_control = conformal(control)
    before += [f"moving: {word}" for word in words_moving] + [f"control: {word}" for word in words_control]
    with stages("detect"):
        z_moving = align(moving, z_moving, control, z_control, entries)
        samples_moving, lines_moving, found_moving = sample_side(moving, z_moving, entries, "moving", detect)
        samples_control, lines_control, found_control = sample_side(control, z_control, entries, "control", detect)
    p, q = samples_moving @ z_moving, samples_control @ z_control
    once = distinct_landmarks(entries, p, q)
    problem = Problem(z_moving, moving.faces, p[once], q[once], once // POINTS_PER_CURVE, sliding)
    if method == "network":  # `guarded_map`, by its parts
        with stages("predict"):
            mu = predicted(predict, problem, weights)
        with stages("solve"):
            f = solve(problem.z, problem.faces, mu)
        with stages("certify"):
            fit = unfolded(problem, mu, f)
        with stages("refine"):
            fit = refined(problem, weights, mu, fit, tolerance)
    else:
        with stages("map"):
            fit = bijective_fit(problem, weights)
    with stages("pull_back"):
        points = lift(control, z_control, fit.f)
        rows = error_rows(moving, control, z_moving, z_control, entries, (samples_moving, samples_control), fit.f)
    report = {
        **mean_rows(rows),
        **coefficient_statistics(fit.mu),
        "flipped": len(fit.flipped),
        "bijective": fit.bijective,
        "degenerate": len(degenerate_faces(points, moving.faces)),
        "fallbacks": [*before, *found_moving, *found_control, *fit.fallbacks],
        "seconds": stages.report(),
        "method": method,
        "alpha": alpha,
        "beta": beta,
        "gamma": gamma,
        **({"tolerance": tolerance if np.isfinite(tolerance) else None} if method == "network" else {}),
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": rows,
        "suspect": reasons(moving, control, z_moving, z_control, entries, rows, fit),
        "version": version("qclearn"),
    }
    lines = {entry["name"]: pair for entry, pair in zip(entries, zip(lines_moving, lines_control))}
    return Registration(points, fit.f, fit.mu, report, z_moving, z_control, lines, moving.faces, control.faces)


def check_method(method, sliding, tolerance):
    """The tolerance to use, or ValueError where method, sliding and tolerance do not go together."""
    if method not in STAGES:
        raise ValueError(f"unknown method {method!r}; this version has: {', '.join(STAGES)}")
    if method == "exact" and tolerance is not None:
        raise ValueError(
            "tolerance belongs to method 'network'; the exact fit steps until it settles: raise gamma for "
            "a smaller landmark error"
        )
    if method == "network" and sliding:
        raise ValueError("sliding belongs to method 'exact': CP-Net takes points to points")
    tolerance = TOLERANCE if tolerance is None else tolerance
    if not tolerance > 0:
        raise ValueError(f"tolerance = {tolerance}: give a positive landmark error in the unit disk, or inf")
    return tolerance


def load(name, preset="best", gamma=None):
    """A network with its shipped weights; WeightsError if there are none, ImportError where torch is not installed."""
    from ..nets import load as load_network

    return load_network(name, preset, gamma)


def conformal(surface):
    """The disk conformal map of a surface (V,), and words on what was repaired, list."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z = disk_conformal_map(surface)
    return z, [str(warning.message) for warning in caught]


def align(moving, z_moving, control, z_control, entries):
    """z_moving after the Möbius map that best carries the given points (ends or whole curves) to the control's."""
    p, q = [], []
    for entry in entries:
        whole = min(len(entry["moving"]), len(entry["control"])) > 2
        count = POINTS_PER_CURVE if whole else 2
        p.append(sample_curve(moving, entry["moving"], count) @ z_moving)
        q.append(sample_curve(control, entry["control"], count) @ z_control)
    z = mobius(z_moving, *best_mobius(np.concatenate(p), np.concatenate(q)))
    z[moving.boundary] /= abs(z[moving.boundary])
    if not check_embedding(moving.faces, z).bijective:
        lengths = edge_lengths(moving.vertices, moving.faces)
        z, _, _ = repair(cotangent_stiffness(moving.vertices, moving.faces), moving.faces, lengths, z)
    steps = np.angle(np.roll(z[moving.boundary], -1) / z[moving.boundary])
    if steps.min() <= 0 or len(flipped_faces(moving.faces, z)):
        raise LandmarkError(
            f"curve {farthest_curve(entries, p, q)!r} pulls the moving disk onto its rim: the Möbius map "
            "that carries the given points to the control's leaves no room for the rest; check this "
            "curve's ends on both sides, keep them off the rim, or give curves elsewhere as well"
        )
    return z


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
