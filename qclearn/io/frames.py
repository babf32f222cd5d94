"""What a file says of a surface besides its mesh, and how it survives from format to format."""

import json
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from nibabel.gifti import GiftiCoordSystem
from nibabel.nifti1 import xform_codes

from ..surfaces.surface import SurfaceError
from .safe import FormatError, LeftOutWarning, printable

# What a GIFTI says a surface is: its GeometricType, or, of an anatomical one, its
# AnatomicalStructureSecondary.
ANATOMICAL = ("GrayWhite", "MidThickness", "Pial")
SHAPES = (
    "Ellipsoid", "Flat", "Hull", "Inflated", "Reconstruction", "SemiSpherical", "Spherical",
    "VeryInflated",
)  # fmt: skip
_NAMED = {
    "pial": "Pial", "white": "GrayWhite", "smoothwm": "GrayWhite", "midthickness": "MidThickness",
    "graymid": "MidThickness", "veryinflated": "VeryInflated", "inflated": "Inflated",
    "infl": "Inflated", "sphere": "Spherical", "flat": "Flat",
}  # fmt: skip
# Small l and r are also plain letters.
_SIDE = re.compile(r"(?:^|[._-])(?:hemi-)?(L|R|(?i:lh|rh|left|right))(?=[._-]|$)")
# FreeSurfer's own coordinates: around the middle of its volume, at `cras` in the scanner.
TKR = "tkr"
# What a header says of its axes: SPACE=LPS (3D Slicer), space: left-posterior-superior (NRRD).
_SAID = re.compile(r"(?i)(?:space|system|orientation)\W{1,4}(LPS|RAS|left-p\w*-s|right-a\w*-s)")
_AXES = ("xras", "yras", "zras", "cras")
_TKR_AXES = np.array([[-1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of the voxels, in these coordinates


@dataclass(frozen=True)
class Frame:
    """What a file says of its surface; None where it does not say.

    side: "left" or "right"; space of the coordinates: TKR or a GiftiCoordSystem; volume:
    FreeSurfer's geometry; kind: one of ANATOMICAL or SHAPES; count, whole: the number of vertices
    and the faces (F, 3) of the whole surface that a disk was cut out of.
    """

    side: str | None = None
    space: GiftiCoordSystem | str | None = None
    volume: dict | None = None
    kind: str | None = None
    count: int | None = None
    whole: np.ndarray | None = field(default=None, compare=False, repr=False)

    @property
    def text(self):
        """All but the whole surface's faces, as JSON."""
        space = self.space
        if isinstance(space, GiftiCoordSystem):
            names = "dataspace", "xformspace"
            codes = {name: xform_codes.label[getattr(space, name)] for name in names}
            space = codes | {"xform": np.asarray(space.xform).tolist()}
        entries = {"side": self.side, "space": space, "volume": self.volume}
        return json.dumps(entries | {"kind": self.kind, "count": self.count})

    @property
    def in_scanner(self):
        """Whether the coordinates are the scanner's."""
        if not isinstance(self.space, GiftiCoordSystem):
            return False
        return xform_codes.label[self.space.dataspace] == "scanner"

    def to_scanner(self, vertices):
        """FreeSurfer's coordinates (V, 3) of this volume in the scanner."""
        return vertices @ self._turn() + self.volume["cras"]

    def to_tkr(self, vertices):
        """The scanner's coordinates (V, 3) in FreeSurfer's of this volume."""
        return (vertices - self.volume["cras"]) @ np.linalg.inv(self._turn())

    def _turn(self):
        """The identity for a volume that FreeSurfer made: it has the axes of `_TKR_AXES`."""
        return _TKR_AXES.T @ np.array([self.volume[axis] for axis in _AXES[:3]])


def frame_of_text(text, whole=None):
    """The Frame that `Frame.text` describes; FormatError where it makes no sense."""
    try:
        known = json.loads(str(text))
        keys = ("side", "space", "volume", "kind", "count")
        side, space, volume, kind, count = (known[key] for key in keys)
        if isinstance(space, dict):
            codes = [xform_codes[space[key]] for key in ("dataspace", "xformspace")]
            space = GiftiCoordSystem(*codes, np.array(space["xform"], dtype=float).reshape(4, 4))
        volume = volume and sound_volume(volume)
    except (KeyError, TypeError, ValueError, RecursionError):
        message = "what it says of the file a surface came from cannot be understood"
        raise FormatError(message) from None
    return Frame(side, space, volume, kind, count, whole)


def sound_volume(volume):
    """FreeSurfer's volume geometry (nibabel's dict) with lists, or None where it is not valid."""
    keys = ("head", "valid", "filename", "volume", "voxelsize", *_AXES)
    geometry = {key: np.asarray(volume[key]).tolist() for key in keys}
    if not str(geometry["valid"]).startswith("1"):
        return None
    rows = np.array([geometry[key] for key in _AXES], dtype=float)
    geometry["filename"] = printable(str(geometry["filename"]))  # one line of a header
    if rows.shape != (4, 3) or not np.isfinite(rows).all() or abs(np.linalg.det(rows[:3])) < 0.1:
        raise FormatError("its volume geometry makes no sense")
    return geometry


def in_ras(path, vertices, header):
    """Vertices (V, 3) in RAS: x and y negated, with a word, where a file's header says LPS."""
    said = {found[0].upper() for found in _SAID.findall(header)}
    if len(said) > 1:
        raise SurfaceError("says that it is in LPS and in RAS; leave the right one in its header")
    if said != {"L"}:
        return vertices
    message = "says that it is in LPS: x and y are negated, so that it is in RAS"
    warnings.warn(f"{path}: {message}", LeftOutWarning, stacklevel=2)
    return vertices * [-1.0, -1.0, 1.0]


def side_of_name(path):
    """ "left" or "right" where a file's name says so (lh.pial, 01.L.white.gii, hemi-R), or None."""
    sides = {match[0].lower() for match in _SIDE.findall(Path(path).name)}
    return {"l": "left", "r": "right"}[sides.pop()] if len(sides) == 1 else None


def agreed_side(path, stated):
    """The hemisphere that a file's metadata state, or else its name; SurfaceError where both do and
    differ."""
    named = side_of_name(path)
    if stated and named and stated != named:
        command = f"wb_command -set-structure {path} CORTEX_{named.upper()}"
        raise SurfaceError(
            f"its metadata are of the {stated} hemisphere, its name is of the {named} one; give it "
            f"another name, or correct the metadata (of a GIFTI: {command})"
        )
    return stated or named


def kind_of_name(path):
    """What a surface is where its name says so (lh.pial, L.very_inflated.surf.gii), else None."""
    parts = re.split(r"[._-]", Path(path).name.lower().replace("very_inflated", "veryinflated"))
    kinds = {_NAMED[part] for part in parts if part in _NAMED}
    return kinds.pop() if len(kinds) == 1 else None
