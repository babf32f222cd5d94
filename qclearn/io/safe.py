"""Files read with one kind of error and written whole: what every reader and writer here goes
through."""

import codecs
import gzip
import io
import os
import re
import struct
import tempfile
import warnings
import zipfile
import zlib
from contextlib import contextmanager
from pathlib import Path
from xml.parsers.expat import ExpatError

import numpy as np

from ..surfaces.surface import SurfaceError

_AGAIN = "it may be cut short or of another format: copy or export it again"
# Errors of bad bytes by their kind; of any other kind only where one of these libraries raised it.
_BAD_BYTES = (
    ValueError, OverflowError, EOFError, OSError,
    struct.error, zlib.error, zipfile.BadZipFile, ExpatError,
)  # fmt: skip
_LIBRARIES = {"nibabel", "numpy", "plyfile", "zipfile", "gzip", "xml", "ast", "tokenize", "json"}
# What XML cannot hold, nor UTF-8 (surrogates), nor a reader give back (a carriage return).
_UNSOUND = re.compile("[^\t\n -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
NOT_PLAIN = "is longer than 200 characters or holds control characters"


class FormatError(ValueError):
    """What is wrong in the bytes of a file; the reader adds the path and the remedy."""


class LeftOutWarning(UserWarning):
    """What a reader leaves out of a file that is sound otherwise, or turns."""


def read_bytes(path):
    """All bytes of a file, unzipped where they are gzip's under any name, a text with a byte order
    mark (Windows) in UTF-8 without it; SurfaceError, also for one of DataLad's or Git LFS's pointers."""
    try:
        data = path.read_bytes()
        data = gzip.decompress(data) if data.startswith(b"\x1f\x8b") else data
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error  # damaged gzip has none
        if path.is_symlink():
            advice = f"check the link to {path.readlink()} and copy the file again"
        elif isinstance(error, FileNotFoundError):
            advice = "check the name and the folder"
        else:
            advice = "copy the file again"
        raise SurfaceError(f"{path}: cannot be read ({reason}); {advice}") from None
    if not data:
        raise SurfaceError(f"{path}: the file is empty; copy or export it again")
    if re.match(rb"[./]*(\.git)?/annex/objects/|version https://git-lfs", data):
        raise SurfaceError(f"{path}: only points to the file; get it (datalad get, git lfs pull)")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", errors="replace").encode()
    return data.removeprefix(codecs.BOM_UTF8)


@contextmanager
def naming(path):
    """Let a SurfaceError of the block name the file."""
    try:
        yield
    except SurfaceError as error:
        raise SurfaceError(f"{path}: {error}") from None


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
        trace = error.__traceback__
        while trace.tb_next:
            trace = trace.tb_next
        raised_in = trace.tb_frame.f_globals.get("__name__", "").partition(".")[0]
        if not isinstance(error, _BAD_BYTES) and raised_in not in _LIBRARIES:
            raise
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise SurfaceError(f"{path}: {lead} {kind} ({reason}); {_AGAIN}") from error


def require_all(name, there, announced, exactly=False):
    """FormatError unless as many records are there as were announced, or (unless exactly) more."""
    if announced < 0 or there < announced or (exactly and there > announced):
        raise FormatError(f"{announced} {name} records are announced, {there} are there")


def npz_arrays(data, wanted=lambda name: True):
    """The arrays (dict) of an npz's bytes that `wanted` accepts by name."""
    with np.lib.npyio.NpzFile(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files if wanted(name)}
    if odd := [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]:
        raise FormatError(f"{odd[0]} is no array")
    return arrays


def npz_bytes(arrays):
    """The bytes of an npz file of arrays (dict)."""
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)
    return data.getvalue()


def write_whole(path, write):
    """Let `write(temporary_path)` write a file that takes its place in one step; SurfaceError."""
    try:
        # in the same folder, so that the last step is atomic; it goes with whatever ends the block
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".qclearn-") as folder:
            temporary = Path(folder, path.name)
            write(temporary)
            os.replace(temporary, path)
    except OSError as error:
        message = f"cannot be written ({error.strerror or error})"
        advice = "choose a folder that exists and is writable"
        raise SurfaceError(f"{path}: {message}; {advice}") from None


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
