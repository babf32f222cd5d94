"""Files are read with one kind of error and written whole or not at all."""

import errno

import numpy as np
import pytest

from qclearn.io.safe import FormatError, explain, npz_arrays, npz_bytes, printable, read_bytes, write_whole
from qclearn.surfaces.surface import SurfaceError


def test_the_arrays_of_an_npz_come_back_and_others_are_not_looked_at():
    data = npz_bytes({"a": np.eye(3, 2), "b": np.array([None])})
    with pytest.raises(ValueError, match="allow_pickle"):
        npz_arrays(data)
    np.testing.assert_array_equal(npz_arrays(data, lambda name: name == "a")["a"], np.eye(3, 2))


@pytest.mark.parametrize("content", [
    b"../.git/annex/objects/1j/8k/MD5E-s5--1.pial", b"/annex/objects/MD5E-s5--1\n",
    b"version https://git-lfs.github.com/spec/v1\noid sha256:1",
])  # fmt: skip
def test_a_pointer_in_the_place_of_a_file_is_told(tmp_path, content):
    """Of DataLad and Git LFS; and a link that leads nowhere."""
    (tmp_path / "lh.pial").write_bytes(content)
    with pytest.raises(SurfaceError, match=r"lh.pial: only points to the file; .*datalad get, git lfs pull"):
        read_bytes(tmp_path / "lh.pial")
    (tmp_path / "lh.white").symlink_to("lh.gone")
    with pytest.raises(SurfaceError, match="lh.white: cannot be read .*check the link to lh.gone"):
        read_bytes(tmp_path / "lh.white")


@pytest.mark.parametrize("error", [KeyError("x"), TypeError("x"), IndexError("x"), AttributeError("x")])
def test_a_bug_is_no_bad_input(error):
    with pytest.raises(type(error)), explain("f", "file"):
        raise error


def test_what_a_library_or_bad_numbers_raise_is_bad_input():
    for bad in (lambda: int("x"), lambda: npz_arrays(b"PK"), lambda: np.lib.format.read_magic(3)):
        with pytest.raises(SurfaceError, match="f: not a readable file.*again"), explain("f", "file"):
            bad()
    with pytest.raises(SurfaceError, match="f: not a readable file: too few; .*again"), explain("f", "file"):
        raise FormatError("too few")


@pytest.mark.parametrize("stop, words", [
    (OSError(errno.ENOSPC, "No space left on device"), "a.ply: cannot be written .No space left on device"),
    (SystemExit(143), "143"),  # as the command line has SIGTERM
])  # fmt: skip
def test_a_write_that_ends_early_leaves_the_old_file_and_nothing_else(tmp_path, stop, words):
    def half(place):
        place.write_bytes(b"new")
        raise stop

    path = tmp_path / "a.ply"
    path.write_bytes(b"old")
    with pytest.raises((SurfaceError, SystemExit), match=words):
        write_whole(path, half)
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_what_reaches_the_terminal_is_one_harmless_line():
    assert printable("a\x1b]0;x\x07\nb\u202e") == r"a\x1b]0;x\x07 b\u202e"
    assert printable("über µ") == "über µ"
    assert len(printable("A" * 10**6)) < 2100
