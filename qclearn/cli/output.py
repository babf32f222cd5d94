"""What the commands say and where they write: lines harmless to the terminal, and a folder as a whole."""

import os
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

import click

from ..files.safe import full_disk, is_full, own_prefix, printable, sweep


class Command(list):
    """The words of a command line; begun: when, by `time.perf_counter`."""

    begun = 0.0


def fail(message, code=2):
    """Print one line on stderr and leave."""
    print("qclearn: " + printable(message), file=sys.stderr)
    sys.exit(code)


def say(line):
    """Print one line on stdout, with names and paths in it made harmless to the terminal."""
    click.echo(printable(line))


@contextmanager
def output_folder(path):
    """A temporary folder whose files move to `path` together once the block has ended without an error."""
    path = Path(path)
    there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    try:
        sweep(there)
        temporary = tempfile.TemporaryDirectory(dir=there, prefix=own_prefix())
    except OSError as error:
        if is_full(error):
            raise OSError(f"{path}: {full_disk(there, 0)}") from None
        raise OSError(f"{path}: not a folder that can be written to ({error.strerror}); give another --out") from None
    with temporary as folder:
        try:
            yield Path(folder)
            path.mkdir(parents=True, exist_ok=True)
            for file in Path(folder).iterdir():
                os.replace(file, path / file.name)
        except OSError as error:
            if not is_full(error):
                raise
            written = sum(file.stat().st_size for file in Path(folder).iterdir())
            raise OSError(f"{path}: {full_disk(there, written)}") from None
