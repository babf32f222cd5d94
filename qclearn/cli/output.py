"""Lines of the commands, and files and folders that are written whole or not at all."""

import os
import re
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import click

from ..io.safe import printable

SEAL = "report.json"  # of every folder that a command writes: the last of its files to come


def stop(signal, _):
    """End on a signal as on an error, so that nothing half written stays."""
    sys.exit(128 + signal)


def expanded(argument):
    """An argument of the command line with the home folder for ~, which shells leave in --out=~/x."""
    option, path = re.fullmatch(r"(--[\w-]+=)?(.*)", argument, re.DOTALL).groups("")
    if not re.match(r"~[\w.-]*/", path):
        return argument
    try:
        return option + str(Path(path).expanduser())
    except RuntimeError:
        raise click.UsageError(f"{argument}: ~ is no known folder; write it in full") from None


class Word(click.types.StringParamType):
    """Text that is there: not what `--out "$A"` and `--out $A --report` give where A is not set."""

    def convert(self, value, param, ctx):
        if not value.strip() or value.startswith("--"):
            advice = "set the variable that it comes from, or leave this out"
            self.fail(f"{value!r} is {'an option' if value.strip() else 'empty'}; {advice}")
        return value


def file_option(help):
    """The option --out for a file, which is refused before the work if it cannot be written."""
    return click.option(
        "--out", required=True, callback=lambda _, __, path: file_to_write(path), help=help
    )


def file_to_write(path):
    """The path of a file that a command will write; OSError where it cannot."""
    place = Path(path).absolute()
    fault = "is a folder" if place.is_dir() else is_read(place, 1) and "the command reads it"
    if not fault and not os.access(place.parent, os.W_OK | os.X_OK):
        fault = "its folder does not exist or is not writable"
    if fault:
        raise OSError(f"{path}: cannot be written: {fault}; make it, or give another --out")
    return path


def is_read(place, own=0):
    """Whether more of the command line's words than its `own` name this file, so that it is read."""
    context = click.get_current_context(silent=True)
    files = [Path(re.sub(r"^--[\w-]+=", "", word)) for word in context.obj[0]] if context else []
    return place.is_file() and sum(one.is_file() and one.samefile(place) for one in files) > own


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
        temporary = tempfile.TemporaryDirectory(dir=there, prefix=".qclearn-")
    except OSError as error:
        raise OSError(
            f"{path}: not a folder that can be written to ({error.strerror}); give another --out"
        ) from None
    with temporary as parent:
        folder = Path(parent, "new")  # with the permissions of a folder that the user makes
        folder.mkdir()
        yield folder
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            os.rename(folder, path)
            return
        if read := [file.name for file in folder.iterdir() if is_read(path / file.name)]:
            raise OSError(f"{path / read[0]}: the command reads it; give another --out")
        for name in (*[SEAL] * (folder / SEAL).exists(), *instead):
            (path / name).unlink(missing_ok=True)
        for file in sorted(folder.iterdir(), key=lambda file: file.name == SEAL):
            os.replace(file, path / file.name)
