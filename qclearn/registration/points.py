"""Landmark points in mm from a table, in the coordinates that a surface's file is in, and the vertices nearest them."""

import csv
import io
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ..io.frames import TKR
from ..io.safe import read_bytes
from .landmarkfile import SIDES
from .problem import LandmarkError

COLUMNS = ("name", "side", "order", "x", "y", "z")
PLACES = {"begin": -np.inf, "end": np.inf}  # words for the order
NEAR = 4.0  # mm: how far a point may lie from the nearest vertex
SCANNER = "scanner"


def read_points(path):
    """Points of a csv file with the COLUMNS: dict name -> side -> (n, 3), each in its order, numbers or begin and end.
    LandmarkError, naming file and line, where a column, a side, a number or a place in the order is missing."""
    try:
        text = read_bytes(Path(path)).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise LandmarkError(f"{path}: not a text file; export the table as csv in UTF-8") from None
    rows = csv.DictReader(io.StringIO(text), delimiter=max(",;\t", key=text.partition("\n")[0].count))
    missing = [column for column in COLUMNS if column not in (rows.fieldnames or ())]
    if missing:
        raise LandmarkError(f"{path}: no column {', '.join(missing)}; the first line names {', '.join(COLUMNS)}")
    found = {}
    for row in rows:
        name, side, place, point = _point(row, f"{path}, line {rows.line_num}")
        along = found.setdefault(name, {one: {} for one in SIDES})[side]
        if place in along:
            raise LandmarkError(f"{path}, line {rows.line_num}: {name!r} has this place twice on the {side} side")
        along[place] = point
    if not found:
        raise LandmarkError(f"{path}: holds no points; give a line for each")
    for name, sides in found.items():
        few = [side for side in SIDES if len(sides[side]) < 2]
        if few:
            raise LandmarkError(f"{path}: {name!r} has fewer than two points on the {few[0]} side; give begin and end")
    return {
        name: {side: np.array([along[place] for place in sorted(along)]) for side, along in sides.items()}
        for name, sides in found.items()
    }


def _point(row, where):
    side, order = ((row[column] or "").strip().lower() for column in ("side", "order"))
    if side not in SIDES:
        raise LandmarkError(f"{where}: the side is {side!r}; write moving or control")
    try:
        place = PLACES[order] if order in PLACES else float(order)
        point = [float(row[axis]) for axis in "xyz"]
    except (TypeError, ValueError):
        raise LandmarkError(f"{where}: order must be a number, begin or end, and x, y, z numbers in mm") from None
    if np.isnan(place) or not np.isfinite(point).all():
        raise LandmarkError(f"{where}: not a finite number")
    return row["name"].strip(), side, place, point


def spaces(frame):
    """What brings points (n, 3) into the coordinates of a surface's file with this `Frame`: dict space -> function, the
    file's own first; without the other one where no volume is known, and empty where the file says nothing."""
    if frame.space is None:
        return {}
    if frame.in_scanner or not frame.volume:
        return {SCANNER: np.asarray} | ({TKR: frame.to_scanner} if frame.volume else {})
    return {TKR: np.asarray, SCANNER: frame.to_tkr}


def nearest_vertices(surface, points, space, known):
    """Vertices (n,) nearest points (n, 3), and their distances in mm; LandmarkError where one is over NEAR, which names
    the space of `known`, a result of `spaces`, in which all are near. space: one of them, or None: the file's own."""
    tree = cKDTree(surface.vertices)
    distance, vertices = tree.query(known[space](points) if space else points)
    worst = distance.argmax()
    if distance[worst] > NEAR:
        near = [one for one, place in known.items() if tree.query(place(points))[0].max() <= NEAR]
        hint = f"in {near[0]} coordinates all are near it: --space {near[0]}" if near else "check the coordinates"
        place = ", ".join(f"{number:g}" for number in points[worst])
        raise LandmarkError(f"the point ({place}) is {distance[worst]:.1f} mm from the surface; {hint}")
    return vertices, distance
