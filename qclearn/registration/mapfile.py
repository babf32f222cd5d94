"""registration.npz: the maps of a finished registration, written with a checksum and checked when they are read."""

import hashlib
import io
from pathlib import Path

import numpy as np

from ..files.safe import explain, npz_arrays, read_bytes, write_whole
from ..plane.disk import Disk
from ..surfaces.surface import SurfaceError

FORMAT_VERSION = 2  # raise it when an array's meaning changes, so that old programs do not misread new files
_REQUIRED = ("disk_map", "faces_moving", "disk_control", "faces_control")
# (array, the array whose length is its count, shape of one row, kinds of numbers)
_SHAPES = (
    ("disk_map", "disk_map", (), "c"),
    ("disk_control", "disk_control", (), "c"),
    ("faces_moving", "faces_moving", (3,), "iu"),
    ("faces_control", "faces_control", (3,), "iu"),
    ("disk_moving", "disk_map", (), "c"),
    ("points", "disk_map", (3,), "f"),
    ("mu", "faces_moving", (), "c"),
    ("vertices_moving", "disk_map", (3,), "f"),
    ("vertices_control", "disk_control", (3,), "f"),
)


def write_registration(path, arrays):
    """Write the arrays (dict) of a registration, with their checksum and the format's version; whole or not at all."""
    arrays = {**{name: np.asarray(array) for name, array in arrays.items()}, "format_version": np.array(FORMAT_VERSION)}
    data = io.BytesIO()
    np.savez_compressed(data, **arrays, checksum=np.array(_checksum(arrays)))
    write_whole(Path(path), lambda place: place.write_bytes(data.getvalue()), len(data.getvalue()))


def read_registration(path):
    """The arrays of a registration.npz (dict), disk_map (V,), disk_control (W,), faces_moving (F, 3), faces_control
    (G, 3) at least; SurfaceError, naming the file, where an array, a mesh or the checksum is not sound."""
    path = Path(path)
    data = read_bytes(path)
    with explain(path, "registration.npz", lead="not a"):
        arrays = npz_arrays(data, lambda name: True)
        missing = [name for name in _REQUIRED if name not in arrays]
        if missing:
            lacks = f"not a registration.npz of this program (it lacks {', '.join(missing)})"
            raise SurfaceError(f"{lacks}; give the one that `qclearn register` wrote")
        _check_version(arrays)
        for name, like, row, kinds in _SHAPES:
            if name in arrays:
                _check_shape(name, arrays[name], (len(np.atleast_1d(arrays[like])), *row), kinds)
        for side, disk in (("moving", "disk_map"), ("control", "disk_control")):
            _check_mesh(arrays, disk, f"faces_{side}")
        if "checksum" in arrays and str(arrays.pop("checksum")) != _checksum(arrays):
            raise _damaged("its checksum is not that of its arrays")
    return arrays


def _check_version(arrays):
    version = arrays.get("format_version", np.array(FORMAT_VERSION))
    if version.shape != () or version.dtype.kind not in "iu" or version < 1:
        raise _damaged("its format_version is no number")
    if version > FORMAT_VERSION:
        formats = f"format {version}, here {FORMAT_VERSION}"
        raise SurfaceError(f"written by a newer version of this program ({formats}); update qclearn")


def _check_shape(name, array, shape, kinds):
    if array.shape != shape or array.dtype.kind not in kinds:
        raise _damaged(f"{name} is {array.dtype} of shape {array.shape}, where {shape} is needed")
    bad = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
    if bad.size:
        raise _damaged(f"{name} is not finite at {bad.size} places, the first {bad[0]}")


def _check_mesh(arrays, name, triangles):
    """SurfaceError unless the faces use all points and lay them into the unit disk without a fold."""
    z, faces = arrays[name], arrays[triangles]
    outside = np.flatnonzero(abs(z) > 1 + 1e-6)
    if outside.size:
        raise _damaged(f"{name} leaves the unit disk at {outside.size} vertices, the first {outside[0]}")
    if not np.array_equal(np.unique(faces), np.arange(len(z))):
        raise _damaged(f"the faces of {name} do not use its {len(z)} vertices, each at least once")
    flipped = Disk(z, faces).certificate.flipped
    if len(flipped):
        raise _damaged(f"{name} is folded at {len(flipped)} faces, the first {flipped[0]}")


def _damaged(what):
    return SurfaceError(f"not a sound registration.npz: {what}; run `qclearn register` again, or copy the file again.")


def _checksum(arrays):
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
