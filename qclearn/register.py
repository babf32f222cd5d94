"""The pipeline: two cortical surfaces and their landmark curves in, a certified point-to-point map out."""

import time
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from scipy.sparse import vstack
from tqdm import tqdm

from .beltrami import cotangent_stiffness
from .bijectivity import BijectivityError, RepairWarning, check_embedding, repair
from .disk import disk_conformal_map, edge_lengths
from .diskmesh import locate
from .fit import LandmarkError, check_weights, fit_landmarks, sampling_matrix
from .landmarks import check_path, detect_curves, resample, sample_curve
from .mobius import best_mobius, mobius
from .surface import require_disk, require_outward

POINTS_PER_CURVE = 10
MEETING = 1e-9  # in the unit disk: landmarks closer than this are one point
CURVE_KEYS = {"name", "moving", "control", "detect"}


@dataclass(frozen=True)
class Registration:
    """Result of `register`.

    points (V, 3): where each moving vertex lies on the control surface, in its length unit; disk_map (V,) complex:
    the same in the control's disk; mu (F,): measured coefficient of disk_moving -> disk_map; report: dict for JSON;
    disk_moving (V,), disk_control: the two disk maps; curves: name -> (moving, control) curves in their disks, (k,)
    complex each; faces_moving, faces_control.
    """

    points: np.ndarray
    disk_map: np.ndarray
    mu: np.ndarray
    report: dict
    disk_moving: np.ndarray
    disk_control: np.ndarray
    curves: dict
    faces_moving: np.ndarray
    faces_control: np.ndarray


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


def register(moving, control, curves, method="exact", alpha=1.0, beta=1e-2, gamma=1e5, sliding=False, progress=False):
    """Register the moving surface to the control surface along landmark curves: a Registration, certified bijective.

    curves: the landmarks file as read from JSON, `{"curves": [{"name", "moving", "control"}, ...]}` with vertex
    indices (two on a side are endpoints and that side's curve is detected, unless "detect" is false), or its list.
    alpha, beta, gamma: weights of |mu|, of its gradient and of the landmark mismatch (paper, eq. RegLoss).
    Both surfaces must be outward-oriented disks of the same handedness (`mirror` one of them otherwise).
    Errors: SurfaceError, LandmarkError; BijectivityError if no bijective map was found at any gamma.
    """
    if method != "exact":
        raise ValueError(f"unknown method {method!r}; this version has: exact")
    check_weights(alpha, beta, gamma)
    for surface in (moving, control):
        require_disk(surface)
        require_outward(surface)
    entries = check_curves(curves, moving, control)
    stages, fallbacks = Stages(5, progress), []
    with stages("disk_moving"):
        z_moving = _conformal(moving, "moving", fallbacks)
    with stages("disk_control"):
        z_control = _conformal(control, "control", fallbacks)
    with stages("detect"):
        z_moving = align(moving, z_moving, control, z_control, entries)
        samples_moving, lines_moving = sample_side(moving, z_moving, entries, "moving")
        samples_control, lines_control = sample_side(control, z_control, entries, "control")
    p, q = samples_moving @ z_moving, samples_control @ z_control
    with stages("map"):
        once = distinct_landmarks(entries, p, q)
        fit = bijective_fit(z_moving, moving.faces, p[once], q[once], alpha, beta, gamma, once // POINTS_PER_CURVE,
                            sliding, fallbacks)
    with stages("pull_back"):
        points = lift(control, z_control, fit.f)
        mapped = samples_moving @ fit.f
        error_mm = np.linalg.norm(lift(control, z_control, mapped) - samples_control @ control.vertices, axis=1)
    before = abs(mobius(p, *best_mobius(p, q)) - q)
    report = {
        "landmark_error_before": float(before.mean()), "landmark_error": float(abs(mapped - q).mean()),
        "landmark_error_mm": float(error_mm.mean()), **coefficient_statistics(fit.mu),
        "flipped": len(fit.flipped), "bijective": fit.bijective, "fallbacks": fallbacks, "seconds": stages.report(),
        "method": method, "alpha": alpha, "beta": beta, "gamma": gamma,
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": curve_rows(entries, before, abs(mapped - q), error_mm), "version": version("qclearn"),
    }
    names = [entry["name"] for entry in entries]
    return Registration(points, fit.f, fit.mu, report, z_moving, z_control,
                        dict(zip(names, zip(lines_moving, lines_control))), moving.faces, control.faces)


def _conformal(surface, side, fallbacks):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z = disk_conformal_map(surface)
    fallbacks += [f"{side}: {warning.message}" for warning in caught]
    return z


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
    return z


def sample_side(surface, z, entries, side):
    """One side's landmarks: (sampling matrix (10 K, V), list of K curves in the disk); detects where only ends are given."""
    detected = [entry for entry in entries if entry["detect"][side]]
    found = iter(detect_curves(surface, z, [entry[side] for entry in detected]) if detected else [])
    lines = [next(found) if entry["detect"][side] else z[entry[side]] for entry in entries]
    matrices = [resample(surface, sampling_matrix(z, surface.faces, line), POINTS_PER_CURVE) for line in lines]
    return vstack(matrices).tocsr(), lines


def distinct_landmarks(entries, p, q):
    """Which of the landmarks (10 K,) to fit, (k,) int: a point that curves share on both sides counts once.

    LandmarkError where two of them meet on one side only.
    """
    meet_p, meet_q = (np.triu(abs(points[:, None] - points) < MEETING, 1) for points in (p, q))
    torn = np.argwhere(meet_p != meet_q)
    if len(torn):
        first, second = (entries[k // POINTS_PER_CURVE]["name"] for k in torn[0])
        side = "moving" if meet_p[tuple(torn[0])] else "control"
        raise LandmarkError(f"curves {first!r} and {second!r} share a point on the {side} side only, and a bijection "
                            "can neither part nor merge points; let them meet on both sides or on neither")
    return np.flatnonzero(~meet_p.any(axis=0))


def bijective_fit(z, faces, p, q, alpha, beta, gamma, labels, sliding, fallbacks):
    """`fit_landmarks` at gamma, or at the next lower power of ten whose map is bijective (reported in fallbacks)."""
    weight = gamma
    while weight >= gamma * 1e-4:
        fit = fit_landmarks(z, faces, p, q, alpha, beta, weight, labels, sliding)
        if fit.bijective:
            fallbacks += list(fit.fallbacks) + [f"gamma lowered to {weight:g}"] * (weight < gamma)
            return fit
        weight /= 10
    raise BijectivityError(f"no bijective map for these landmarks down to gamma = {weight * 10:g} "
                           f"({len(fit.flipped)} faces flipped); check that no two curves cross or are swapped")


def lift(surface, z, points):
    """Points (P, 3) on the surface whose images in its disk map z are `points` (P,) complex."""
    face, weights = locate(z, surface.faces, points)
    return np.einsum("pk,pkd->pd", weights, surface.vertices[surface.faces[face]])


def coefficient_statistics(mu):
    """Mean, standard deviation and maximum of |mu| over the faces of the moving mesh."""
    size = abs(mu)
    return {"mean_abs_mu": float(size.mean()), "sd_abs_mu": float(size.std()), "max_abs_mu": float(size.max())}


def curve_rows(entries, before, after, millimetres):
    """Per curve: its name and mean errors before (best Möbius map) and after, in the disk and in millimetres."""
    rows = []
    for k, entry in enumerate(entries):
        part = slice(k * POINTS_PER_CURVE, (k + 1) * POINTS_PER_CURVE)
        rows.append({"name": entry["name"], "landmark_error_before": float(before[part].mean()),
                     "landmark_error": float(after[part].mean()), "landmark_error_mm": float(millimetres[part].mean())})
    return rows


def check_curves(curves, moving, control):
    """The landmarks file's curves as checked dicts with arrays and `detect` per side, or LandmarkError."""
    if isinstance(curves, dict):
        unknown = set(curves) - {"curves"}
        if unknown or "curves" not in curves:
            raise LandmarkError(f"landmarks need the one key 'curves'; found {sorted(map(str, curves))}")
        curves = curves["curves"]
    if not isinstance(curves, (list, tuple)) or not curves:
        raise LandmarkError("landmarks hold no curves: give at least one {\"name\", \"moving\", \"control\"}")
    entries = [_check_entry(number, entry, moving, control) for number, entry in enumerate(curves)]
    names = [entry["name"] for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise LandmarkError(f"curve names used twice: {twice}; rename one of each")
    return entries


def _check_entry(number, entry, moving, control):
    if not isinstance(entry, dict) or not {"name", "moving", "control"} <= set(entry) <= CURVE_KEYS:
        keys = sorted(map(str, entry)) if isinstance(entry, dict) else type(entry).__name__
        raise LandmarkError(f"curve {number} has {keys}; it needs name, moving, control and may have detect")
    if not isinstance(entry["name"], str) or not isinstance(entry.get("detect", True), bool):
        raise LandmarkError(f"curve {number}: name must be text and detect true or false")
    checked = {"name": entry["name"], "detect": {}}
    for side, surface in (("moving", moving), ("control", control)):
        try:
            checked[side] = check_path(surface, entry[side])
        except LandmarkError as error:
            raise LandmarkError(f"curve {entry['name']!r}, {side} side: {error}") from None
        checked["detect"][side] = len(checked[side]) == 2 and entry.get("detect", True)
    return checked


def transfer(values, z_from, faces_from, z_to, nearest=False):
    """Per-vertex values (V,) or (V, k) of one disk mesh carried to the points z_to of the same disk.

    From control to moving: `transfer(values, disk_control, faces_control, disk_map)`; back:
    `transfer(values, disk_map, faces_moving, disk_control)`. Linear in each triangle, or with `nearest` the value of
    the corner with the largest weight (for labels). ValueError if the count of values is not that of the vertices.
    """
    values = np.asarray(values)
    if len(values) != len(z_from):
        raise ValueError(f"{len(values)} values for {len(z_from)} vertices: give one a vertex of the surface they "
                         "come from (the cut-open one, if it was cut)")
    face, weights = locate(z_from, faces_from, z_to)
    corners = np.asarray(faces_from)[face]
    if nearest:
        return values[corners[np.arange(len(face)), weights.argmax(1)]]
    return np.einsum("pk,pk...->p...", weights, values[corners])
