"""Reading and writing surfaces; every fault of a file becomes a SurfaceError that names it."""

import re
from dataclasses import replace
from pathlib import Path

import nibabel
import numpy as np
from jaxtyping import Integer
from nibabel.gifti import GiftiCoordSystem
from numpy import ndarray

from ..moved import GONE, gone
from ..plane.checks import unmasked
from ..surfaces.surface import Mesh, Surface, SurfaceError, require_surface
from ..surfaces.units import UNITS, size_of
from . import foreign, gifti, meshformats, safe
from .frames import TKR, Frame, agreed_side, frame_of_text, kind_of_name, side_of_name, sound_volume

_VOLUME_KEYS = ("valid", "filename", "volume", "voxelsize", "xras", "yras", "zras", "cras")
_FREESURFER_SUFFIXES = (
    "", ".pial", ".white", ".inflated", ".sphere", ".reg", ".orig", ".nofix", ".smoothwm",
    ".midthickness", ".graymid",
)  # fmt: skip


def read_surface(path: str | Path, units: str = "mm", merge: bool = False) -> Surface:
    """Surface from a file: .npz (vertices, faces, curve_<name>), .gii (also gzipped), .ply,
    Wavefront's .obj, or FreeSurfer's binary triangles, known by their content under any other name
    (lh.pial, rh.white).

    Coordinates come as stored, without volume geometry or coordinate system; of a file that says it
    is in LPS, x and y are negated, with a warning. Faces must be triangles. Vertices in no face are
    dropped; `original_vertices` has the numbers of the others in the file. SurfaceError, with the
    file and the remedy, where it cannot be read.

    units: of the file, "mm", "m" or "um": the surface is scaled to mm, unless its length is that of
    a hemisphere in another of these. merge: give points doubled along a seam the lowest of
    their numbers.
    """
    return surface_of(path, read_mesh(path, units, merge))


def surface_of(path, mesh):
    """The Surface of a file's mesh; a SurfaceError names the file."""
    with safe.naming(path):
        return Surface(*mesh.used())


def read_mesh(path, units, merge):
    """The `Mesh` of a file as `read_surface` takes it; SurfaceError where there is none."""
    if units not in UNITS:
        raise SurfaceError(f"units = {units!r}: give one of {', '.join(UNITS)}")
    path = Path(path)
    foreign.refuse_foreign(path)
    data = safe.read_bytes(path)
    suffix = suffix_of(path)
    if suffix in _READERS:
        kind, reader = _READERS[suffix]
    else:
        kind, reader = "FreeSurfer surface", lambda _, data: _freesurfer_parts(data)[:2]
        held = foreign.freesurfer_kind(data)
        if held is None and suffix in (".annot", ".label", ".mgh", ".mgz", ".txt", ".npy"):
            held = foreign.MAP
        if held != foreign.SURFACE:
            held = held or _unknown_format(suffix, "nor is the content a FreeSurfer surface")
            raise SurfaceError(f"{path}: {held}")
    with safe.explain(path, kind):
        arrays = reader(path, data)
    with safe.naming(path):
        mesh = Mesh.of(*arrays)
        if units != "mm" and size_of(mesh).unit in (units, None):
            mesh = mesh._replace(vertices=UNITS[units] * mesh.vertices)
        return mesh.merged() if merge else mesh


def frame_of(path):
    """The Frame of a surface's or a map's file that `read_surface` or `read_values` reads."""
    path = Path(path)
    data = safe.read_bytes(path)
    named = Frame(side_of_name(path), kind=kind_of_name(path))
    with safe.explain(path, "file with a coordinate system"):
        if suffix_of(path) == ".gii":
            return gifti.frame_of_image(path, gifti.parse(path, data))
        if suffix_of(path) == ".npz":
            about = ("about", "whole_faces", "hemisphere")  # the last of a synthetic subject
            arrays = safe.npz_arrays(data, lambda key: key in about)
            side = str(arrays.get("hemisphere"))
            frame = replace(named, side=side) if side in gifti.STRUCTURES else named
            if "about" in arrays:
                frame = frame_of_text(arrays["about"], arrays.get("whole_faces"))
            side = agreed_side(path, frame.side)
            return replace(frame, side=side, kind=frame.kind or named.kind)
        if foreign.freesurfer_kind(data) == foreign.SURFACE:
            volume = _volume_of(_freesurfer_parts(data)[2])
            space = GiftiCoordSystem(1, 1) if is_flagged(volume) else TKR if volume else None
            return replace(named, space=space, volume=volume)
    return named


def write_surface(
    path: str | Path,
    surface: Surface | tuple,
    original_vertices: Integer[ndarray, " V"] | None = None,
    frame: Frame | None = None,
) -> None:
    """Write a surface, whole or not at all, in the format of the path's suffix, as read_surface.

    A FreeSurfer name such as lh.pial, or no suffix: FreeSurfer's binary. FreeSurfer and GIFTI
    store float32. Only npz has the curves, only npz and GIFTI original_vertices, `open_surface`'s
    second result (default: the surface's own). surface: also a named tuple such as
    `Registration.surface`. frame: `frame_of` the coordinates' file, which npz stores whole, GIFTI
    and FreeSurfer as far as they can; hemisphere and kind are else by the name.
    FreeSurfer's coordinates become the scanner's in GIFTI, and its own again in its own format.
    SurfaceError: unknown format, or a folder not writable.
    """
    require_surface(surface, Mesh)
    path = Path(path)
    frame = frame or Frame()
    suffix = suffix_of(path)
    with safe.explain(path, "name"):
        side = agreed_side(path, frame.side)
        _require_plain(surface.curves if suffix == ".npz" else ())
    numbers = original_vertices if original_vertices is not None else surface.original_vertices
    numbers = None if numbers is None else unmasked(numbers, "original_vertices")

    def write(place):
        if suffix == ".npz":
            arrays = {"vertices": surface.vertices, "faces": surface.faces}
            arrays |= {f"curve_{name}": curve for name, curve in surface.curves.items()}
            if numbers is not None:
                arrays["original_vertices"] = numbers
            if frame != Frame():
                arrays["about"] = np.array(frame.text)
            if frame.whole is not None:
                arrays["whole_faces"] = frame.whole.astype(np.int32)
            place.write_bytes(safe.npz_bytes(arrays))
        elif suffix == ".gii":
            full = replace(frame, side=side, kind=frame.kind or kind_of_name(path))
            place.write_bytes(gifti.zipped(path, gifti.surface_bytes(surface, full, numbers)))
        elif suffix in _WRITERS:
            place.write_bytes(_WRITERS[suffix](surface))
        elif suffix in _FREESURFER_SUFFIXES or is_freesurfer_name(path, suffix):
            vertices, volume, flag = surface.vertices, frame.volume, is_flagged(frame.volume)
            if volume and frame.in_scanner and not flag:
                vertices = frame.to_tkr(vertices)
            volume = volume | {"head": [2, 0, 20]} if flag else volume
            stamp = {"create_stamp": "created by qclearn", "volume_info": volume}
            nibabel.freesurfer.write_geometry(place, vertices, surface.faces, **stamp)
            if flag:  # which nibabel does not write
                start, end, rest = place.read_bytes().rpartition(b"\0\0\0\x14valid")
                place.write_bytes(start[:-1] + b"\1" + end + rest)
        else:
            message = _unknown_format(suffix, "nor is the name one of FreeSurfer, such as lh.pial")
            raise SurfaceError(f"{path}: {message}")

    safe.write_whole(path, write)


# Of files that are no FreeSurfer surface or map, whatever they begin with (lh.map.csv).
_FOREIGN_SUFFIXES = (
    ".json", ".xml", ".nii", ".gz", ".zip", ".label", ".annot", ".mgh", ".mgz", ".npy", ".npz",
    ".txt", ".gii", ".png", ".ply", ".obj", ".off", ".stl", ".vtk", ".vtp", *foreign.BY_SUFFIX,
)  # fmt: skip


def is_freesurfer_name(path, suffix):
    """Whether a file's name is that of a hemisphere's FreeSurfer file, such as lh.curv."""
    return path.name.startswith(("lh.", "rh.")) and suffix not in _FOREIGN_SUFFIXES


def suffix_of(path):
    suffixes = [suffix.lower() for suffix in path.suffixes]
    if suffixes[-2:] in ([".gii", ".gz"], [".gii", ".dset"]):  # .dset: AFNI's
        return ".gii"
    return suffixes[-1] if suffixes else ""


def _unknown_format(suffix, content):
    if suffix in GONE:
        return gone(suffix)
    advice = "rename the file or convert it (mris_convert, pyvista, trimesh)"
    return f"the suffix is none of {', '.join(_READERS)}, {content}; {advice}"


def _read_npz(_, data):
    names = ("vertices", "faces", "original_vertices")
    arrays = safe.npz_arrays(data, lambda key: key in names or key.startswith("curve_"))
    missing = {"vertices", "faces"} - set(arrays)
    if missing:
        names = " and ".join(sorted(missing))
        raise SurfaceError(f"lacks the array {names}; save vertices (V, 3), faces (F, 3)")
    curves = {k.removeprefix("curve_"): v for k, v in arrays.items() if k.startswith("curve_")}
    _require_plain(curves)
    return arrays["vertices"], arrays["faces"], curves, arrays.get("original_vertices")


def _require_plain(curves):
    """SurfaceError where a curve's name cannot be shown."""
    bad = next((name for name in curves if not safe.is_plain_name(name)), None)
    if bad is not None:
        message = "has a curve whose name is too long or holds control characters"
        raise SurfaceError(f"{message}, {bad[:40]!r}; rename it")


def _freesurfer_parts(data):
    """Vertices, faces and what follows them in FreeSurfer's triangles; FormatError unless as much
    is there as the counts say after the header, two lines or, of other programs, one (a count's
    first byte is 0)."""
    counts = re.split(rb"\n(?:[^\0\n][^\n]*)?\n|\n(?=\0)", data[3:], maxsplit=1)[1:]
    if not counts or len(counts[0]) < 8:
        raise safe.FormatError("the header is incomplete")
    n_vertices, n_faces = (int(count) for count in np.frombuffer(counts[0], ">i4", 2))
    records = (len(counts[0]) - 8) // 12
    safe.require_all("vertex", records, n_vertices)
    safe.require_all("face", records - n_vertices, n_faces)
    vertices = np.frombuffer(counts[0], ">f4", 3 * n_vertices, 8).reshape(-1, 3).astype(float)
    start = 8 + vertices.size * 4
    faces = np.frombuffer(counts[0], ">i4", 3 * n_faces, start).reshape(-1, 3)
    return vertices, faces.astype(np.int64), counts[0][start + faces.nbytes :]


def is_flagged(volume):
    """Whether FreeSurfer's geometry says that coordinates are the scanner's (useRealRAS), as
    mris_convert --to-scanner writes it."""
    return volume is not None and volume["head"][:2] == [2, 1]


def _volume_of(footer):
    """The volume geometry behind FreeSurfer's faces, or None; FormatError where it is incomplete.

    Its path may have any letters, = among them.
    """
    head = re.match(b"(\0\0\0\2\0\0\0[\0\1])?\0\0\0\x14", footer)
    if head is None:
        return None
    rows = footer[head.end() :].split(b"\n")[: len(_VOLUME_KEYS)]
    entries = [safe.text_of(row).partition("=") for row in rows]
    volume = {key.strip(): text.strip() for key, _, text in entries}
    if tuple(volume) != _VOLUME_KEYS:
        raise safe.FormatError("its volume geometry is incomplete")
    volume |= {key: list(map(float, volume[key].split())) for key in _VOLUME_KEYS[3:]}
    volume["volume"] = list(map(int, volume["volume"].split()))
    return sound_volume({"head": np.frombuffer(head[0], ">i4"), **volume})


_READERS = {
    ".npz": ("npz file", _read_npz),
    ".gii": ("GIFTI surface", gifti.surface_arrays),
    ".ply": ("PLY file", meshformats.read_ply),
    ".obj": ("OBJ file", meshformats.read_obj),
}
_WRITERS = {".ply": meshformats.write_ply, ".obj": meshformats.write_obj}
