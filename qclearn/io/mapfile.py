"""registration.npz: the maps of a registration, and what its files said of both surfaces."""

from pathlib import Path

import numpy as np

from ..surfaces.surface import SurfaceError
from .frames import frame_of_text
from .hemisphere import Numbering
from .safe import explain, npz_arrays, npz_bytes, read_bytes, write_whole

# Raise it when an array's meaning changes, so that old programs do not misread new files.
FORMAT_VERSION = 2
# Without these nothing can be carried; version 0.1 wrote no "about" and no "mirrored".
SIDED = [f"{name}_{side}" for name in ("faces", "about") for side in ("moving", "control")]
REQUIRED = ["disk_map", "disk_control", *SIDED, "mirrored"]
# (array, the array whose length is its count, shape of one row, kinds of numbers)
SHAPES = (
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
    """The `Frame` of a side's file from the arrays of a registration.npz."""
    return frame_of_text(arrays[f"about_{side}"], arrays.get(f"whole_faces_{side}"))


def numbering_of_side(arrays, side):
    """The `Numbering` of a side from the arrays of a registration.npz."""
    size = len(arrays["disk_map" if side == "moving" else "disk_control"])
    return Numbering(size, arrays.get(f"table_{side}"), frame_of_side(arrays, side).count)


def write_registration(path, arrays):
    """Write the arrays (dict) of a registration with the format's version; whole or not at all."""
    data = npz_bytes(arrays | {"format_version": np.array(FORMAT_VERSION)})
    write_whole(Path(path), lambda place: place.write_bytes(data))


def read_registration(path):
    """The arrays of a registration.npz (dict), REQUIRED ones at least: disk_map (V,), disk_control
    (W,), faces_moving (F, 3), faces_control (G, 3), and those of `side_arrays`.

    SurfaceError, naming the file, where one is missing, of another count or kind, or not finite, or
    where the file is of version 0.1 or of a newer one.
    """
    data = read_bytes(Path(path))
    with explain(path, "registration.npz", lead="not a"):
        arrays = npz_arrays(data)
        missing = [name for name in REQUIRED if name not in arrays]
        if missing:
            raise SurfaceError(
                f"not a registration.npz of this program, or one of version 0.1 (it lacks "
                f"{', '.join(missing)}); run `qclearn register` again"
            )
        version = arrays.get("format_version", FORMAT_VERSION)
        if version > FORMAT_VERSION:
            raise SurfaceError(
                f"written by a newer version of this program (format {version}, here "
                f"{FORMAT_VERSION}); update qclearn"
            )
        # Arrays fit together, and hold numbers.
        faults = []
        for name, like, row, kinds in SHAPES:
            array = arrays.get(name)
            if array is None:
                continue
            shape = (len(np.atleast_1d(arrays[like])), *row)
            if array.shape != shape or array.dtype.kind not in kinds:
                faults.append(f"{name} is {array.dtype} of shape {array.shape}, not {shape}")
            elif not np.isfinite(array).all():
                faults.append(f"{name} is not finite at {(~np.isfinite(array)).sum()} places")
        for side, disk in (("moving", "disk_map"), ("control", "disk_control")):
            count = arrays[f"faces_{side}"].max(initial=-1) + 1
            if not faults and count != len(arrays[disk]):
                faults.append(f"faces_{side} have {count} vertices, {disk} {len(arrays[disk])}")
            frame_of_side(arrays, side)  # it refuses what it does not understand
        if faults:
            raise SurfaceError(
                f"not a sound registration.npz: {faults[0]}; run `qclearn register` again, or copy "
                "the file again"
            )
    return arrays
