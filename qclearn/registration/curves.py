"""Landmark curves: sampled by arc length, detected between endpoints, read from a landmarks file."""

import json
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import scipy
import shapely
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from ..io.safe import NOT_PLAIN, is_plain_name, read_bytes
from ..plane.checks import unmasked
from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Mesh, Surface, SurfaceError, require_surface
from .problem import LandmarkError

SIDES = ("moving", "control")
OTHER_SIDE = dict(zip(SIDES, reversed(SIDES)))
POINTS_PER_CURVE = 10
SAMPLES = 400  # on a curve whose distance to another is measured
# Exponents of the fundus metric.
CURVATURE_WEIGHT = 0.5
DEPTH_WEIGHT = 2.0
# In the unit disk: a detected curve that ends no farther off its endpoint ends there.
ON_VERTEX = 1e-6
# A detected curve is filled up to so many points, so that its length in space is that on the
# surface.
POINTS = 256


@dataclass(frozen=True, eq=False)
class Curve:
    """A landmark curve of two surfaces, as `check_curves` returns it.

    moving, control: vertices of its path on either surface, or its two ends alone; detect: side ->
    whether only the ends are given and the path between them is to be detected; hold_out: whether
    the landmarks file holds it out of the fit.
    """

    name: str
    moving: Integer[ndarray, " k"]
    control: Integer[ndarray, " m"]
    detect: dict
    hold_out: bool = False

    def path(self, side):
        """The vertices given on the side "moving" or "control"."""
        return getattr(self, side)


def sample_curve(
    surface: Surface, path: Integer[ndarray, " k"], count: int = 10
) -> Float[sparse.csr_array, " count V"]:
    """Sparse (count, V): per-vertex data at points of a vertex path, equally spaced by arc length
    in space, ends included.

    `sample_curve(s, p) @ s.vertices` are the points, `sample_curve(s, p) @ z` their images in the
    disk (linear along each segment). LandmarkError for fewer than two distinct points or vertices
    out of range.
    """
    path = check_path(surface, path)
    at_path = sparse.eye_array(len(surface.vertices), format="csr")[path]
    return (equally_spaced(surface.vertices[path], count) @ at_path).tocsr()


def curves_of_both(moving, control):
    """The curves that both surfaces carry under one name, as entries of a landmarks file, not to be
    detected."""
    return [
        {
            "name": name,
            "moving": path.tolist(),
            "control": control.curves[name].tolist(),
            "detect": False,
        }
        for name, path in moving.curves.items()
        if name in control.curves
    ]


def equally_spaced(points, count):
    """Sparse (count, k): data at equally spaced points by arc length on the polyline through points
    (k, 3), its ends included, from data at these. LandmarkError where all points coincide."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if not along[-1] > 0:
        raise LandmarkError("a curve has no length: its points coincide; give its endpoints apart")
    wanted = np.linspace(0, along[-1], count)
    segment = np.clip(np.searchsorted(along, wanted, side="right") - 1, 0, len(lengths) - 1)
    # The last one may exceed 1 by rounding, and the last segment have no length.
    share = (wanted - along[segment]) / np.maximum(lengths[segment], np.finfo(float).tiny)
    share = np.clip(share, 0, 1)
    rows = np.repeat(np.arange(count), 2)
    columns = np.stack([segment, segment + 1], axis=1).ravel()
    weights = np.stack([1 - share, share], axis=1).ravel()
    return sparse.csr_array((weights, (rows, columns)), shape=(count, len(points)))


def check_path(surface, path):
    """A vertex path as integers, or LandmarkError."""
    require_surface(surface, Mesh)
    path = unmasked(path, "a curve", LandmarkError)
    if path.ndim != 1 or len(path) < 2 or not np.issubdtype(path.dtype, np.integer):
        raise LandmarkError(
            "a curve must be a list of at least two vertex indices; got "
            f"{path.dtype} of the shape {path.shape}"
        )
    outside = path[(path < 0) | (path >= len(surface.vertices))]
    if len(outside):
        raise LandmarkError(
            f"curve vertices out of range 0..{len(surface.vertices) - 1}: {outside[:5].tolist()}; "
            "were the indices taken from another mesh (before it was cut open, say)?"
        )
    repeated = np.flatnonzero(path[1:] == path[:-1])
    if len(repeated):
        raise LandmarkError(
            f"a curve repeats vertex {path[repeated[0]]} at position {repeated[0]}; drop the repeat"
        )
    return path


def fundus_metric(surface: Surface) -> Float[ndarray, " E"]:
    """Length of every edge of `surface.edges` in a metric that is short along the floor of sulci.

    An edge's length in space times the mean over its ends of `exp(H/(2 s) - 2 d/m)`, with H the
    mean curvature (limited to two of its standard deviations s) and d the sulcal depth (limited to
    1.5 times m, its 95th percentile).
    """
    return weigh_edges(surface, fundus_cost(surface, mean_curvature(surface)))


def fundus_cost(surface, H, curvature_weight=CURVATURE_WEIGHT, depth_weight=DEPTH_WEIGHT):
    """What a unit of length costs at each vertex (V,): the exponential in `fundus_metric`."""
    depth = sulcal_depth(surface)
    H = np.clip(H / (H.std() or 1.0), -2, 2)
    deep = np.percentile(depth, 95) or depth.max() or 1.0  # a surface without folds has no depth
    return np.exp(curvature_weight * H - depth_weight * np.minimum(depth / deep, 1.5))


def weigh_edges(surface, cost):
    """Length of every edge (E,) of `surface.edges` times the mean cost (V,) over its ends."""
    first, second = surface.edges.T
    length = np.linalg.norm(surface.vertices[first] - surface.vertices[second], axis=1)
    return length * (cost[first] + cost[second]) / 2


def fundus_path(
    surface: Surface, start: int, end: int, metric: Float[ndarray, " E"] | None = None
) -> Integer[ndarray, " k"]:
    """Vertex path of a sulcus between two endpoints: the shortest one in `fundus_metric` (computed
    if not given), or LandmarkError where they coincide or are out of range."""
    check_path(surface, np.array([start, end]))
    lengths = fundus_metric(surface) if metric is None else metric
    graph = sparse.csr_array((lengths, tuple(surface.edges.T)), shape=(len(surface.vertices),) * 2)
    _, previous = dijkstra(graph, directed=False, indices=int(start), return_predecessors=True)
    # From the end back along the tree of predecessors.
    path = [int(end)]
    while previous[path[-1]] >= 0:
        path.append(int(previous[path[-1]]))
    return np.array(path[::-1])


def detect_curves(
    surface: Surface, z: Complex[ndarray, " V"], endpoints: Integer[ndarray, " K 2"]
) -> list[Complex[ndarray, " _"]]:
    """The sulci between pairs of endpoints as curves in the disk z: shortest paths in
    `fundus_metric`, as LD-Net's."""
    metric, ends = fundus_metric(surface), unmasked(endpoints, "endpoints")
    return [z[fundus_path(surface, start, end, metric)] for start, end in ends]


def curves_in_space(side, curves):
    """Points (SAMPLES, 3), equally spaced by arc length, on a `ParameterizedSurface`'s surface for
    each curve (k,) in its disk."""
    # Lifting is faster for the points of all curves at once.
    fine = [fill(np.asarray(curve, complex), SAMPLES) for curve in curves]
    stops = np.cumsum([len(part) for part in fine])[:-1]
    points = side.lift(np.concatenate(fine))
    return [equally_spaced(part, SAMPLES) @ part for part in np.split(points, stops)]


def curve_distance(one, other):
    """Mean distance in space from the points of either curve (n, 3), (m, 3) to the nearest of the
    other."""
    there = scipy.spatial.cKDTree(one).query(other)[0]
    back = scipy.spatial.cKDTree(other).query(one)[0]
    return (there.mean() + back.mean()) / 2


FORMAT = "see 'Files, formats and exit codes' in the book"
CURVE_KEYS = {"name", "moving", "control", "detect", "hold_out"}


def read_landmarks(path):
    """The contents of a landmarks file; LandmarkError, naming it, if it is no sound JSON or a
    curve's name is bad."""
    try:
        data = read_bytes(Path(path))
    except SurfaceError as error:
        raise LandmarkError(str(error)) from None
    try:
        contents = json.loads(data)
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        raise LandmarkError(f"{path}: not a JSON file ({error}); {FORMAT}") from None
    curves = contents.get("curves") if isinstance(contents, dict) else contents
    for number, curve in enumerate(curves if isinstance(curves, list) else []):
        name = curve.get("name") if isinstance(curve, dict) else None
        if isinstance(name, str) and not is_plain_name(name):
            raise LandmarkError(
                f"{path}: the name of curve {number} {NOT_PLAIN}: {name[:40]!r}; rename it"
            )
    return contents


def on_cut_surfaces(landmarks, hemispheres):
    """A landmarks file's curves in the numbers of the cut-open surfaces, of those of the whole ones
    where such were given. hemispheres: side -> `Hemisphere`. LandmarkError where a vertex lies on
    the medial wall."""
    if not any(one.is_whole for one in hemispheres.values()):
        return landmarks
    entries = []
    given = (hemispheres[side].given for side in SIDES)
    for curve in check_curves(landmarks, *given, fewest=0):
        detect = all(curve.detect[side] or len(curve.path(side)) > 2 for side in SIDES)
        entry = {"name": curve.name, "detect": detect, "hold_out": curve.hold_out}
        entries.append(entry)
        for side in SIDES:
            one = hemispheres[side]
            path = curve.path(side)
            entry[side] = (one.numbering.places(path) if one.is_whole else path).tolist()
            if min(entry[side]) < 0:
                away = path[np.array(entry[side]) < 0][:5].tolist()
                raise LandmarkError(
                    f"curve {curve.name!r}, {side} side: vertices {away} lie on the medial wall, "
                    "which is cut away; give vertices of the cortex"
                )
    return {"curves": entries}


def check_curves(curves, moving, control, fewest=1):
    """The curves of a landmarks file, or of its list, for two surfaces: list of `Curve`, `fewest`
    at least. LandmarkError names what cannot be used."""
    if isinstance(curves, dict):
        # "off_fundus_mm" is for people to read.
        unknown = set(curves) - {"curves", "surfaces", "off_fundus_mm"}
        if unknown or "curves" not in curves:
            raise LandmarkError(
                f"landmarks need the one key 'curves'; found {sorted(map(str, curves))} "
                "('surfaces' may stand beside it)"
            )
        check_surfaces(curves.get("surfaces", {}), moving, control)
        curves = curves["curves"]
    if not isinstance(curves, (list, tuple)) or len(curves) < fewest:
        raise LandmarkError(
            'landmarks hold no curves: give at least one {"name", "moving", "control"}, of a file '
            "json.load(open(path))"
        )
    surfaces = {"moving": moving, "control": control}
    checked = []
    for number, entry in enumerate(curves):
        keys = set(entry) if isinstance(entry, dict) else set()
        if not {"name", "moving", "control"} <= keys <= CURVE_KEYS:
            found = sorted(map(str, keys)) or type(entry).__name__
            raise LandmarkError(
                f"curve {number} has {found}; it needs name, moving, control and may have detect, "
                "hold_out"
            )
        name = entry["name"]
        detect, hold_out = entry.get("detect", True), entry.get("hold_out", False)
        switches = isinstance(detect, bool | np.bool_) and isinstance(hold_out, bool | np.bool_)
        if not (isinstance(name, str) and switches):
            raise LandmarkError(
                f"curve {number}: name must be text, detect, hold_out true or false"
            )
        paths = {}
        for side, surface in surfaces.items():
            try:
                paths[side] = check_path(surface, entry[side])
            except LandmarkError as error:
                other = OTHER_SIDE[side]
                hint = _other_numbers(entry[side], surface, other, surfaces[other])
                raise LandmarkError(f"curve {name!r}, {side} side: {error}{hint}") from None
        # Two vertices are a path's ends, unless the file says that they are the path.
        by_side = {side: bool(detect and len(path) == 2) for side, path in paths.items()}
        checked.append(Curve(name, **paths, detect=by_side, hold_out=bool(hold_out)))
    names = [curve.name for curve in checked]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise LandmarkError(f"curve names used twice: {twice}; rename one of each")
    return checked


def held_apart(curves, names):
    """`Curve`s as two lists: those to fit, and those held out by these names or by their file."""
    names = [names] if isinstance(names, str) else names
    listed = isinstance(names, (list, tuple, set))
    if not listed or not all(isinstance(name, str) for name in names):
        raise LandmarkError(f"hold_out is {names!r:.60}: give a list of names of curves")
    unknown = sorted(set(names) - {curve.name for curve in curves})
    if unknown:
        known = ", ".join(repr(curve.name) for curve in curves) or "none: give landmarks"
        raise LandmarkError(
            f"no curve is called {', '.join(map(repr, unknown))}, to be held out; there are {known}"
        )
    held = [curve for curve in curves if curve.hold_out or curve.name in names]
    return [curve for curve in curves if curve not in held], held


def check_surfaces(stated, moving, control):
    """LandmarkError unless the surfaces, or their mirrors, are those stated: `{"moving":
    {"vertices", "sha256"}, ...}`, each side and key optional."""
    if not isinstance(stated, dict) or not set(stated) <= set(SIDES):
        raise LandmarkError(
            'landmarks: \'surfaces\' must be {"moving": {"vertices", "sha256"}, "control": {...}}'
        )
    surfaces = {"moving": moving, "control": control}
    for side, wanted in stated.items():
        if not isinstance(wanted, dict) or not set(wanted) <= {"vertices", "sha256"}:
            raise LandmarkError(
                f'landmarks: surfaces, {side}: give "vertices" and "sha256", and nothing else'
            )
        if not _is_one(wanted, surfaces[side]):
            other = OTHER_SIDE[side]
            hint = (
                "numbers of one mesh mean nothing on another: give the surface they belong to, or "
                "make them anew"
            )
            if wanted and _is_one(wanted, surfaces[other]):
                hint = f"exchanged: they fit the {other} surface; exchange MOVING and CONTROL"
            raise LandmarkError(
                f"the landmarks were made for another {side} surface ({_stated(wanted)}; this one "
                f"has {_stated(surfaces[side].fingerprint)}): {hint}"
            )


def _is_one(wanted, surface):
    mirrored = Mesh(surface.vertices * [-1.0, 1.0, 1.0], surface.faces[:, ::-1])
    return any(wanted.items() <= one.fingerprint.items() for one in (surface, mirrored))


def _stated(mark):
    """A side's count and hash for a message."""
    formats = {"vertices": "{} vertices", "sha256": "sha256 {}"}
    return ", ".join(formats[key].format(str(value)[:12]) for key, value in mark.items())


def _other_numbers(path, surface, other_side, other):
    """What vertices out of a surface's range may be: the end of a message."""
    try:
        path = np.asarray(path)
    except ValueError:
        return ""
    numbers = path.ndim == 1 and path.dtype.kind in "iu" and len(path)
    if not numbers or path.min() < 0 or path.max() < len(surface.vertices):
        return ""
    if surface.original_vertices is not None and np.isin(path, surface.original_vertices).all():
        return " numbering: all are vertices of the whole surface; give those of the cut one"
    if path.max() < len(other.vertices):
        return (
            f" exchanged: or of the {other_side} surface, which has so many? then exchange MOVING "
            "and CONTROL"
        )
    return ""


def curve_lines(own, curves, side, detect=None):
    """`Curve`s of one side, "moving" or "control", in the disk of its `ParameterizedSurface`: (k,)
    complex each, and messages.

    Given curves stay. The others are shortest paths, or what `detect` finds, unless such a line
    leaves the disk, misses its ends, crosses itself, or crosses or touches another one.
    """
    surface = own.surface
    z = own.disk.z
    lines = [z[curve.path(side)] for curve in curves]
    wanted = [k for k, curve in enumerate(curves) if curve.detect[side]]
    ends = {k: curves[k].path(side) for k in wanted}
    detected = (detect or detect_curves)(surface, z, np.array([*ends.values()])) if wanted else []
    for k, line in zip(wanted, detected, strict=True):
        lines[k] = np.asarray(line, complex)
    if detect is None:
        return lines, []
    faults = {}
    for k in wanted:
        line = lines[k]
        if len(line) < 2 or not (np.isfinite(line).all() and abs(line).max() <= 1 + ON_VERTEX):
            faults[k] = "leaves the disk"
        elif abs(line[[0, -1]] - z[ends[k]]).max() > ON_VERTEX:
            faults[k] = "misses its endpoints"
        elif not path_of(line).is_simple:
            faults[k] = "crosses itself"
    # A given line stays even where a detected one crosses it.
    sound = [k for k in range(len(lines)) if k not in faults]
    for first, second in combinations(sound, 2):
        if path_of(lines[first]).crosses(path_of(lines[second])):
            for k, other in ((first, second), (second, first)):
                if k in wanted:
                    faults[k] = f"crosses or touches {curves[other].name!r}"
    for k in wanted:
        lines[k] = lines[k] if k in faults else fill(lines[k], POINTS)
    if faults:
        again = sorted(faults)
        shortest = detect_curves(surface, z, [ends[k] for k in again])
        for k, line in zip(again, shortest):
            lines[k] = line
    return lines, [
        f"LD-Net's {side} curve {curves[k].name!r} {fault}: shortest path"
        for k, fault in faults.items()
    ]


def fill(line, points):
    """The polyline (k,) with equally many points added to each piece, to `points` at least."""
    pieces = -(-points // (len(line) - 1))
    return np.interp(np.arange((len(line) - 1) * pieces + 1) / pieces, np.arange(len(line)), line)


def path_of(line):
    return shapely.linestrings(np.stack([line.real, line.imag], axis=1))
