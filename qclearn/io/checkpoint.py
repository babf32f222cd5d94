"""The finished parts of a long run, stored in a folder, so that a stopped run goes on."""

import json
from pathlib import Path

from ..surfaces.surface import SurfaceError
from .safe import write_whole

SETTINGS = "settings.json"


def require_home(folder):
    """A folder in the user's cache; OSError where platformdirs knows no home folder for its ~."""
    if not folder.is_absolute():
        raise OSError(f"{folder}: no home folder is known; set HOME, or give another folder")
    return folder


class Checkpoint:
    """A folder with a run's settings and a file for each finished part.

    settings: dict for JSON of all that the parts depend on, stored in the file `record`. error: the
    exception for a folder with other settings, with files but no `record` (unless shared=True), or
    that cannot be written.
    """

    def __init__(self, path, settings, error, record=SETTINGS, shared=False):
        self.path = Path(path)
        self.error = error
        self.record = record
        settings = json.loads(json.dumps(settings))
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            stored = self.read(record)
            stored = None if stored is None else json.loads(stored)
        except (OSError, ValueError) as fault:
            reason = getattr(fault, "strerror", None) or fault
            raise error(f"{path}: cannot be used ({reason}); give another folder") from None
        if stored is None and not shared and self.names():
            raise error(f"{path}: holds files, but no {record} of a run; empty it, or give another")
        # settings that differ are named, those of a group as group.name
        old, new = (
            {
                f"{name}.{inner}".rstrip("."): value
                for name, group in one.items()
                for inner, value in (group if isinstance(group, dict) else {"": group}).items()
            }
            for one in (stored or settings, settings)
        )
        if differing := [name for name in sorted(old | new) if old.get(name) != new.get(name)]:
            raise error(
                f"{path}: begun with other settings ({', '.join(differing)} differ): give the same "
                "or another place"
            )
        self.write(record, json.dumps(settings, indent=1).encode())

    def names(self):
        """Names of the files of finished parts, list."""
        names = sorted(file.name for file in self.path.iterdir())
        return [name for name in names if name != self.record and not name.startswith(".")]

    def read(self, name):
        """A part's bytes, or None where it is not finished."""
        file = self.path / name
        return file.read_bytes() if file.is_file() else None

    def write(self, name, data):
        """Store a part's bytes, whole or not at all."""
        try:
            write_whole(self.path / name, lambda place: place.write_bytes(data))
        except SurfaceError as error:
            message = f"{error}; what was finished is kept: run it again to go on"
            raise self.error(message) from None
