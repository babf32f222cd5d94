"""One run on one problem, in one thread: the map, its time, its memory and all its figures."""

import ctypes
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from threadpoolctl import threadpool_limits

from ..io.safe import printable
from ..plane.bijectivity import RepairWarning
from ..plane.checks import unmasked
from ..plane.disk import Disk
from ..plane.grids import polar
from ..plane.mobius import mobius
from ..registration.curves import curves_in_space
from ..registration.register import register
from . import measures
from . import reference_metrics as reference
from .images import OnDisk, image_of, reversed_on_sphere
from .methods.networks import networks_of
from .methods.spheres import inward
from .pairs import prepare, reverse

# A map is computed again for its time, at most so often, within so many seconds.
REPETITIONS = 3
LONG = 2.0
NEAR = 10.0  # largest distance from a sulcus along the surface, mm
ON_CIRCLE = 1e-6
OF_RADIUS = "coverage", "rank", "curve_coverage", "curve_radius_mm", "curve_ratio_90"
OF_TRUTH = "correspondence_mm", "median_correspondence_mm", "p95_correspondence_mm"
OF_TRUTH += ("correspondence_sulci_mm", *reference.TRUE_MAP)


def trial(pair, run, method):
    """The figures of one run on one pair, dict for the results schema, or a failure's message."""
    try:
        with threadpool_limits(1):
            prepared = prepare(pair, run.landmarks)
            networks_of(run.method, run.parameters)  # loaded before the clock starts
            f, costs = timed(method, prepared.problem, run.parameters)
            start = time.perf_counter()
            locate = unknown(pair.control.disk).locate
            image = image_of(pair.control, f, locate)
            places = image.locate(f[: len(prepared.problem.disk.z)])
            costs["seconds"] |= {
                "disk_moving": pair.moving.seconds,
                "disk_control": pair.control.seconds,
                "landmarks": prepared.seconds,
                "pull_back": time.perf_counter() - start,
            }
            sides = {"moving": pair.moving.messages, "control": pair.control.messages}
            of_disks = [f"{side}: {note}" for side, notes in sides.items() for note in notes]
            costs["notes"] = [*of_disks, *prepared.notes, *costs["notes"]]
            figures = map_figures(pair, prepared, f, image, places, locate)
            if run.keep_field and f.ndim == 1 and figures["certified"]:
                disk = prepared.problem.disk
                there = disk.at(f).locate(polar(16).centroids)[0]
                figures["field"] = np.round(abs(disk.coefficient(f))[there], 4)
            figures |= judge_radius(pair, run)
            figures["there_and_back_mm"] = way_back(pair, run, method, places)
            return {"status": "done"} | figures | costs
    except Exception as error:
        return failed(error)


def failed(error):
    """The figures of a row that failed, by its exception or a message."""
    kind = f"{type(error).__name__}: " if isinstance(error, BaseException) else ""
    return {"status": "failed", "message": printable(f"{kind}{error}")}


def timed(method, problem, parameters):
    """(f, costs): the map, its median time over up to REPETITIONS warm runs, and its memory.

    The first run is measured for memory; its time counts only from LONG on.
    """
    seconds = []
    while not seconds or (sum(seconds) < LONG and len(seconds) < REPETITIONS):
        # Nothing is known of the problem's disks when a run begins.
        sides = problem.pair.moving, problem.pair.control
        moving, control = (replace(side, disk=unknown(side.disk)) for side in sides)
        pair = replace(problem.pair, moving=moving, control=control)
        fresh = replace(problem, disk=unknown(problem.disk), pair=pair)
        if "torch" in sys.modules:  # it keeps its own count of threads
            sys.modules["torch"].set_num_threads(1)
        if not seconds:
            before = memory("VmRSS", reset_peak=True)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", RepairWarning)
            start = time.perf_counter()
            f = method(fresh, **parameters)
            seconds.append(time.perf_counter() - start)
        if len(seconds) == 1:
            peak = memory("VmHWM")
        repairs = [each for each in caught if issubclass(each.category, RepairWarning)]
        notes = [str(each.message) for each in repairs]
    return checked(f, problem), {
        "seconds": {"map": float(np.median(seconds[1:] or seconds))},
        "repetitions": len(seconds),
        "notes": notes,
        "peak_memory_mb": None if peak is None or before is None else max(0.0, peak - before),
    }


def unknown(disk):
    """The same `Disk` without what was computed of it."""
    return Disk(disk.z, disk.faces)


def checked(f, problem):
    """A method's answer as (V,) complex or, on the sphere, (V', 3) float; ValueError."""
    f = unmasked(f, "the method's answer")
    on_sphere = f.ndim == 2 and f.shape[1] == 3 and not np.iscomplexobj(f)
    f = f.astype(float if on_sphere else complex)
    sphere = problem.pair.moving.sphere if on_sphere else None
    shape = problem.disk.z.shape if sphere is None else sphere.points.shape
    if f.shape != shape or not np.isfinite(f).all():
        count = (~np.isfinite(f)).sum()
        given = f"an array of shape {f.shape} with {count} values that are not finite"
        wanted = f"{shape}, one point of the {'disk' if sphere is None else 'sphere'} a vertex"
        raise ValueError(f"the method returned {given}; expected {wanted}")
    return f


def way_back(pair, run, method, places):
    """Mean distance, mm, between vertices and their images there and back; None if not asked."""
    if not pair.there_and_back:
        return None
    problem = prepare(reverse(pair), run.landmarks).problem
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        g = checked(method(problem, **run.parameters), problem)
    here, there = image_of(pair.moving, g, pair.moving.disk.locate), image_of(pair.control, g, None)
    home = here.lift(here.locate(there.at(g, places)))
    return float(np.linalg.norm(home - pair.moving.surface.vertices, axis=1).mean())


def judge_radius(pair, run):
    """How good the 90 % radius is that `register` gives with a run's settings, dict.

    By the truth: "coverage", share of the moving area with an error within the radius, and "rank",
    Spearman's correlation of radius and error. By held-out curves, whose distance from the
    control's is at most the error: "curve_coverage", share of their vertices within the radius,
    "curve_radius_mm", its mean there, and "curve_ratio_90", times the radius that would hold nine
    in ten. None where nothing is to judge.
    """
    figures = dict.fromkeys(OF_RADIUS)
    given = (run.landmarks, pair.given) == ("given", "given")
    if not run.uncertainty or not given or (pair.truth is None and not pair.held):
        return figures
    moving, control = pair.moving.surface, pair.control.surface
    curves = [] if run.method == "landmark_free" else list(pair.curves)
    settings = {"features": None} if run.method == "gauss_newton" else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        settings |= run.parameters
        registration = register(moving, control, curves, uncertainty=True, **settings)
    radius = registration.uncertainty
    if radius is None:  # wrong landmarks, which are not fitted
        return figures
    if pair.truth is not None:
        from scipy.stats import spearmanr  # here: it takes a third of the time to start a process

        off = np.linalg.norm(registration.points - pair.truth, axis=1)
        coverage = np.average(off <= radius, weights=moving.vertex_areas)
        return figures | {"coverage": coverage, "rank": spearmanr(radius, off)[0]}
    paths = [curve["moving"] for curve in pair.held]
    lines = [pair.control.disk.z[curve["control"]] for curve in pair.held]
    targets = map(cKDTree, curves_in_space(pair.control, lines))
    off = [tree.query(registration.points[path])[0] for path, tree in zip(paths, targets)]
    off, there = np.concatenate(off), radius[np.concatenate(paths)]
    values = (off <= there).mean(), there.mean(), np.quantile(off / there, 0.9)
    return figures | dict(zip(OF_RADIUS[2:], values))


def memory(name, reset_peak=False):
    """This process' resident memory now ("VmRSS") or at its peak ("VmHWM"), MB; None off Linux."""
    try:
        if reset_peak:
            # Memory that earlier tasks freed goes back first: to use it again would not show.
            ctypes.CDLL(None).malloc_trim(0)
            Path("/proc/self/clear_refs").write_text("5")
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))
    # A C library without malloc_trim, or none by this name.
    except (AttributeError, OSError, StopIteration, TypeError):
        return None


def map_figures(pair, prepared, f, image, places, locate):
    """All figures of a map f (V,) or, on the sphere, (V', 3).

    image, places: what it goes into, and where there; locate: in the control's disk.
    """
    moving = pair.moving.surface
    problem = prepared.problem
    figures = in_disk(moving, problem, f) if f.ndim == 1 else on_sphere(pair, f)
    f = f[: len(moving.vertices)]  # of a whole surface: its cortex
    points = image.lift(places)
    mapped = prepared.samples @ f
    off = np.linalg.norm(image.lift(image.locate(mapped)) - prepared.target_mm, axis=1)
    figures |= measures.landmark_measures(mapped if f.ndim == 1 else np.nan, prepared.target, off)
    # Where the curves have more than ends, and the truth is not given: their true errors.
    whole = [curve for curve in pair.curves if min(len(curve["moving"]), len(curve["control"])) > 2]
    figures |= {"landmark_error_true": None, "landmark_error_true_mm": None}
    if whole and pair.given != "exact":
        plane, in_space = reference.curve_errors(pair, whole, f, image)
        figures["landmark_error_true"] = None if plane is None else plane.mean()
        figures["landmark_error_true_mm"] = in_space.mean()
    figures |= reference.held_out(pair, problem.pair, f, image)
    figures |= measures.distortion_measures(moving, points)
    figures |= reference.log2_means(moving, points)
    figures |= reference.tails(moving, points)
    figures |= reference.agreement(pair, image, places)
    moved = locate(mobius(problem.disk.z, *problem.mobius))
    before = reference.agreement(pair, OnDisk(pair.control, locate), moved)
    figures |= {f"{name}_before": before[name] for name in ("r_depth", "r_curvature")}
    figures |= dict.fromkeys(OF_TRUTH)
    figures["reversed_on_sphere"] = reversed_on_sphere(pair, places, f)
    if pair.truth is not None:
        curves = [curve["moving"] for curve in (*pair.curves, *pair.held)]
        near = measures.near_curves(moving, curves, NEAR)
        figures |= measures.correspondence_measures(points, pair.truth, near)
        figures |= reference.true_map(pair, locate)
    return figures


def in_disk(moving, problem, f):
    """Figures of a map f (V,) between the disks: coefficient, certificate and flipped faces."""
    mu = problem.disk.coefficient(f)
    certificate = problem.disk.certify(f)
    off_circle = float(abs(abs(f[moving.boundary]) - 1).max())
    return {
        **measures.coefficient_measures(moving, problem.disk, mu),
        # Counts of |mu| over the faces in equal steps of [0, 1], all above in the last.
        "histogram": np.histogram(np.minimum(abs(mu), 1), 50, (0, 1))[0],
        "flipped": len(certificate.flipped),
        "bijective": certificate.bijective,
        "off_circle": off_circle,
        "certified": certificate.bijective and off_circle < ON_CIRCLE,
    }


def on_sphere(pair, f):
    """The same for a map of spheres f (V', 3), which has no coefficient in the disk."""
    flipped = inward(f[pair.moving.sphere.whole.faces])
    sizes = ("mean_abs_mu", "sd_abs_mu", "p95_abs_mu", "max_abs_mu")
    weighed = (f"{kind}_abs_mu_{areas}" for kind in ("mean", "sd") for areas in ("disk", "area"))
    none = dict.fromkeys((*sizes, *weighed, "histogram", "off_circle"))
    return none | {"flipped": flipped, "bijective": not flipped, "certified": not flipped}
