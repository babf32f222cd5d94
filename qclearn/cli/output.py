"""Lines of the commands that cannot harm the terminal, and folders that are written whole."""

import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import click

from ..io.safe import full_disk, is_full, own_prefix, printable, sweep

SEAL = "report.json"  # of every folder that a command writes: the last of its files to come


class Command(list):
    """The arguments of a command line; begun: when, by `time.perf_counter`."""

    begun = 0.0


def fail(message, code=2):
    """Print one line on stderr and leave."""
    print("qclearn: " + printable(message), file=sys.stderr)
    sys.exit(code)


def say(line):
    """Print one line on stdout, without control characters."""
    click.echo(printable(line))


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
