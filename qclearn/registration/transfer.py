"""Values at vertices, carried from one surface to the other."""

import hashlib
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Complex, Integer, Num
from numpy import ndarray

from ..io.frames import Frame, frame_of_text
from ..io.hemisphere import Numbering
from ..io.safe import FormatError, explain, npz_arrays, npz_bytes, read_bytes, write_whole
from ..plane.disk import Disk
from ..surfaces.surface import SurfaceError


def transfer(
    values: Num[ndarray, " V *k"] | Bool[ndarray, " V *k"],
    z_from: Complex[ndarray, " V"],
    faces_from: Integer[ndarray, " F 3"],
    z_to: Complex[ndarray, " P"],
    nearest: bool = False,
) -> Num[ndarray, " P *k"] | Bool[ndarray, " P *k"]:
    """Per-vertex values of one disk mesh carried to the points z_to of the same disk.

    From control to moving: `transfer(values, disk_control, faces_control, disk_map)`; back:
    `transfer(values, disk_map, faces_moving, disk_control)`. Linear in each triangle, or with
    `nearest` the value of the corner with the largest weight (for labels). ValueError if the count
    of values is not that of the vertices.
    """
    values = np.asarray(values)
    if len(values) != len(z_from):
        raise ValueError(
            f"{len(values)} values for {len(z_from)} vertices: give one a vertex of the surface "
            "they come from (the cut-open one, if it was cut)"
        )
    disk = Disk(z_from, faces_from)
    face, weights = disk.locate(z_to)
    if nearest:
        return values[disk.faces[face, weights.argmax(1)]]
    return disk.interpolate(values, (face, weights))


# Raise it when an array's meaning changes, so that old programs do not misread new files.
FORMAT_VERSION = 2
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
    ("table_moving", "disk_map", (), "iu"),
    ("table_control", "disk_control", (), "iu"),
)


def side_arrays(side, surface, frame):
    """What registration.npz keeps of a side, "moving" or "control": a surface as registered and its
    file's `Frame`.

    vertices_SIDE (V, 3); about_SIDE, the Frame as JSON; where they are known, table_SIDE (V,), the
    vertices' numbers in the whole surface, and whole_faces_SIDE (F0, 3), that surface's faces, not
    mirrored.
    """
    arrays = {"vertices": surface.vertices.astype(np.float32), "about": np.array(frame.text)}
    if surface.original_vertices is not None:
        arrays["table"] = surface.original_vertices.astype(np.int32)
    if frame.whole is not None:
        arrays["whole_faces"] = np.asarray(frame.whole, dtype=np.int32)
    return {f"{name}_{side}": array for name, array in arrays.items()}


def frame_of_side(arrays, side):
    """The `Frame` of a side's file from the arrays of a registration.npz, an empty one for format
    1."""
    if f"about_{side}" not in arrays:
        return Frame()
    return frame_of_text(arrays[f"about_{side}"], arrays.get(f"whole_faces_{side}"))


def numbering_of_side(arrays, side):
    """The `Numbering` of a side from the arrays of a registration.npz."""
    size = len(arrays["disk_map" if side == "moving" else "disk_control"])
    return Numbering(size, arrays.get(f"table_{side}"), frame_of_side(arrays, side).count)


def write_registration(path, arrays):
    """Write the arrays (dict) of a registration, with their checksum and the format's version;
    whole or not at all."""
    arrays = {
        **{name: np.asarray(array) for name, array in arrays.items()},
        "format_version": np.array(FORMAT_VERSION),
    }
    data = npz_bytes({**arrays, "checksum": np.array(_checksum(arrays))})
    write_whole(Path(path), lambda place: place.write_bytes(data), len(data))


def read_registration(path, surfaces=False):
    """The arrays of a registration.npz (dict), disk_map (V,), disk_control (W,), faces_moving (F,
    3), faces_control (G, 3) at least; SurfaceError, naming the file, where an array, a mesh or the
    checksum is not sound.

    surfaces: also those of `side_arrays` and `mirrored`, which format 1 lacks; one of that format
    is then refused.
    """
    path = Path(path)
    data = read_bytes(path)
    with explain(path, "registration.npz", lead="not a"):
        arrays = npz_arrays(data, lambda name: True)
        missing = [name for name in _REQUIRED if name not in arrays]
        if missing:
            raise SurfaceError(
                f"not a registration.npz of this program (it lacks {', '.join(missing)}); give the "
                "one that `qclearn register` wrote"
            )
        _check_version(arrays)
        for name, like, row, kinds in _SHAPES:
            if name in arrays:
                _check_shape(name, arrays[name], (len(np.atleast_1d(arrays[like])), *row), kinds)
        given = str(arrays.pop("checksum", ""))
        if given != _checksum(arrays):
            for side, disk in (("moving", "disk_map"), ("control", "disk_control")):
                _check_mesh(arrays, disk, f"faces_{side}")
                _check_whole(arrays, side)
            if given:
                raise _damaged("its checksum is not that of its arrays")
        if surfaces and not {"about_moving", "about_control", "mirrored"} <= set(arrays):
            raise SurfaceError(
                "written by an older version, which kept no surfaces; run `qclearn register` again"
            )
    return arrays


def _check_version(arrays):
    version = arrays.get("format_version", np.array(FORMAT_VERSION))
    if version.shape != () or version.dtype.kind not in "iu" or version < 1:
        raise _damaged("its format_version is no number")
    if version > FORMAT_VERSION:
        raise SurfaceError(
            f"written by a newer version of this program (format {version}, here "
            f"{FORMAT_VERSION}); update qclearn"
        )


def _check_shape(name, array, shape, kinds):
    if array.shape != shape or array.dtype.kind not in kinds:
        raise _damaged(f"{name} is {array.dtype} of shape {array.shape}, where {shape} is needed")
    bad = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
    if bad.size:
        raise _damaged(f"{name} is not finite at {bad.size} places, the first {bad[0]}")


def _check_mesh(arrays, name, triangles):
    """SurfaceError unless the faces use all points and lay them into the unit disk without a
    fold."""
    z = arrays[name]
    faces = arrays[triangles]
    outside = np.flatnonzero(abs(z) > 1 + 1e-6)
    if outside.size:
        raise _damaged(
            f"{name} leaves the unit disk at {outside.size} vertices, the first {outside[0]}"
        )
    if not np.array_equal(np.unique(faces), np.arange(len(z))):
        raise _damaged(f"the faces of {name} do not use its {len(z)} vertices, each at least once")
    flipped = Disk(z, faces).certificate.flipped
    if len(flipped):
        raise _damaged(f"{name} is folded at {len(flipped)} faces, the first {flipped[0]}")


def _check_whole(arrays, side):
    """SurfaceError unless the arrays on the whole surface of a side fit together."""
    table = arrays.get(f"table_{side}")
    whole = arrays.get(f"whole_faces_{side}")
    if f"about_{side}" not in arrays:
        return
    try:
        count = frame_of_side(arrays, side).count
    except FormatError as error:
        raise _damaged(f"about_{side}: {error}") from None
    if table is not None and (table.min() < 0 or len(np.unique(table)) < len(table)):
        raise _damaged(f"table_{side} names a vertex twice, or one below 0")
    if table is not None and count is not None and table.max() >= count:
        raise _damaged(f"table_{side} names vertex {table.max()} of a surface of {count}")
    if whole is not None:
        _check_shape(f"whole_faces_{side}", whole, (len(np.atleast_1d(whole)), 3), "iu")
        if whole.min() < 0 or whole.max() + 1 != count:
            raise _damaged(f"whole_faces_{side} are not of a surface of {count} vertices")


def _damaged(what):
    return SurfaceError(
        f"not a sound registration.npz: {what}; run `qclearn register` again, or copy the file "
        "again."
    )


def _checksum(arrays):
    digest = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        digest.update(
            f"{name} {array.dtype.str} {array.shape} ".encode()
            + np.ascontiguousarray(array).tobytes()
        )
    return digest.hexdigest()
