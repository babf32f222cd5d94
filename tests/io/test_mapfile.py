"""registration.npz comes back as it was written, and is refused where its arrays do not fit."""

from types import SimpleNamespace

import numpy as np
import pytest

from freesurfer import GEOMETRY
from qclearn.io.frames import Frame
from qclearn.io.mapfile import frame_of_side, numbering_of_side, read_registration, side_arrays, write_registration
from qclearn.plane.grids import polar_disk
from qclearn.surfaces.surface import SurfaceError

TABLE = np.r_[0:10, 12:30]
FRAME = Frame("right", "tkr", GEOMETRY, "Pial", 30, np.array([[0, 1, 29]]))


@pytest.fixture
def arrays():
    z, faces = polar_disk(3, 9)
    cut = SimpleNamespace(vertices=np.ones((len(z), 3)), original_vertices=TABLE)
    uncut = SimpleNamespace(vertices=np.ones((len(z), 3)), original_vertices=None)
    return {
        "disk_map": z * np.exp(0.5j),
        "disk_control": z,
        "faces_moving": faces,
        "faces_control": faces,
        "points": np.zeros((len(z), 3)),
        "mu": np.zeros(len(faces), complex),
        **side_arrays("moving", cut, FRAME),
        **side_arrays("control", uncut, Frame()),
        "mirrored": np.array(True),
    }


def test_it_comes_back_with_what_the_files_said(tmp_path, arrays):
    write_registration(tmp_path / "r.npz", arrays)
    kept = read_registration(tmp_path / "r.npz")
    assert set(kept) == {*arrays, "format_version"}
    for name, array in arrays.items():
        np.testing.assert_array_equal(kept[name], array)
    assert frame_of_side(kept, "moving") == FRAME and frame_of_side(kept, "control") == Frame()
    np.testing.assert_array_equal(frame_of_side(kept, "moving").whole, FRAME.whole)
    assert numbering_of_side(kept, "moving").known and not numbering_of_side(kept, "control").known


@pytest.mark.parametrize("name, change, message", [
    ("disk_map", lambda z: z[:-1], r"points is float64 of shape \(28, 3\), not \(27, 3\)"),
    ("disk_control", lambda z: z[:-1], "vertices_control is float32"),
    ("disk_map", lambda z: z * np.nan, "disk_map is not finite at 28"),
    ("disk_map", lambda z: z.real, "disk_map is float64"),
    ("faces_moving", lambda f: f + 1, "faces_moving have 29 vertices, disk_map 28"),
    ("faces_control", lambda f: f.astype(float), "faces_control is float64"),
    ("faces_moving", lambda f: f[:, :2], "faces_moving is int64 of shape"),
    ("points", lambda p: p + np.inf, "points is not finite"),
    ("mu", lambda m: m[:-2], "mu is complex128 of shape"),
    ("vertices_moving", lambda v: v[:-1], "vertices_moving is float32 of shape"),
    ("table_moving", lambda t: t[1:], "table_moving is int32 of shape"),
    ("about_moving", lambda _: np.array("{"), "cannot be understood"),
    ("format_version", lambda _: np.array(3), "newer version.*update"),
    ("about_control", None, r"or one of version 0.1 \(it lacks about_control\); run `qclearn register` again"),
])  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, arrays, name, change, message):
    """Of a file that another program wrote."""
    changed = {name: change(arrays.get(name))} if change else {}
    np.savez(tmp_path / "r.npz", **{key: array for key, array in arrays.items() if key != name}, **changed)
    with pytest.raises(SurfaceError, match=f"r.npz: .*{message}"):
        read_registration(tmp_path / "r.npz")
