"""Files read within bounds and written whole: what every reader and writer here goes through.

Bytes have to bear out what a file announces, so its size bounds a reader's memory; a file that a
killed or failed run began never stands under the name that was asked for.
"""

import errno
import gzip
import io
import math
import os
import platform
import re
import shutil
import stat
import struct
import uuid
import warnings
import zipfile
import zlib
from contextlib import contextmanager
from xml.parsers.expat import ExpatError

import numpy as np

from ..surfaces.surface import SurfaceError

# Unpacked, a file may hold so many times its own bytes, or so many bytes where that is more.
# Coordinates and faces shrink 2 to 6 times, a map that is zero nearly everywhere up to 1000 times,
# but then it is short.
RATIO = 100
ROOM = 64 << 20
_LEFTOVER = re.compile(r"\.qclearn-(\d{1,9})@(.*)-\w{8}(-.*)?", re.DOTALL)
_AGAIN = "it may be cut short or of another format: copy or export it again"
# Errors of bad bytes by their kind; of any other kind only where one of these libraries raised it.
_BAD_BYTES = (
    ValueError, OverflowError, EOFError, OSError,
    struct.error, zlib.error, zipfile.BadZipFile, ExpatError,
)  # fmt: skip
# What XML cannot hold, nor UTF-8 (surrogates), nor a reader give back (a carriage return).
_UNSOUND = re.compile("[^\t\n -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_LIBRARIES = {"nibabel", "numpy", "plyfile", "zipfile", "gzip", "xml", "ast", "tokenize", "json"}


class FormatError(ValueError):
    """What is wrong in the bytes of a file; the reader adds the path and the remedy."""


class LeftOutWarning(UserWarning):
    """What a reader leaves out of a file that is sound otherwise."""


def allowance(size):
    """How many bytes a file of `size` bytes may unpack to."""
    return max(ROOM, RATIO * size)


def read_bytes(path):
    """All bytes of a regular file, unzipped if it is a .gz or .mgz; SurfaceError."""
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # reading it might never end
            pipe_or_socket = "a pipe" if stat.S_ISFIFO(mode) else "a socket"
            kind = "a device" if stat.S_ISCHR(mode) or stat.S_ISBLK(mode) else pipe_or_socket
            advice = "save what it gives in a file first"
            raise SurfaceError(f"{path}: is {kind}, not a regular file; {advice}")
        data = path.read_bytes()
        if path.suffix.lower() in (".gz", ".mgz"):
            data = _unzipped(path, data)
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error  # damaged gzip has none
        advice = "check the name and copy the file again"
        raise SurfaceError(f"{path}: cannot be read ({reason}); {advice}") from None
    except MemoryError:
        raise out_of_memory(path) from None
    if not data:
        raise SurfaceError(f"{path}: the file is empty; copy or export it again")
    return data


def _unzipped(path, data):
    most = allowance(len(data))
    with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
        unzipped = file.read(most + 1)
    if len(unzipped) > most:
        message = f"{len(data)} bytes unzip to more than {most}, as no surface does"
        raise SurfaceError(f"{path}: {message}; if it is sound, gunzip it first")
    return unzipped


def out_of_memory(path):
    """The SurfaceError for a file that the memory has no room for."""
    advice = "close other programs or give a coarser surface"
    return SurfaceError(f"{path}: there is not enough memory; {advice}")


@contextmanager
def naming(path):
    """Let a SurfaceError of the block name the file, or a lack of memory become one that does."""
    try:
        yield
    except SurfaceError as error:
        raise SurfaceError(f"{path}: {error}") from None
    except MemoryError:
        raise out_of_memory(path) from None


@contextmanager
def explain(path, kind, lead="not a readable"):
    """Turn what parsers raise on bad bytes into one SurfaceError, "PATH: not a readable KIND ...".

    A KeyError, TypeError and the like pass as they are unless a library raised them: in our own
    code they are bugs.
    """
    try:
        with naming(path), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", LeftOutWarning)
            yield
    except SurfaceError:
        raise
    except FormatError as error:
        raise SurfaceError(f"{path}: {lead} {kind}: {error}; {_AGAIN}") from None
    except Exception as error:
        if not _of_bad_bytes(error):
            raise
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise SurfaceError(f"{path}: {lead} {kind} ({reason}); {_AGAIN}") from error


def _of_bad_bytes(error):
    trace = error.__traceback__
    while trace.tb_next:
        trace = trace.tb_next
    module = trace.tb_frame.f_globals.get("__name__", "")
    return isinstance(error, _BAD_BYTES) or module.split(".")[0] in _LIBRARIES


def require_all(name, there, announced, exactly=False):
    """FormatError unless as many records are there as were announced, or (unless exactly) more."""
    if announced < 0 or there < announced or (exactly and there > announced):
        raise FormatError(f"{announced} {name} records are announced, {there} are there")


def npz_arrays(data, wanted):
    """The arrays (dict) of an npz's bytes that `wanted` accepts by name; FormatError for bad sizes."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        infos = archive.infolist()
        members = [info for info in infos if wanted(info.filename.removesuffix(".npy"))]
        size = sum(info.file_size for info in members)
        most = allowance(len(data))
        if size > most:
            limit = f"those of a surface to {most} at most"
            raise FormatError(f"its arrays would unpack to {size} bytes, and {limit}")
        names = [info.filename.removesuffix(".npy") for info in members]
        return {name: npy_array(archive.read(info)) for name, info in zip(names, members)}


def npz_bytes(arrays):
    """The bytes of an npz file of arrays (dict), packed lightly: three times as fast as NumPy."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy")
            archive.writestr(info, member.getvalue(), zipfile.ZIP_DEFLATED, compresslevel=1)
    return data.getvalue()


def npy_array(data):
    """The array of a .npy file's bytes; FormatError unless the header announces what follows."""
    file = io.BytesIO(data)
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    version = np.lib.format.read_magic(file)
    if version not in headers:
        raise FormatError(f"the NumPy format {version} is not read here")
    shape, fortran, dtype = headers[version](file)
    if dtype.hasobject:
        raise FormatError("it holds Python objects, not numbers")
    announced = math.prod(shape) * dtype.itemsize
    there = len(data) - file.tell()
    if min(shape, default=0) < 0 or announced != there:
        size = f"takes {announced} bytes, {there} are there"
        raise FormatError(f"an array of the shape {shape} {size}")
    numbers = np.frombuffer(data, dtype, offset=file.tell())
    array = numbers.reshape(shape, order="F" if fortran else "C")
    return array.astype(dtype.newbyteorder("="))


def write_whole(path, write, size=None):
    """Let `write(temporary_path)` write a file that takes its place in one step; SurfaceError.

    size: its bytes, about, for a full disk's message. Leftovers of killed runs go from the folder.
    """
    sweep(path.parent)
    # in the same folder: the last step is atomic
    temporary = path.with_name(f"{own_prefix()}{uuid.uuid4().hex[:8]}-{path.name}")
    written = 0
    free = None
    try:
        temporary.touch(exist_ok=False)
        try:
            write(temporary)
            os.replace(temporary, path)
        finally:
            if temporary.exists():
                written = temporary.stat().st_size
                free = shutil.disk_usage(path.parent).free
            temporary.unlink(missing_ok=True)
    except OSError as error:
        if is_full(error, free):
            raise SurfaceError(f"{path}: {full_disk(path.parent, written, size)}") from None
        message = f"cannot be written ({error.strerror or error})"
        advice = "choose a folder that exists and is writable"
        raise SurfaceError(f"{path}: {message}; {advice}") from None


def is_full(error, free=None):
    """Whether an OSError means a full disk; `free` bytes decide where it has no errno."""
    if error.errno is None:  # NumPy's says only how much was written
        return free is not None and free < 1 << 16
    return error.errno in (errno.ENOSPC, errno.EDQUOT)


def full_disk(folder, written, size=None):
    """The message for a full disk: what is needed, free and missing."""
    free = shutil.disk_usage(folder).free
    if size is None:
        need = f"{_megabytes(written)} were written and more is needed, {_megabytes(free)} are free"
    else:
        missing = _megabytes(max(size - free, 0))
        need = f"about {_megabytes(size)} are needed, {_megabytes(free)} are free, {missing} are missing"
    return f"the disk is full (No space left on device): {need}; make room, or choose a folder on another disk"


def _megabytes(size):
    return f"{size / 1e6:.2f} MB"


def own_prefix():
    """The head of temporary names: this process's number and machine, by which `sweep` knows it."""
    return f".qclearn-{os.getpid()}@{_machine()}-"


def _machine():
    return re.sub(r"[^\w.]", "_", platform.node())[:40]


def sweep(folder):
    """Remove the leftovers of this machine's killed runs from a folder."""
    for leftover in folder.glob(".qclearn-*"):
        name = _LEFTOVER.fullmatch(leftover.name)
        if name and name[2] == _machine() and not _runs(int(name[1])):
            if leftover.is_dir() and not leftover.is_symlink():
                shutil.rmtree(leftover, ignore_errors=True)
            else:
                leftover.unlink(missing_ok=True)


def _runs(process):
    if os.name != "posix":  # where signal 0 would end it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


NOT_PLAIN = "is longer than 200 characters or holds control characters"


def is_plain_name(name):
    """Whether a curve's name can be shown: up to 200 characters, no control characters."""
    return len(name) <= 200 and name.isprintable()


def text_of(data):
    """The text of bytes up to a NUL, behind which programs leave rubbish: UTF-8, else Latin-1."""
    data = data.partition(b"\0")[0]
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


def sound_text(text):
    """A text for XML and UTF-8: what they cannot hold is escaped, as in \\x1b."""
    return _UNSOUND.sub(lambda match: ascii(match[0])[1:-1], text)


def printable(text):
    """A text as one line for the terminal: control characters escaped, a long one cut inside."""
    line = " ".join(text.split())
    escaped = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    text = "".join(escaped)
    return text if len(text) <= 2000 else f"{text[:1000]} ... {text[-1000:]}"
