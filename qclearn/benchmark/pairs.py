"""The benchmark's problems: pairs of surfaces with landmark curves and, if known, the true map.

"cohort": synthetic subjects against one control. "displacement": one surface whose landmarks a
known map moves farther and farther. "fsaverage5": its mirrored right side against its left, truth
unknown. cortex.py has the other sets.
"""

import time
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import brentq

from data_synth.cohort import GENERATION, hemispheres
from data_synth.correspondence import locate_on_sphere

from ..io.fsaverage import demo_landmarks, fsaverage5, whole_fsaverage5
from ..plane.mobius import mobius, mobius_inverse
from ..registration.curves import POINTS_PER_CURVE, check_curves, curve_lines, curves_of_both
from ..registration.features import FINEST, Smoothing
from ..registration.problem import Problem
from ..registration.start import SurfacePair, align, distinct_landmarks, sample_lines
from ..surfaces.conformal import ParameterizedSurface, parameterize
from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Surface, mirror
from .methods.spheres import Sphere

# The seed of the control that the paper's CP-Net is trained for. The networks have seen it, but not
# the cohort.
CONTROL = 2001
DETECTORS = {"ldnet": "best", "ldnet_paper": "paper"}  # source of landmarks -> preset
SOURCES = ("given", "exact", "path", *DETECTORS)
TWISTS, REACH = 3, 0.5  # of a known map: their number, and their centres' largest distance from 0


@dataclass(frozen=True, eq=False)
class Mapped(ParameterizedSurface):
    """A `ParameterizedSurface` and what the benchmark knows of it.

    template (V, 3): template points of a synthetic side's vertices; seconds: of its disk map;
    folds: depth and curvature (positive on gyri) at the scale FINEST, mean 0 and variance 1 by
    area, name -> (V,).
    """

    template: np.ndarray | None = None
    seconds: float = 0.0
    folds: dict = field(default_factory=dict)


@dataclass(frozen=True)
class Pair:
    """A moving and a control surface with their landmark curves, as a landmarks file holds them.

    truth (V, 3): the moving vertices' true places on the control, mm, and truth_disk (V,) complex
    in its disk, or None. given: landmarks if not detected: "given" (both sides' curves, matched by
    arc length) or "exact" (the moving ones and their true images). held: curves that are measured
    only; maps: name -> (moving (V,), control (W,)), compared only; there_and_back: whether the way
    back is computed.
    """

    moving: Mapped
    control: Mapped
    curves: tuple
    truth: np.ndarray | None = None
    truth_disk: np.ndarray | None = None
    given: str = "given"
    held: tuple = ()
    maps: dict = field(default_factory=dict)
    there_and_back: bool = False


@dataclass(frozen=True)
class Prepared:
    """A `Problem` for the methods, and what judges their maps.

    samples (M, V): sparse, vertices -> all landmarks, shared ones once a curve; target (M,) complex
    and target_mm (M, 3): their targets; seconds, notes: of alignment and detection.
    """

    problem: Problem
    samples: object
    target: np.ndarray
    target_mm: np.ndarray
    seconds: float
    notes: list = field(default_factory=list)


def mapped_subject(seed, n_vertices, folder=None, generation=GENERATION):
    """The synthetic left hemisphere of a seed, grown or read from `folder`, `Mapped`."""
    settings = {"progress": False, "workers": 1, "generation": generation}
    (subject,) = hemispheres([seed], n_vertices, folder, **settings)
    return replace(mapped(subject.surface), template=subject.template)


def mapped(surface, whole=None):
    """A surface with its disk conformal map, timed on a warm run: `Mapped`; whole: of its sphere."""
    side = parameterize(surface)
    fresh = Surface(surface.vertices, surface.faces)  # a copy without a stiffness matrix
    start = time.perf_counter()
    parameterize(fresh)
    seconds = time.perf_counter() - start
    values = np.stack([sulcal_depth(surface), mean_curvature(surface)], axis=1)
    names = "depth", "curvature"
    folds = dict(zip(names, Smoothing(surface, names, values).at(FINEST).T))
    sphere = Sphere(surface, whole)
    return Mapped(
        surface, side.disk, messages=side.messages, sphere=sphere, seconds=seconds, folds=folds
    )


def cohort_pair(moving, control):
    """Two synthetic hemispheres with all shared curves and the template's dense correspondence."""
    disk, curves = control.disk, tuple(curves_of_both(moving.surface, control.surface))
    places = locate_on_sphere(control.template, disk.faces, moving.template)
    truth = disk.interpolate(control.surface.vertices, places)
    return Pair(moving, control, curves, truth, disk.interpolate(disk.z, places))


def displacement_pair(control, distance, n_curves, seed):
    """One surface against itself: a random known map of the disk moves its first n_curves.

    distance: the landmarks' mean distance from their targets in the unit disk, before alignment.
    """
    curves = tuple(curves_of_both(control.surface, control.surface)[:n_curves])
    p = control.disk.z[np.concatenate([curve["moving"] for curve in curves])]
    rng = np.random.default_rng([seed, n_curves])
    radii = REACH * np.sqrt(rng.uniform(size=TWISTS))
    centres = radii * np.exp(2j * np.pi * rng.uniform(size=TWISTS))
    turns = rng.uniform(0.5, 1, TWISTS) * rng.choice([-1, 1], TWISTS)

    def excess(strength):
        return abs(twisted(p, centres, strength * turns) - p).mean() - distance

    most = next(strength for strength in 2.0 ** np.arange(-3, 9) if excess(strength) > 0)
    strength = brentq(excess, 0, most, xtol=1e-3)
    moved = twisted(control.disk.z, centres, strength * turns)
    return Pair(control, control, curves, control.lift(moved), moved, "exact")


def twisted(z, centres, turns):
    """z after twists `w exp(i c (1 - |w|^2))` about several centres of the unit disk, one after the
    other."""
    for a, c in zip(centres, turns):
        w = mobius(z, a)
        z = mobius_inverse(w * np.exp(1j * c * (1 - abs(w) ** 2)), a)
    return z


def fsaverage_pair():
    """fsaverage5's mirrored right side against its left, sulci given by their ends; no truth."""
    sides = [mapped(fsaverage_surface(side), fsaverage_sphere(side)) for side in ("right", "left")]
    return Pair(*sides, tuple(demo_landmarks()["curves"]), there_and_back=True)


def fsaverage_surface(hemisphere):
    """One open side of fsaverage5, the right one mirrored."""
    return fsaverage5(hemisphere) if hemisphere == "left" else mirror(fsaverage5(hemisphere))


def fsaverage_sphere(hemisphere):
    """That side whole, the open one's vertices first, and its sphere's points, for `Sphere`."""
    open_vertices = fsaverage5(hemisphere).original_vertices
    surface, ball = (whole_fsaverage5(hemisphere, kind) for kind in ("pial", "sphere"))
    order = np.append(open_vertices, np.setdiff1d(np.arange(len(surface.vertices)), open_vertices))
    whole = Surface(surface.vertices[order], np.argsort(order)[surface.faces])
    turn = [1, 1, 1] if hemisphere == "left" else [-1, 1, 1]
    return (whole if hemisphere == "left" else mirror(whole)), ball.vertices[order] * turn


def reverse(pair):
    """The pair for the way back: sides exchanged, no truth, nothing held out."""
    curves = [c | {"moving": c["control"], "control": c["moving"]} for c in pair.curves]
    return Pair(pair.control, pair.moving, tuple(curves))


def prepare(pair, source="given"):
    """A pair's landmarks as a `Prepared` problem; they align the moving disk as in `register`.

    source: "given"; "exact" (the moving curves and their true images); or moving curves detected
    between their ends: "path" (the shortest), "ldnet" or "ldnet_paper". The control keeps its
    curves where it has more than ends.
    """
    source = pair.given if source == "given" else source
    moving, control = pair.moving.surface, pair.control.surface
    curves = pair.curves
    if source not in ("given", "exact"):
        ends = [[c["moving"][0], c["moving"][-1]] for c in curves]
        curves = [c | {"moving": two, "detect": True} for c, two in zip(curves, ends)]
    detect = None
    if source in DETECTORS:
        from ..nets import load  # here, as it needs torch

        detect = load("ldnet", DETECTORS[source]).detect
    start = time.perf_counter()
    fitted = check_curves(list(curves), moving, control)
    held = check_curves(list(pair.held), moving, control, 0)
    own = align(pair.moving, pair.control, fitted)
    lines, notes = curve_lines(own, fitted, "moving", detect)
    samples = sample_lines(own, lines)
    if source == "exact":
        target = samples @ pair.truth_disk
        target_mm = pair.control.lift(target)
    else:
        lines, more = curve_lines(pair.control, fitted, "control", detect)
        samples_control = sample_lines(pair.control, lines)
        notes = notes + more
        target = samples_control @ pair.control.disk.z
        target_mm = samples_control @ control.vertices
    p = samples @ own.disk.z
    once = distinct_landmarks(fitted, p, target)
    sides = SurfacePair(pair.moving, pair.control, fitted, held)
    problem = Problem(own.disk, p[once], target[once], once // POINTS_PER_CURVE, pair=sides)
    return Prepared(problem, samples, target, target_mm, time.perf_counter() - start, notes)
