"""registration.npz comes back as it was written, and is refused where it is damaged."""

from types import SimpleNamespace

import numpy as np
import pytest

from freesurfer import GEOMETRY
from qclearn.io.frames import Frame
from qclearn.plane.grids import polar_disk
from qclearn.registration.transfer import (
    frame_of_side,
    numbering_of_side,
    read_registration,
    side_arrays,
    write_registration,
)
from qclearn.surfaces.surface import SurfaceError

TABLE = np.r_[0:10, 12:30]
FRAME = Frame("right", "tkr", GEOMETRY, "Pial", 30, np.array([[0, 1, 29]]))


@pytest.fixture
def arrays():
    z, faces = polar_disk(3, 9)
    return {
        "disk_map": z * np.exp(0.5j),
        "disk_control": z,
        "faces_moving": faces,
        "faces_control": faces,
        "points": np.zeros((len(z), 3)),
        "mu": np.zeros(len(faces), complex),
        **side_arrays("moving", SimpleNamespace(vertices=np.ones((len(z), 3)), original_vertices=TABLE), FRAME),
        "mirrored": np.array(True),
    }


def test_it_keeps_what_the_files_said_and_one_of_format_1_is_still_read(tmp_path, arrays):
    write_registration(tmp_path / "r.npz", arrays)
    kept = read_registration(tmp_path / "r.npz")
    assert frame_of_side(kept, "moving") == FRAME and kept["mirrored"]
    assert numbering_of_side(kept, "moving").known and not numbering_of_side(kept, "control").known
    np.testing.assert_array_equal(frame_of_side(kept, "moving").whole, FRAME.whole)
    old = {name: arrays[name] for name in ("disk_map", "disk_control", "faces_moving", "faces_control")}
    np.savez(tmp_path / "r.npz", **old, format_version=1)
    with pytest.raises(SurfaceError, match="older version.*run `qclearn register` again"):
        read_registration(tmp_path / "r.npz", surfaces=True)
    assert frame_of_side(read_registration(tmp_path / "r.npz"), "moving") == Frame()


def test_it_comes_back_with_or_without_a_checksum(tmp_path, arrays):
    path = tmp_path / "registration.npz"
    for write in (lambda: write_registration(path, arrays), lambda: np.savez(path, **arrays)):
        write()
        for name, array in read_registration(path).items():
            np.testing.assert_array_equal(array, arrays.get(name, 2))  # 2: the format's version


def folded(z):
    z = z.copy()
    z[0] = 0.9
    return z


@pytest.mark.parametrize("name, change, message", [
    ("disk_map", lambda z: z[:-1], "faces of disk_map do not use"),
    ("disk_control", lambda z: z[:-1], "faces of disk_control"),
    ("disk_map", lambda z: z * np.nan, "disk_map is not finite at 28"),
    ("disk_map", lambda z: 2 * z, "leaves the unit disk"),
    ("disk_map", lambda z: z.real, "disk_map is float64"), ("disk_map", lambda z: z.conj(), "disk_map is folded"),
    ("disk_control", folded, "disk_control is folded"),
    ("faces_moving", lambda f: f + 1, "faces of disk_map do not use"),
    ("faces_control", lambda f: f.astype(float), "faces_control is float64"),
    ("faces_moving", lambda f: f[:, :2], "faces_moving is int64 of shape"),
    ("points", lambda p: p[:-1], "points is float64 of shape"),
    ("points", lambda p: p + np.inf, "points is not finite"),
    ("mu", lambda m: m[:-2], "mu is complex128 of shape"),
    ("vertices_moving", lambda v: v[:-1], "vertices_moving is float32 of shape"),
    ("table_moving", lambda t: 0 * t, "table_moving names a vertex twice"),
    ("table_moving", lambda t: t + 2, "table_moving names vertex 31 of a surface of 30"),
    ("whole_faces_moving", lambda f: f - 1, "whole_faces_moving are not of a surface of 30 vertices"),
    ("about_moving", lambda _: np.array("{"), "about_moving: .* cannot be understood"),
    ("about_moving", lambda t: np.array(str(t).replace("right", "up")), "about_moving: .* makes no sense"),
    ("format_version", lambda _: np.array(3), "newer version.*update"),
])  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, arrays, name, change, message):
    """Without a checksum, as other programs may write it."""
    for other in {"points", "vertices_moving", "table_moving"} - {name}:
        del arrays[other]  # whose length would be found wrong first
    arrays[name] = change(arrays.get(name))
    np.savez(tmp_path / "r.npz", **arrays)
    with pytest.raises(SurfaceError, match=f"r.npz: .*{message}"):
        read_registration(tmp_path / "r.npz")


def test_a_change_that_is_sound_in_itself_is_seen_by_the_checksum(tmp_path, arrays):
    write_registration(tmp_path / "r.npz", arrays)
    with np.load(tmp_path / "r.npz") as file:
        written = dict(file)
    np.savez(tmp_path / "r.npz", **written | {"disk_map": -written["disk_map"]})
    with pytest.raises(SurfaceError, match="r.npz: .*checksum"):
        read_registration(tmp_path / "r.npz")
