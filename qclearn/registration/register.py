"""The pipeline: two cortical surfaces and their landmark curves in, a certified point-to-point map
out."""

import time
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from tqdm import tqdm

from ..interrupts import signals_wait
from ..moved import gone
from ..surfaces.conformal import parameterize
from ..surfaces.surface import Mesh, Surface, require_disk, require_outward
from .curves import check_curves, held_apart
from .diagnose import diagnose_landmarks
from .features import FOLDS, check_features, featured
from .fit import checked, fit_with_fallbacks
from .networks import TOLERANCE, certified_network_map, predicted
from .problem import DELTA, DELTA_BY_DISKS, ETA, LandmarkError, Weights
from .report import report_of
from .start import SurfacePair, align_disks, sample_landmarks
from .uncertainty import check_uncertainty, uncertainty_of, uncertainty_report

STAGES = {"exact": (6, 7), "network": (10, 9)}  # how many run without and with features


@dataclass(frozen=True)
class Registration:
    """Result of `register`.

    points: the moving vertices on the control surface, in its unit of length; disk_map: the same in
    the control's disk; mu: measured coefficient of disk_moving -> disk_map; report: dict for JSON;
    disk_moving: the moving disk map, aligned to the control's by a Möbius map; disk_control: the
    control's; curves: name -> (moving, control) curves in these disks, (k,) complex each;
    uncertainty: the radius, mm, within which nine in ten vertices' true points lie, if it was asked
    for.
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
    uncertainty: Float[ndarray, " V"] | None = None

    @property
    def surface(self) -> Mesh:
        """The moving surface's faces at the registered points, for `write_surface`."""
        return Mesh(self.points, self.faces_moving)


class Stages:
    """Seconds per named stage, shown as a progress bar once they add up to more than two."""

    def __init__(self, count, progress):
        self.seconds = {}
        self.bar = tqdm(total=count, delay=2, disable=not progress or None, leave=False)

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
    alpha: float = Weights.alpha,
    beta: float = Weights.beta,
    gamma: float = Weights.gamma,
    sliding: bool = False,
    progress: bool = False,
    tolerance: float | None = None,
    features: list | tuple | None = FOLDS,
    delta: float | None = None,
    hold_out: list | tuple = (),
    annotations: None = None,
    eta: float | None = None,
    uncertainty: bool = False,
    accept_suspect: bool = False,
) -> Registration:
    """Register the moving surface to the control by landmark curves and folds: a Registration,
    certified bijective. Both must be outward-oriented disks of the same handedness (`mirror` one of
    them otherwise).

    curves: the landmarks file as read from JSON, or its list of `{"name", "moving", "control"}`
    with vertex indices. Two indices on a side are endpoints, and that side's curve is detected,
    unless "detect" is false. A file that names its "surfaces" by `Surface.fingerprint` is refused
    for others. With features, curves may be empty.

    method: "exact" (shortest paths, Gauss-Newton fit, exact solver) or "network" (LD-Net, CP-Net,
    DBS-Net). The exact solver replaces a network's map that folds, and Gauss-Newton steps refine
    one whose landmark error in the disk exceeds `tolerance`: 5e-3 unless given, inf to take what
    comes. With features, the fit starts from CP-Net's answer.

    alpha, beta, gamma: weights of |mu|, of its gradient and of the landmark mismatch (paper, eq.
    RegLoss); delta: of the features' mismatch, the sum of squared differences of standardised maps
    over the area, 2 (1 - r) per map; eta: of the areal term mean (log J)^2, J the map's areal scale
    from surface to surface. With eta = 0 only areas in the disks count, as in the paper. None:
    DELTA (3) and ETA (3.5) with features, DELTA_BY_DISKS (1) where eta is 0; without features 0.

    features: per-vertex maps that the map matches between the curves. "depth", "curvature" and
    "potential" (of the curvature) are computed, a pair of arrays (V,) and (W,) is the user's own,
    and (pair, weight) has a weight other than 1. None: landmarks alone, the paper's setting.

    hold_out: names of curves (or `"hold_out": true` in the file) that are measured and not fitted.
    uncertainty: also a radius in mm at each moving vertex, calibrated where the truth is known
    (uncertainty.py): `result.uncertainty` and `report["uncertainty"]`.
    sliding: inner points of a curve may move along their target curve. progress: show a bar.
    accept_suspect: fit wrong landmarks, too. By default landmarks that are swapped, reversed,
    mirrored, exchanged, of another numbering or place are reported before the fit, and the result
    is the aligned map (`report["stopped"]`).

    Lengths in the report are in mm, also of surfaces in metres or micrometres, which are suspect.
    Where the control is as long as no hemisphere, they are relative to its length
    (`report["units"]`).

    `report["fallbacks"]` lists what was done besides, `report["suspect"]` why not to trust the
    result (diagnose.py). Errors: ValueError for a method or tolerance that do not go together;
    SurfaceError, LandmarkError (also for an uncertainty at settings in which it was not measured),
    FeatureError; BijectivityError if no map is bijective at any gamma; ImportError if the networks
    are asked for and torch is not installed.
    """
    # All that can be refused is refused here, before any work.
    if annotations is not None:
        raise ValueError(gone("register(annotations=)"))
    tolerance, weights = check_options(
        method, sliding, tolerance, features, Weights(alpha, beta, gamma), delta, eta, uncertainty
    )
    fitted, held = given_curves(moving, control, curves, method, features, hold_out)
    stages = Stages(STAGES[method][features is not None] + uncertainty, progress)
    networks = {}
    if method == "network":
        with stages("load"):
            with signals_wait():
                from ..nets import load  # here, as it needs torch

            names = ["ldnet", "cpnet", "dbsnet"][: 3 if features is None else 2]
            networks = {name: load(name) for name in names}

    # Each surface goes to the unit disk by its conformal map; features are compared there.
    with stages("disk_moving"):
        here = parameterize(moving)
    with stages("disk_control"):
        there = parameterize(control)
    compared = None
    if features is not None:
        with stages("features"):
            maps = check_features(features, moving, control)
            here, there, compared = featured(here, there, maps)

    # A Möbius map aligns the moving disk: by the curves' ends, else by the features. It shows
    # whether the landmarks are wrong, and then nothing else is computed.
    with stages("align"):
        pair = align_disks(SurfacePair(here, there, fitted, held, compared))
        wrong = diagnose_landmarks(pair)
    stopped = bool(wrong) and not accept_suspect
    if stopped:
        pair, networks = replace(pair, held=[], features=None), {}

    # Sulci are detected between their ends, and each curve gives ten landmarks.
    with stages("detect"):
        problem = sample_landmarks(pair, networks["ldnet"].detect if networks else None, sliding)
        pair = problem.pair

    # The map is fitted, or predicted by the networks, and certified.
    if stopped:
        with stages("map"):
            fit = checked(problem, pair.moving.disk.z, (0j, 0.0))
    elif networks and features is None:
        predict, solve = networks["cpnet"].predict, networks["dbsnet"].solve
        fit = certified_network_map(predict, solve, problem, weights, tolerance, stages)
    else:
        start = None
        if networks:
            with stages("predict"):
                start = predicted(networks["cpnet"].predict, problem, weights)
        with stages("map"):
            fit = fit_with_fallbacks(problem, weights, start, 0.0, pair.features)

    # The inverse of the control's disk map takes the vertices to the control, where we measure.
    with stages("pull_back"):
        points = pair.control.lift(fit.f)
        report = {"method": method} | report_of(pair, weights, fit, points, wrong, stopped)
    if networks and features is None:  # JSON knows no infinity
        report["tolerance"] = tolerance if np.isfinite(tolerance) else None

    # Where it is asked for: how far the points may be off.
    radius = None
    if uncertainty and not stopped:
        with stages("uncertainty"):
            spread = uncertainty_of(problem, weights, fit)
            radius, report["uncertainty"] = uncertainty_report(spread, pair)
    report["seconds"] = stages.report()
    return Registration(
        points=points,
        disk_map=fit.f,
        mu=fit.mu,
        report=report,
        disk_moving=pair.moving.disk.z,
        disk_control=pair.control.disk.z,
        curves=pair.lines,
        faces_moving=pair.moving.disk.faces,
        faces_control=pair.control.disk.faces,
        uncertainty=radius,
    )


def check_options(method, sliding, tolerance, features, weights, delta, eta, uncertainty):
    """The tolerance and the `Weights` to use, delta and eta those by default where they are None;
    ValueError or LandmarkError where the options do not go together."""
    if method not in STAGES:
        raise ValueError(f"unknown method {method!r}; this version has: {', '.join(STAGES)}")
    if method == "exact" and tolerance is not None:
        raise ValueError("tolerance belongs to method 'network': raise gamma for a smaller error")
    if features is not None and tolerance is not None:
        raise ValueError(
            "tolerance belongs to the networks' map by landmarks alone, not to features: drop one "
            "of the two"
        )
    if method == "network" and sliding:
        raise ValueError("sliding belongs to method 'exact': CP-Net takes points to points")
    tolerance = TOLERANCE if tolerance is None else float(tolerance)
    if not tolerance > 0:
        raise ValueError(f"tolerance = {tolerance}: give a positive error in the disk, or inf")
    # Areas and features have a weight by default where features take part.
    if eta is None:
        eta = ETA if features is not None else 0.0
    elif eta and method == "network" and features is None:
        raise LandmarkError(
            f"eta = {eta:g} and the networks alone: they know no areas; give features, or eta=0"
        )
    if delta is None:
        delta = DELTA if eta else DELTA_BY_DISKS
    weights = replace(weights, delta=delta, eta=eta)
    if features is None:
        weights = replace(weights, delta=0.0)
    elif delta == 0:
        raise LandmarkError(
            "delta = 0: the features would take no part; leave delta out, or give features=None"
        )
    if uncertainty:
        check_uncertainty(features, method, sliding, weights)
    return tolerance, weights


def given_curves(moving, control, curves, method, features, hold_out):
    """The `Curve`s of a call: those to fit and those held out. SurfaceError unless both surfaces
    are disks that look outward, LandmarkError where curves are wrong or missing."""
    for surface in (moving, control):
        require_disk(surface)
        require_outward(surface)
    found = check_curves(curves, moving, control, int(features is None))
    fitted, held = held_apart(found, hold_out)
    if not fitted and features is None:
        raise LandmarkError("all curves are held out: leave some to be fitted, or give features")
    if not fitted and method == "network":
        raise LandmarkError("method 'network' needs landmarks: CP-Net knows no folds; give 'exact'")
    return fitted, held
