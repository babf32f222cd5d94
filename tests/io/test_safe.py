"""Files are read within bounds and written whole."""

import errno
import gzip
import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from qclearn.io.meshes import read_surface
from qclearn.io.safe import (
    ROOM,
    FormatError,
    explain,
    npy_array,
    npz_arrays,
    own_prefix,
    printable,
    read_bytes,
    sweep,
    write_whole,
)
from qclearn.io.values import read_values, write_values
from qclearn.surfaces.surface import SurfaceError


def test_pipes_and_devices_are_refused_by_name(tmp_path):
    os.mkfifo(tmp_path / "s.ply")
    for path, what in ((tmp_path / "s.ply", "a pipe"), (Path("/dev/zero"), "a device")):
        with pytest.raises(SurfaceError, match=f"{path}: is {what}, not a regular file"):
            read_bytes(path)


def test_what_unzips_to_far_more_than_its_size_is_refused(tmp_path):
    path = tmp_path / "v.func.gii.gz"
    path.write_bytes(gzip.compress(bytes(ROOM + 1)))
    with pytest.raises(SurfaceError, match=f"unzip to more than {ROOM}.*gunzip"):
        read_values(path)
    path.write_bytes(gzip.compress(bytes(1000)))
    assert read_bytes(path) == bytes(1000)


def npz(**members):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return packed.getvalue()


def npy(array):
    data = io.BytesIO()
    np.save(data, array)
    return data.getvalue()


def test_arrays_hold_what_they_announce():
    data = npy(np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(npy_array(data), [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(npy_array(npy(np.asfortranarray(np.eye(3, 2)))), np.eye(3, 2))
    with pytest.raises(FormatError, match=r"shape \(9, 3\) takes 216 bytes, 48 are there"):
        npy_array(data.replace(b"(2, 3)", b"(9, 3)"))
    with pytest.raises(FormatError, match="Python objects"):
        npy_array(npy(np.array([None])))
    assert set(npz_arrays(npz(a=data, b=b"no array"), lambda name: name == "a")) == {"a"}
    with pytest.raises(FormatError, match="unpack to"):
        npz_arrays(npz(a=bytes(ROOM + 1)), lambda name: True)


def test_a_lack_of_memory_names_the_file_and_a_way_out(tmp_path, monkeypatch):
    path = tmp_path / "s.off"
    path.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")

    def greedy(*_):
        raise MemoryError

    for place in ("qclearn.io.meshes.Surface", "qclearn.io.meshformats._integers", "pathlib.Path.read_bytes"):
        with monkeypatch.context() as patch:
            patch.setattr(place, greedy)
            with pytest.raises(SurfaceError, match="s.off: there is not enough memory.*coarser"):
                read_surface(path)
    assert len(read_surface(path).faces) == 1


@pytest.mark.parametrize("error", [KeyError("x"), TypeError("x"), IndexError("x"), AttributeError("x")])
def test_a_bug_is_no_bad_input(error):
    with pytest.raises(type(error)), explain("f", "file"):
        raise error


def test_what_a_library_or_bad_numbers_raise_is_bad_input():
    for bad in (lambda: int("x"), lambda: npz_arrays(b"PK", bool), lambda: np.lib.format.read_magic(3)):
        with pytest.raises(SurfaceError, match="f: not a readable file.*again"), explain("f", "file"):
            bad()


def test_killed_runs_leave_nothing_for_long(tmp_path):
    """A process that is killed while it writes leaves a file and a folder; the next write takes
    them away, and nothing that belongs to a running process, to another machine or to others."""
    code = (
        "import os, sys; from pathlib import Path; from qclearn.io.safe import own_prefix, "
        "write_whole\n"
        "os.makedirs(sys.argv[1] + '/' + own_prefix() + 'abcdefgh/inner')\n"
        "write_whole(Path(sys.argv[1], 'v.npy'), lambda place: os.kill(os.getpid(), 9))"
    )
    killed = subprocess.run([sys.executable, "-c", code, tmp_path], check=False)
    assert killed.returncode == -9 and len(list(tmp_path.iterdir())) == 2
    own = tmp_path / f"{own_prefix()}abcdefgh"
    others = [own, tmp_path / ".qclearn-1@elsewhere.else-abcdefgh", tmp_path / ".qclearn-notes", tmp_path / "data"]
    for path in others:
        path.touch()
    sweep(tmp_path)
    assert sorted(tmp_path.iterdir()) == sorted(others)
    write_values(tmp_path / "v.npy", np.ones(3))
    assert sorted(tmp_path.iterdir()) == sorted([*others, tmp_path / "v.npy"])


def test_a_full_disk_says_what_is_needed_and_missing(tmp_path, monkeypatch):
    def full(place):
        place.write_bytes(bytes(2_000_000))
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=500_000))
    with pytest.raises(
        SurfaceError,
        match=r"x.npz: the disk is full .*No space left.*about 3.00 MB are needed, 0.50 MB are free, "
        "2.50 MB are missing; make room",
    ):
        write_whole(tmp_path / "x.npz", full, size=3_000_000)
    with pytest.raises(SurfaceError, match="2.00 MB were written and more is needed"):
        write_whole(tmp_path / "x.npz", full)
    assert list(tmp_path.iterdir()) == []


def test_what_reaches_the_terminal_is_one_harmless_line():
    assert printable("a\x1b]0;x\x07\nb\u202e") == r"a\x1b]0;x\x07 b\u202e"
    assert printable("über µ") == "über µ"
    assert len(printable("A" * 10**6)) < 2100
