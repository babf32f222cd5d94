"""The landmarks file: its curves and the surfaces it was made for, checked against the surfaces at hand."""

import json
from pathlib import Path

import numpy as np

from ..io.safe import is_plain_name, read_bytes
from ..surfaces.surface import SurfaceError, mirror
from .landmarks import check_path
from .problem import LandmarkError

FORMAT = "see 'Files, formats and exit codes' in the book"
CURVE_KEYS = {"name", "moving", "control", "detect", "hold_out"}
# Lists and objects. Where a program has raised Python's limit of recursion, json.loads goes on until the stack ends.
MOST_NESTED = 64
SIDES = {"moving": "control", "control": "moving"}  # each side and the other


def read_landmarks(path):
    """The contents of a landmarks file; LandmarkError, naming it, if it is no sound JSON or a curve's name is bad."""
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
            fault = "is longer than 200 characters or holds control characters"
            raise LandmarkError(f"{path}: the name of curve {number} {fault}: {name[:40]!r}; rename it")
    return contents


def nesting(data):
    """How deep the brackets and braces of a text (bytes) are nested, those in strings included."""
    text = np.frombuffer(data, np.uint8)
    opened = np.isin(text, list(b"[{")).astype(np.int64) - np.isin(text, list(b"]}"))
    return int(opened.cumsum().max(initial=0))


def on_disks(landmarks, hemispheres):
    """A landmarks file's curves in the numbers of the cut-open surfaces, of those of the whole ones where such were
    given. hemispheres: side -> `Hemisphere`. LandmarkError where a vertex lies on the medial wall."""
    if not any(one.is_whole for one in hemispheres.values()):
        return landmarks
    given = (hemispheres[side].given for side in SIDES)
    return {"curves": [_on_disks(entry, hemispheres) for entry in check_curves(landmarks, *given, fewest=0)]}


def _on_disks(entry, hemispheres):
    """A checked curve as an entry of a landmarks file, in the numbers of the cut-open surfaces."""
    detect = all(entry["detect"][side] or len(entry[side]) > 2 for side in SIDES)
    moved = {"name": entry["name"], "detect": detect, "hold_out": entry["hold_out"]}
    for side in SIDES:
        one, path = hemispheres[side], entry[side]
        moved[side] = (one.numbering.places(path) if one.is_whole else path).tolist()
        if min(moved[side]) < 0:
            away = path[np.array(moved[side]) < 0][:5].tolist()
            raise LandmarkError(
                f"curve {entry['name']!r}, {side} side: vertices {away} lie on the medial wall, which is cut away; "
                "give vertices of the cortex"
            )
    return moved


def check_curves(curves, moving, control, fewest=1):
    """The landmarks file's curves, `fewest` at least, as dicts with arrays and `detect` per side, or LandmarkError."""
    if isinstance(curves, dict):
        unknown = set(curves) - {"curves", "surfaces", "off_fundus_mm"}  # the last is for the reader's eyes
        if unknown or "curves" not in curves:
            found = sorted(map(str, curves))
            raise LandmarkError(f"landmarks need the one key 'curves'; found {found} ('surfaces' may stand beside it)")
        check_surfaces(curves.get("surfaces", {}), moving, control)
        curves = curves["curves"]
    if not isinstance(curves, (list, tuple)) or len(curves) < fewest:
        raise LandmarkError('landmarks hold no curves: give at least one {"name", "moving", "control"}')
    entries = [_check_entry(number, entry, moving, control) for number, entry in enumerate(curves)]
    names = [entry["name"] for entry in entries]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise LandmarkError(f"curve names used twice: {twice}; rename one of each")
    return entries


def held_apart(entries, names):
    """Checked curves as (to be fitted, held out by these names or by their entry)."""
    if isinstance(names, str):
        names = [names]
    if not isinstance(names, (list, tuple, set)) or not all(isinstance(name, str) for name in names):
        raise LandmarkError(f"hold_out is {names!r:.60}: give a list of names of curves")
    unknown = sorted(set(names) - {entry["name"] for entry in entries})
    if unknown:
        known = ", ".join(repr(entry["name"]) for entry in entries) or "none"
        raise LandmarkError(f"no curve is called {', '.join(map(repr, unknown))}, to be held out; there are {known}")
    names = {*names, *(entry["name"] for entry in entries if entry["hold_out"])}
    return tuple([entry for entry in entries if (entry["name"] in names) == held] for held in (False, True))


def check_surfaces(stated, moving, control):
    """LandmarkError unless the surfaces, or their mirrors, are those stated: `{"moving": {"vertices", "sha256"}, ...}`,
    each side and key optional."""
    if not isinstance(stated, dict) or not set(stated) <= set(SIDES):
        raise LandmarkError('landmarks: \'surfaces\' must be {"moving": {"vertices", "sha256"}, "control": {...}}')
    surfaces = {"moving": moving, "control": control}
    for side, wanted in stated.items():
        if not isinstance(wanted, dict) or not set(wanted) <= {"vertices", "sha256"}:
            raise LandmarkError(f'landmarks: surfaces, {side}: give "vertices" and "sha256", and nothing else')
        if not _is_one(wanted, surfaces[side]):
            other = SIDES[side]
            hint = "numbers of one mesh mean nothing on another: give the surface they belong to, or make them anew"
            if wanted and _is_one(wanted, surfaces[other]):
                hint = f"exchanged: they fit the {other} surface; exchange MOVING and CONTROL"
            found = f"{_stated(wanted)}; this one has {_stated(surfaces[side].fingerprint)}"
            raise LandmarkError(f"the landmarks were made for another {side} surface ({found}): {hint}")


def _is_one(wanted, surface):
    own = surface.fingerprint
    return wanted.items() <= own.items() or wanted.items() <= mirror(surface).fingerprint.items()


def _stated(mark):
    """A side's count and hash in words."""
    words = {"vertices": "{} vertices", "sha256": "sha256 {}"}
    return ", ".join(words[key].format(str(value)[:12]) for key, value in mark.items())


def _check_entry(number, entry, moving, control):
    if not isinstance(entry, dict) or not {"name", "moving", "control"} <= set(entry) <= CURVE_KEYS:
        keys = sorted(map(str, entry)) if isinstance(entry, dict) else type(entry).__name__
        raise LandmarkError(f"curve {number} has {keys}; it needs name, moving, control and may have detect, hold_out")
    flags = [entry.get("detect", True), entry.get("hold_out", False)]
    if not isinstance(entry["name"], str) or not all(isinstance(flag, bool) for flag in flags):
        raise LandmarkError(f"curve {number}: name must be text, and detect and hold_out true or false")
    checked = {"name": entry["name"], "detect": {}, "hold_out": flags[1]}
    surfaces = {"moving": moving, "control": control}
    for side, surface in surfaces.items():
        try:
            checked[side] = check_path(surface, entry[side])
        except LandmarkError as error:
            hint = _other_numbers(entry[side], surface, SIDES[side], surfaces[SIDES[side]])
            raise LandmarkError(f"curve {entry['name']!r}, {side} side: {error}{hint}") from None
        checked["detect"][side] = len(checked[side]) == 2 and entry.get("detect", True)
    return checked


def _other_numbers(path, surface, other_side, other):
    """What vertices out of a surface's range may be: words to end a message with."""
    try:
        path = np.asarray(path)
    except ValueError:
        return ""
    numbers = path.ndim == 1 and path.dtype.kind in "iu" and len(path)
    if not numbers or path.min() < 0 or path.max() < len(surface.vertices):
        return ""
    if surface.original_vertices is not None and np.isin(path, surface.original_vertices).all():
        return " numbering: all are vertices of the whole surface; give their numbers on the cut one"
    if path.max() < len(other.vertices):
        return f" exchanged: or of the {other_side} surface, which has so many? then exchange MOVING and CONTROL"
    return ""
