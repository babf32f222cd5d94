"""Reading and writing surfaces; every fault of a file becomes a SurfaceError that names it."""

import gzip
import io
import os
import subprocess
import sys
import uuid
import warnings
import zlib
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import nibabel
import numpy as np

from . import meshformats
from .surface import Surface, SurfaceError

_FREESURFER_TRIANGLES = b"\xff\xff\xfe"
_FREESURFER_QUADS = (b"\xff\xff\xff", b"\xff\xff\xfd")
_FREESURFER_SUFFIXES = (
    "", ".pial", ".white", ".inflated", ".sphere", ".reg", ".orig", ".nofix", ".smoothwm", ".midthickness", ".graymid",
)  # fmt: skip


def read_surface(path):
    """Surface from a file: .npz (vertices, faces, curve_<name>), .gii (also gzipped), .ply, .obj, .off, .stl,
    .vtk, .vtp, or FreeSurfer's binary triangles, known by their content under any other name (lh.pial, rh.white).

    Coordinates come as stored: FreeSurfer's volume geometry and GIFTI's coordinate systems are not applied. Faces must
    be triangles; STL points with equal coordinates are merged. Raises SurfaceError, naming the file and the remedy.
    """
    path = Path(path)
    data = read_bytes(path)
    suffix = suffix_of(path)
    if suffix in _READERS:
        kind, reader = _READERS[suffix]
    elif data.startswith((_FREESURFER_TRIANGLES, *_FREESURFER_QUADS)):
        kind, reader = "FreeSurfer surface", _read_freesurfer
    else:
        raise SurfaceError(f"{path}: {_unknown_format('nor is the content a FreeSurfer surface')}")
    with explain(path, kind):
        arrays = reader(path, data)
    try:
        return Surface(*arrays)
    except SurfaceError as error:
        raise SurfaceError(f"{path}: {error}") from None


def write_surface(path, surface, original_vertices=None):
    """Write a surface in the format of the path's suffix (see read_surface; a FreeSurfer name such as lh.pial, or no
    suffix, gives FreeSurfer's binary); the file appears whole or not at all.

    Coordinates keep float64 exactly, but FreeSurfer, GIFTI and STL store float32, and STL has no vertex numbers. Only
    npz keeps the curves and original_vertices, (V,) int, the second result of open_surface (by default the surface's
    own). Raises SurfaceError where the format is unknown or the folder cannot be written.
    """
    path = Path(path)
    suffix = suffix_of(path)
    if suffix == ".npz":
        writer = partial(_write_npz, original_vertices=original_vertices)
    elif suffix in _WRITERS:
        writer = _WRITERS[suffix]
    elif path.suffix.lower() in _FREESURFER_SUFFIXES or path.name.startswith(("lh.", "rh.")):
        writer = _write_freesurfer
    else:
        raise SurfaceError(f"{path}: {_unknown_format('nor is the name one of FreeSurfer, such as lh.pial')}")
    write_whole(path, lambda temporary: writer(temporary, surface))


def write_whole(path, write):
    """Let `write(temporary_path)` write a file that then takes its place in one step; SurfaceError if it cannot."""
    temporary = path.with_name(f".{uuid.uuid4().hex}-{path.name}")  # the same folder, so that the last step is atomic
    try:
        temporary.touch(exist_ok=False)
        try:
            write(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise SurfaceError(
            f"{path}: cannot be written ({error.strerror or error}); choose a file in a folder that exists and is "
            f"writable."
        ) from None


def suffix_of(path):
    suffixes = [suffix.lower() for suffix in path.suffixes]
    return ".gii" if suffixes[-2:] == [".gii", ".gz"] else suffixes[-1] if suffixes else ""


def _unknown_format(content):
    return (
        f"the suffix is none of {', '.join(_READERS)}, {content}; rename the file or convert it, "
        f"for example with mris_convert."
    )


def read_bytes(path):
    try:
        data = path.read_bytes()
        if path.suffix.lower() == ".gz":
            data = gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error  # damaged gzip has none
        raise SurfaceError(f"{path}: cannot be read ({reason}); check the name and copy the file again.") from None
    if not data:
        raise SurfaceError(f"{path}: the file is empty; copy or export it again.")
    return data


@contextmanager
def explain(path, kind):
    """Turn whatever a parser raises on bad bytes into one SurfaceError; no warning of it reaches the reader."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except SurfaceError as error:
        raise SurfaceError(f"{path}: {error}") from None
    except meshformats.FormatError as error:
        raise SurfaceError(f"{path}: not a readable {kind}: {error}; {_AGAIN}") from None
    except Exception as error:  # the libraries raise all sorts, from EOFError to MemoryError
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise SurfaceError(f"{path}: not a readable {kind} ({reason}); {_AGAIN}") from error


_AGAIN = "it may be cut short or of another format: copy or export it again."


def _read_npz(path, _):
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        missing = {"vertices", "faces"} - set(arrays.files)
        if missing:
            raise SurfaceError(f"lacks the array {' and '.join(sorted(missing))}; save vertices (V, 3), faces (F, 3).")
        curves = {key.removeprefix("curve_"): arrays[key] for key in arrays.files if key.startswith("curve_")}
        original = arrays["original_vertices"] if "original_vertices" in arrays.files else None
        return arrays["vertices"], arrays["faces"], curves, original


def _write_npz(path, surface, original_vertices):
    more = {f"curve_{name}": curve for name, curve in surface.curves.items()}
    original_vertices = surface.original_vertices if original_vertices is None else original_vertices
    if original_vertices is not None:
        more["original_vertices"] = np.asarray(original_vertices)
    with path.open("wb") as file:
        np.savez_compressed(file, vertices=surface.vertices, faces=surface.faces, **more)


def _read_freesurfer(path, data):
    if data.startswith(_FREESURFER_QUADS):
        raise SurfaceError("holds quadrangles (FreeSurfer's old format); convert it with mris_convert to triangles.")
    return *nibabel.freesurfer.read_geometry(path), {}


def _write_freesurfer(path, surface):
    nibabel.freesurfer.write_geometry(path, surface.vertices, surface.faces, create_stamp="created by qclearn")


def _read_gifti(_, data):
    image = nibabel.GiftiImage.from_bytes(data)
    points = image.get_arrays_from_intent("NIFTI_INTENT_POINTSET")
    triangles = image.get_arrays_from_intent("NIFTI_INTENT_TRIANGLE")
    if len(points) != 1 or len(triangles) != 1:
        raise SurfaceError("is GIFTI, but not one surface; give a .surf.gii with one point set and its triangles.")
    return points[0].data, triangles[0].data, {}


def _write_gifti(path, surface):
    points, triangles = surface.vertices.astype(np.float32), surface.faces.astype(np.int32)
    arrays = [
        nibabel.gifti.GiftiDataArray(points, intent="NIFTI_INTENT_POINTSET"),
        nibabel.gifti.GiftiDataArray(triangles, intent="NIFTI_INTENT_TRIANGLE"),
    ]
    data = nibabel.GiftiImage(darrays=arrays).to_bytes()
    path.write_bytes(gzip.compress(data, mtime=0) if path.suffix.lower() == ".gz" else data)


def _read_vtk(path, _):
    # in a process of its own: on some damaged files VTK's readers end the process
    script = Path(__file__).with_name("vtkchild.py")
    child = subprocess.run([sys.executable, "-P", script, path.resolve()], capture_output=True)
    if child.returncode:
        reason = child.stdout.decode() if child.returncode == 1 else ""
        raise meshformats.FormatError(reason or "VTK's reader breaks down on it")
    arrays = io.BytesIO(child.stdout)
    return np.load(arrays), np.load(arrays), {}


def _write_to_string(writer, surface):
    import pyvista  # half a second: only where it is used

    writer.SetInputData(pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces))
    writer.SetWriteToOutputString(True)  # and the file is written like any other
    writer.Write()


def _write_vtk(surface):
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    writer = vtkPolyDataWriter()
    writer.SetFileTypeToBinary()
    _write_to_string(writer, surface)
    data = writer.GetOutputStdString()
    return data.encode() if isinstance(data, str) else data  # VTK gives text where the bytes happen to be UTF-8


def _write_vtp(surface):
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    _write_to_string(writer, surface)
    return writer.GetOutputString().encode()


def _read_plain(read):
    return lambda _, data: (*read(data), {})


def _write_plain(write):
    return lambda path, surface: path.write_bytes(write(surface))


_READERS = {
    ".npz": ("npz file", _read_npz),
    ".gii": ("GIFTI surface", _read_gifti),
    ".ply": ("PLY file", _read_plain(meshformats.read_ply)),
    ".obj": ("OBJ file", _read_plain(meshformats.read_obj)),
    ".off": ("OFF file", _read_plain(meshformats.read_off)),
    ".stl": ("STL file", _read_plain(meshformats.read_stl)),
    ".vtk": ("VTK file", _read_vtk),
    ".vtp": ("VTP file", _read_vtk),
}
_WRITERS = {
    ".gii": _write_gifti,
    ".ply": _write_plain(meshformats.write_ply),
    ".obj": _write_plain(meshformats.write_obj),
    ".off": _write_plain(meshformats.write_off),
    ".stl": _write_plain(meshformats.write_stl),
    ".vtk": _write_plain(_write_vtk),
    ".vtp": _write_plain(_write_vtp),
}
