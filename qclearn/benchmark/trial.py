"""One run on one problem, in one thread: the map, its time and memory, and all that is measured of it."""

import ctypes
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from ..methods.networks import networks_of
from ..plane.beltrami import beltrami_coefficient
from ..plane.bijectivity import RepairWarning, check_bijective
from ..plane.diskmesh import locate, polar_disk
from ..registration.fit import POWER
from ..registration.landmarks import POINTS_PER_CURVE, curve_distance, sample_curve
from ..registration.metrics import (
    coefficient_histogram,
    coefficient_measures,
    correspondence_measures,
    distortion_measures,
    landmark_measures,
    near_curves,
)
from ..registration.transfer import lift
from .pairs import prepare

LONG, REPETITIONS = 2.0, 3  # seconds after which a map is not computed again for its time; otherwise, how often
NEAR = 10.0  # mm along the surface: what counts as near a sulcus
FINE = 400  # points on a curve where it is compared as a curve
ON_CIRCLE = 1e-6
WITHOUT_TRUTH = dict.fromkeys(
    (
        "correspondence_mm",
        "median_correspondence_mm",
        "p95_correspondence_mm",
        "correspondence_sulci_mm",
        "floor_mm",
        "floor_curve_mm",
    )
)


def trial(pair, run, method):
    """A row's figures of one run on one pair, dict: `status` "done" with what the results schema names, or "failed"
    with the error's message."""
    try:
        with threadpool_limits(1):
            prepared = prepare(pair, run.landmarks)
            networks_of(run.method, run.parameters)  # loaded before the clock starts
            f, costs = timed(method, prepared.problem, run.parameters)
            start = time.perf_counter()
            points = lift(pair.control.surface, pair.control.z, f)
            costs["seconds"] |= {
                "disk_moving": pair.moving.seconds,
                "disk_control": pair.control.seconds,
                "landmarks": prepared.seconds,
                "pull_back": time.perf_counter() - start,
            }
            sides = {"moving": pair.moving.notes, "control": pair.control.notes}
            costs["notes"] = [
                *[f"{side}: {note}" for side, notes in sides.items() for note in notes],
                *prepared.notes,
                *costs["notes"],
            ]
            return {"status": "done", **map_figures(pair, prepared, f, points, run.keep_field), **costs}
    except Exception as error:
        return {"status": "failed", "message": f"{type(error).__name__}: {error}"}


def timed(method, problem, parameters):
    """(f, costs): the map and its median time over the warm ones of up to REPETITIONS, in one thread.

    Each begins with nothing known of the problem. The first counts only where there is no other, where it takes LONG or
    more: its memory is measured, which costs it time.
    """
    seconds, notes = [], []
    while not seconds or (sum(seconds) < LONG and len(seconds) < REPETITIONS):
        fresh = replace(problem)
        one_thread()
        if not seconds:
            before = memory("VmRSS", reset_peak=True)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RepairWarning)
            start = time.perf_counter()
            f = method(fresh, **parameters)
            seconds.append(time.perf_counter() - start)
        if len(seconds) == 1:
            peak = memory("VmHWM")
        notes = [str(warning.message) for warning in caught if issubclass(warning.category, RepairWarning)]
    f = np.asarray(f, complex)
    if f.shape != problem.z.shape or not np.isfinite(f).all():
        raise ValueError(
            f"the method returned an array of shape {f.shape} with {(~np.isfinite(f)).sum()} values that "
            f"are not finite; expected {problem.z.shape}, one point of the disk a vertex"
        )
    return f, {
        "seconds": {"map": float(np.median(seconds[1:] or seconds))},
        "repetitions": len(seconds),
        "notes": notes,
        "peak_memory_mb": None if peak is None or before is None else max(0.0, peak - before),
    }


def one_thread():
    """torch keeps its own count of threads, if it is loaded."""
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)


def memory(name, reset_peak=False):
    """Resident memory of this process now ("VmRSS") or its peak ("VmHWM"), in MB; None where the system is not
    Linux."""
    try:
        if reset_peak:
            ctypes.CDLL(None).malloc_trim(0)  # hand back what earlier tasks freed: to use that again would not show
            Path("/proc/self/clear_refs").write_text("5")
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))
    except (AttributeError, OSError, StopIteration, TypeError):  # a C library without malloc_trim, or none by this name
        return None


def map_figures(pair, prepared, f, points, keep_field):
    """All figures of a map f (V,) with registered points (V, 3)."""
    moving, control, problem = pair.moving.surface, pair.control.surface, prepared.problem
    mu, certificate = beltrami_coefficient(problem.z, problem.faces, f), check_bijective(problem.z, problem.faces, f)
    off_circle = float(abs(abs(f[moving.boundary]) - 1).max())
    mapped = prepared.samples @ f
    off = np.linalg.norm(lift(control, pair.control.z, mapped) - prepared.target_mm, axis=1)
    figures = {
        **coefficient_measures(moving, problem.z, mu),
        **landmark_measures(mapped, prepared.target, off),
        **true_errors(pair, f),
        **distortion_measures(moving, points),
        **WITHOUT_TRUTH,
        "flipped": len(certificate.flipped),
        "bijective": certificate.bijective,
        "off_circle": off_circle,
        "certified": certificate.bijective and off_circle < ON_CIRCLE,
        "histogram": coefficient_histogram(mu),
    }
    if pair.truth is not None:
        near = near_curves(moving, [curve["moving"] for curve in pair.curves], NEAR)
        figures |= correspondence_measures(points, pair.truth, near) | floors(pair)
    if keep_field and figures["certified"]:
        grid, faces = polar_disk(16, 48, POWER)
        figures["field"] = np.round(abs(mu)[locate(f, problem.faces, grid[faces].mean(1))[0]], 4)
    return figures


def true_errors(pair, f):
    """Errors between the true curves, whatever landmarks the map was found with; None where a side carries ends
    only."""
    whole = [curve for curve in pair.curves if min(len(curve["moving"]), len(curve["control"])) > 2]
    if not whole or pair.given == "exact":
        return {"landmark_error_true": None, "landmark_error_true_mm": None}
    moving, control = pair.moving.surface, pair.control.surface
    mapped = np.concatenate([sample_curve(moving, curve["moving"], POINTS_PER_CURVE) @ f for curve in whole])
    there = [sample_curve(control, curve["control"], POINTS_PER_CURVE) for curve in whole]
    target, target_mm = (
        np.concatenate([samples @ data for samples in there]) for data in (pair.control.z, control.vertices)
    )
    off = np.linalg.norm(lift(control, pair.control.z, mapped) - target_mm, axis=1)
    return {"landmark_error_true": float(abs(mapped - target).mean()), "landmark_error_true_mm": float(off.mean())}


def floors(pair):
    """What the true curves themselves leave, mm: how far their true images lie from the control's curves.

    A sulcus forms beside its course on the template, and not at the same place in everybody: a map that takes curves to
    curves, as all do here, is off by this much on them. By points of equal arc length, and by distance of curves.
    """
    if pair.given == "exact":
        return {"floor_mm": 0.0, "floor_curve_mm": 0.0}
    off, apart = [], []
    for curve in pair.curves:
        for count, collect in ((POINTS_PER_CURVE, off), (FINE, apart)):
            image = sample_curve(pair.moving.surface, curve["moving"], count) @ pair.truth
            there = sample_curve(pair.control.surface, curve["control"], count) @ pair.control.surface.vertices
            collect.append(
                curve_distance(image, there) if collect is apart else np.linalg.norm(image - there, axis=1).mean()
            )
    return {"floor_mm": float(np.mean(off)), "floor_curve_mm": float(np.mean(apart))}
