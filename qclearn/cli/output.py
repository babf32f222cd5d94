"""Lines of the commands that cannot harm the terminal, and folders that are written whole."""

import io
import os
import re
import sys
import tempfile
import warnings
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

import click

from ..io.safe import full_disk, is_full, own_prefix, printable, sweep

SEAL = "report.json"  # of every folder that a command writes: the last of its files to come


class Command(list):
    """The arguments of a command line; begun: when, by `time.perf_counter`."""

    begun = 0.0


class Unfailing:
    """A stream whose reader may go away, whose disk may be full, whose encoding may lack a letter:
    what a command writes, and its exit code, do not depend on its messages."""

    def __init__(self, stream):
        self.stream = io.StringIO() if stream is None else stream
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")

    def __getattr__(self, name):
        return getattr(self.stream, name)

    def write(self, text):
        self._try(self.stream.write, text)

    def flush(self):
        self._try(self.stream.flush)

    def _try(self, action, *arguments):
        try:
            action(*arguments)
        except OSError:  # nothing can be said any more: what is buffered goes nowhere
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.stream.fileno())


@contextmanager
def unfailing_streams():
    """stdout and stderr as `Unfailing` streams, and a warning as one line, in the block."""
    out, err = Unfailing(sys.stdout), Unfailing(sys.stderr)
    with redirect_stdout(out), redirect_stderr(err), warnings.catch_warnings():
        warnings.showwarning = lambda message, *_: warn(str(message))
        try:
            yield
        finally:
            out.flush()
            err.flush()


def expanded(argument):
    """An argument of the command line with the home folder for ~, which shells leave in --out=~/x."""
    option, path = re.fullmatch(r"(--[\w-]+=)?(.*)", argument, re.DOTALL).groups("")
    if not re.match(r"~[\w.-]*/", path):
        return argument
    try:
        return option + str(Path(path).expanduser())
    except RuntimeError:
        raise click.UsageError(f"{argument}: ~ is no known folder; write it in full") from None


def file_option(help):
    """The option --out for a file, which is refused before the work if it cannot be written."""
    return click.option(
        "--out", required=True, callback=lambda _, __, path: file_to_write(path), help=help
    )


def file_to_write(path):
    """The path of a file that a command will write; OSError where it cannot."""
    place = Path(path).absolute()
    if place.is_dir() or not os.access(place.parent, os.W_OK | os.X_OK):
        fault = "is a folder" if place.is_dir() else "its folder does not exist or is not writable"
        raise OSError(f"{path}: cannot be written: {fault}; make it, or give another --out")
    return path


def fail(message, code=2):
    """Print one line on stderr and leave."""
    warn(message)
    sys.exit(code)


def warn(message):
    """Print one line on stderr."""
    print("qclearn: " + printable(message), file=sys.stderr)


def say(line):
    """Print one line on stdout, without control characters."""
    print(printable(line))


@contextmanager
def output_folder(path, instead=()):
    """A temporary folder that takes its place at `path` once the block has ended without an error.

    A new folder appears in one step, whole. Into one that is there files move one by one, its
    report.json away first and the new one in last, so that a folder with a report.json is whole;
    instead: names of files that an earlier run may have left there, which go if this one has none.
    """
    path = Path(path)
    there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    try:
        sweep(there)
        temporary = tempfile.TemporaryDirectory(dir=there, prefix=own_prefix())
    except OSError as error:
        if is_full(error):
            raise OSError(f"{path}: {full_disk(there, 0)}") from None
        raise OSError(
            f"{path}: not a folder that can be written to ({error.strerror}); give another --out"
        ) from None
    with temporary as parent:
        folder = Path(parent, "new")  # with the permissions of a folder that the user makes
        try:
            folder.mkdir()
            yield folder
            if path.exists():
                move_into(path, folder, instead)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                os.rename(folder, path)
        except OSError as error:
            if not is_full(error):
                raise
            written = sum(file.stat().st_size for file in folder.iterdir())
            raise OSError(f"{path}: {full_disk(there, written)}") from None


def move_into(path, folder, instead):
    """Move a folder's files into the one at `path`, which has no SEAL while it is not whole."""
    for name in (*[SEAL] * (folder / SEAL).exists(), *instead):
        (path / name).unlink(missing_ok=True)
    for file in sorted(folder.iterdir(), key=lambda file: file.name == SEAL):
        os.replace(file, path / file.name)
