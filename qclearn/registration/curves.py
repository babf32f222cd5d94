"""Landmark curves: sampled by arc length, detected between endpoints, read from a landmarks file or
a table of points."""

import csv
import io
import json
from collections import defaultdict
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

from ..io.frames import TKR
from ..io.safe import NOT_PLAIN, is_plain_name, read_bytes
from ..surfaces.curvature import mean_curvature, sulcal_depth
from ..surfaces.surface import Mesh, Surface, SurfaceError
from ..surfaces.units import UNITS, size_of
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
    return resample(surface, sparse.eye_array(len(surface.vertices), format="csr")[path], count)


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


def resample(surface, corners, count=10):
    """Equally spaced points by arc length in space on the polyline through `corners @ vertices`:
    sparse (count, V)."""
    lengths = np.linalg.norm(np.diff(corners @ surface.vertices, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    if not along[-1] > 0:
        raise LandmarkError("a curve has no length: its points coincide; give its endpoints apart")
    wanted = np.linspace(0, along[-1], count)
    segment = np.clip(np.searchsorted(along, wanted, side="right") - 1, 0, len(lengths) - 1)
    # Clipped, as the last one may exceed 1 by rounding.
    share = sparse.diags_array(np.clip((wanted - along[segment]) / lengths[segment], 0, 1))
    return (corners[segment] + share @ (corners[segment + 1] - corners[segment])).tocsr()


def check_path(surface, path):
    """A vertex path as integers, or LandmarkError."""
    try:
        path = np.asarray(path)
    except ValueError:
        raise LandmarkError(
            "a curve must be a list of vertex indices; got lists of unequal lengths"
        ) from None
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


def edge_graph(surface, lengths):
    """The graph of a surface's edges with their lengths (E,): sparse (V, V)."""
    return sparse.csr_array((lengths, tuple(surface.edges.T)), shape=(len(surface.vertices),) * 2)


def fundus_path(
    surface: Surface, start: int, end: int, metric: Float[ndarray, " E"] | None = None
) -> Integer[ndarray, " k"]:
    """Vertex path of a sulcus between two endpoints: the shortest one in `fundus_metric` (computed
    if not given), or LandmarkError where they coincide or are out of range."""
    check_path(surface, np.array([start, end]))
    graph = edge_graph(surface, fundus_metric(surface) if metric is None else metric)
    _, previous = dijkstra(graph, directed=False, indices=int(start), return_predecessors=True)
    return walk_back(previous, end)


def walk_back(previous, end):
    """The vertices from the start of `dijkstra`'s tree of predecessors (V,) to `end`."""
    path = [int(end)]
    while previous[path[-1]] >= 0:
        path.append(int(previous[path[-1]]))
    return np.array(path[::-1])


def detect_curves(
    surface: Surface, z: Complex[ndarray, " V"], endpoints: Integer[ndarray, " K 2"]
) -> list[Complex[ndarray, " _"]]:
    """The sulci between pairs of endpoints as curves in the disk z: shortest paths in
    `fundus_metric`, as LD-Net's."""
    metric = fundus_metric(surface)
    return [z[fundus_path(surface, start, end, metric)] for start, end in np.asarray(endpoints)]


def curves_in_space(side, curves):
    """Points (SAMPLES, 3), equally spaced by arc length, on a `ParameterizedSurface`'s surface for
    each curve (k,) in its disk."""
    # Lifting is faster for the points of all curves at once.
    fine = [fill(np.asarray(curve, complex), SAMPLES) for curve in curves]
    stops = np.cumsum([len(part) for part in fine])[:-1]
    points = side.lift(np.concatenate(fine))
    return [_equally_spaced(part) for part in np.split(points, stops)]


def _equally_spaced(points):
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0, along[-1], SAMPLES)
    return np.stack([np.interp(wanted, along, column) for column in points.T], axis=1)


def curve_distance(one, other):
    """Mean distance in space from the points of either curve (n, 3), (m, 3) to the nearest of the
    other."""
    there = scipy.spatial.cKDTree(one).query(other)[0]
    back = scipy.spatial.cKDTree(other).query(one)[0]
    return (there.mean() + back.mean()) / 2


FORMAT = "see 'Files, formats and exit codes' in the book"
CURVE_KEYS = {"name", "moving", "control", "detect", "hold_out"}
# Lists and objects. Where a program has raised Python's limit of recursion, json.loads goes on
# until the stack ends.
MOST_NESTED = 64


def read_landmarks(path):
    """The contents of a landmarks file; LandmarkError, naming it, if it is no sound JSON or a
    curve's name is bad."""
    try:
        data = read_bytes(Path(path))
    except SurfaceError as error:
        raise LandmarkError(str(error)) from None
    if nesting(data) > MOST_NESTED:
        raise LandmarkError(f"{path}: lists nested too deeply; {FORMAT}")
    try:
        contents = json.loads(data.decode("utf-8-sig"))  # Windows puts a byte order mark before it
    except ValueError as error:  # also of an integer of thousands of digits
        raise LandmarkError(f"{path}: not a JSON file ({error}); {FORMAT}") from None
    curves = contents.get("curves") if isinstance(contents, dict) else contents
    for number, curve in enumerate(curves if isinstance(curves, list) else []):
        name = curve.get("name") if isinstance(curve, dict) else None
        if isinstance(name, str) and not is_plain_name(name):
            raise LandmarkError(
                f"{path}: the name of curve {number} {NOT_PLAIN}: {name[:40]!r}; rename it"
            )
    return contents


def nesting(data):
    """How deep the brackets and braces of a text (bytes) are nested, those in strings included."""
    text = np.frombuffer(data, np.uint8)
    opened = np.isin(text, list(b"[{")).astype(np.int64) - np.isin(text, list(b"]}"))
    return int(opened.cumsum().max(initial=0))


def on_cut_surfaces(landmarks, hemispheres):
    """A landmarks file's curves in the numbers of the cut-open surfaces, of those of the whole ones
    where such were given. hemispheres: side -> `Hemisphere`. LandmarkError where a vertex lies on
    the medial wall."""
    if not any(one.is_whole for one in hemispheres.values()):
        return landmarks
    given = (hemispheres[side].given for side in SIDES)
    return {
        "curves": [
            _on_cut(curve, hemispheres) for curve in check_curves(landmarks, *given, fewest=0)
        ]
    }


def _on_cut(curve, hemispheres):
    """A `Curve` as an entry of a landmarks file, in the numbers of the cut-open surfaces."""
    detect = all(curve.detect[side] or len(curve.path(side)) > 2 for side in SIDES)
    entry = {"name": curve.name, "detect": detect, "hold_out": curve.hold_out}
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
    return entry


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
            'landmarks hold no curves: give at least one {"name", "moving", "control"}'
        )
    checked = [_check_entry(number, entry, moving, control) for number, entry in enumerate(curves)]
    names = [curve.name for curve in checked]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise LandmarkError(f"curve names used twice: {twice}; rename one of each")
    return checked


def held_apart(curves, names):
    """`Curve`s as two lists: those to fit, and those held out by these names or by their file."""
    if isinstance(names, str):
        names = [names]
    if not isinstance(names, (list, tuple, set)) or not all(
        isinstance(name, str) for name in names
    ):
        raise LandmarkError(f"hold_out is {names!r:.60}: give a list of names of curves")
    unknown = sorted(set(names) - {curve.name for curve in curves})
    if unknown:
        known = ", ".join(repr(curve.name) for curve in curves) or "none"
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


def _check_entry(number, entry, moving, control):
    """An entry of a landmarks file as a `Curve`, or LandmarkError."""
    if not isinstance(entry, dict) or not {"name", "moving", "control"} <= set(entry) <= CURVE_KEYS:
        keys = sorted(map(str, entry)) if isinstance(entry, dict) else type(entry).__name__
        raise LandmarkError(
            f"curve {number} has {keys}; it needs name, moving, control and may have detect, "
            "hold_out"
        )
    name = entry["name"]
    detect = entry.get("detect", True)
    hold_out = entry.get("hold_out", False)
    if not isinstance(name, str) or not all(isinstance(flag, bool) for flag in (detect, hold_out)):
        raise LandmarkError(
            f"curve {number}: name must be text, and detect and hold_out true or false"
        )
    surfaces = {"moving": moving, "control": control}
    paths = {}
    for side, surface in surfaces.items():
        try:
            paths[side] = check_path(surface, entry[side])
        except LandmarkError as error:
            other = OTHER_SIDE[side]
            hint = _other_numbers(entry[side], surface, other, surfaces[other])
            raise LandmarkError(f"curve {name!r}, {side} side: {error}{hint}") from None
    # Two vertices are a path's ends, unless the file says that they are the path.
    by_side = {side: detect and len(path) == 2 for side, path in paths.items()}
    return Curve(name, **paths, detect=by_side, hold_out=hold_out)


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
        return (
            " numbering: all are vertices of the whole surface; give their numbers on the cut one"
        )
    if path.max() < len(other.vertices):
        return (
            f" exchanged: or of the {other_side} surface, which has so many? then exchange MOVING "
            "and CONTROL"
        )
    return ""


COLUMNS = ("name", "side", "order", "x", "y", "z")
PLACES = {"begin": -np.inf, "end": np.inf}  # in the order
NEAR = 4.0  # mm: how far a point may lie from the nearest vertex
SCANNER = "scanner"


def read_points(path):
    """Points of a csv file with the COLUMNS: dict name -> side -> (n, 3), each in its order,
    numbers or begin and end. Cells may be parted by commas, semicolons or tabs, in the last two
    cases with decimal commas. LandmarkError, naming file and line, where a column, a cell, a side,
    a number or a place in the order is missing."""
    # Curve -> side -> place in the order -> point.
    curves = defaultdict(lambda: {side: {} for side in SIDES})
    for where, row in _rows(path):
        name, side, place, point = _point(row, where)
        points = curves[name][side]
        if place in points:
            raise LandmarkError(f"{where}: {name!r} has this place twice on the {side} side")
        points[place] = point
    if not curves:
        raise LandmarkError(f"{path}: holds no points; give a line for each")
    for name, sides in curves.items():
        for side, points in sides.items():
            if len(points) < 2:
                raise LandmarkError(
                    f"{path}: {name!r} has fewer than two points on the {side} side; give begin "
                    "and end"
                )
            sides[side] = np.array([points[place] for place in sorted(points)])
    return dict(curves)


def _rows(path):
    """(place in the file, dict column -> cell) of each row of a table that is not blank."""
    data = read_bytes(Path(path))
    try:
        lines = io.StringIO(data.decode("utf-8-sig"), newline=None)  # CR, LF or both
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise LandmarkError(
            f"{path}, line {line}: not a text file in UTF-8; export the table as csv in UTF-8"
        ) from None
    separator = max(",;\t", key=lines.readline().count)
    lines.seek(0)
    rows = csv.DictReader(lines, delimiter=separator)
    try:
        rows.fieldnames = [cell.strip().lower() for cell in rows.fieldnames or ()]
        if wrong := [column for column in COLUMNS if rows.fieldnames.count(column) != 1]:
            raise LandmarkError(
                f"{path}: no column {', '.join(wrong)}, or two; the first line names "
                f"{', '.join(COLUMNS)}"
            )
        for row in rows:
            where = f"{path}, line {rows.line_num}"
            beyond = "".join(row.pop(None, ())).strip()
            if beyond or any(cell and not cell.isspace() for cell in row.values()):
                if beyond or None in map(row.get, COLUMNS):
                    raise LandmarkError(
                        f"{where}: its cells are not as many as the first line's; fill in what is "
                        "missing, and give numbers a decimal point or part the cells by semicolons"
                    )
                if separator != ",":
                    row |= {column: row[column].replace(",", ".") for column in COLUMNS[2:]}
                yield where, row
    except csv.Error as error:
        advice = "check its quotes, or export the table again"
        raise LandmarkError(f"{path}, line {rows.line_num + 1}: {error}; {advice}") from None


def _point(row, where):
    name = " ".join(row["name"].split())  # of a cell with line breaks, too
    side, order = (row[column].strip().lower() for column in ("side", "order"))
    if not name:
        raise LandmarkError(f"{where}: no name; write the curve's name in each line")
    if side not in SIDES:
        raise LandmarkError(f"{where}: the side is {side!r}; write moving or control")
    try:
        place = PLACES[order] if order in PLACES else float(order)
        point = [float(row[axis]) for axis in "xyz"]
    except ValueError:
        raise LandmarkError(
            f"{where}: order must be a number, begin or end, and x, y, z numbers in mm"
        ) from None
    if np.isnan(place) or not np.isfinite(point).all():
        raise LandmarkError(f"{where}: not a finite number")
    return name, side, place, point


def spaces(frame):
    """What brings points (n, 3) into the coordinates of a surface's file with this `Frame`: dict
    space -> function, the file's own first; without the other one where no volume is known, and
    empty where the file says nothing."""
    if frame.space is None:
        return {}
    if frame.in_scanner or not frame.volume:
        return {SCANNER: np.asarray} | ({TKR: frame.to_scanner} if frame.volume else {})
    return {TKR: np.asarray, SCANNER: frame.to_tkr}


def nearest_vertices(surface, points, space, known):
    """Vertices (n,) nearest points (n, 3), and their distances in mm; LandmarkError where one is
    over NEAR, which names the space of `known`, a result of `spaces`, in which all are near. space:
    one of them, or None: the file's own."""
    tree = scipy.spatial.cKDTree(surface.vertices)
    mm = size_of(surface).mm
    distance, vertices = tree.query(known[space](points) if space else points)
    distance /= mm
    worst = distance.argmax()
    if distance[worst] > NEAR:
        hint = "check the coordinates and their unit"
        near = [
            one for one, place in known.items() if tree.query(place(points))[0].max() <= NEAR * mm
        ]
        units = [unit for unit in UNITS if tree.query(UNITS[unit] * points)[0].max() <= NEAR * mm]
        if near:
            hint = f"in {near[0]} coordinates all are near it: --space {near[0]}"
        elif units:
            hint = f"in {units[0]} all are near it: give them in mm"
        place = ", ".join(f"{number:g}" for number in points[worst])
        raise LandmarkError(
            f"the point ({place}) is {distance[worst]:.1f} mm from the surface; {hint}"
        )
    return vertices, distance


def curve_lines(own, curves, side, detect=None):
    """`Curve`s of one side, "moving" or "control", in the disk of its `ParameterizedSurface`: (k,)
    complex each, and messages.

    Given curves stay. The others are shortest paths, or what `detect` finds, unless such a line has
    an `own_fault`, or crosses or touches another one.
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
    faults = {k: fault for k in wanted if (fault := own_fault(lines[k], z[ends[k]]))}
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


def own_fault(line, ends):
    """Why a detected curve cannot be used, as text, or None."""
    if len(line) < 2 or not (np.isfinite(line).all() and abs(line).max() <= 1 + ON_VERTEX):
        return "leaves the disk"
    if abs(line[[0, -1]] - ends).max() > ON_VERTEX:
        return "misses its endpoints"
    return None if path_of(line).is_simple else "crosses itself"


def fill(line, points):
    """The polyline (k,) with equally many points added to each piece, to `points` at least."""
    pieces = -(-points // (len(line) - 1))
    return np.interp(np.arange((len(line) - 1) * pieces + 1) / pieces, np.arange(len(line)), line)


def path_of(line):
    return shapely.linestrings(np.stack([line.real, line.imag], axis=1))
