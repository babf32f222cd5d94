"""The finished parts of a long run, kept in a folder, so that a stopped run goes on."""

import json
from pathlib import Path

from ..surfaces.surface import SurfaceError
from .safe import write_whole

SETTINGS = "settings.json"


class Begun:
    """A folder with a run's settings and a file for each finished part; path None: nothing is kept.

    settings: dict for JSON of all that the parts depend on. error: the exception for a folder with other settings or
    other files, or that cannot be written.
    """

    def __init__(self, path, settings, error):
        self.path, self.error = None if path is None else Path(path), error
        if self.path is None:
            return
        settings = json.loads(json.dumps(settings))
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            place = self.path / SETTINGS
            there = json.loads(place.read_text(encoding="utf-8")) if place.exists() else None
            foreign = there is None and bool(self.names())
        except (OSError, ValueError) as reason:
            reason = getattr(reason, "strerror", None) or reason
            raise error(f"{path}: cannot be used ({reason}); give another folder") from None
        if foreign:
            raise error(f"{path}: holds files, but no {SETTINGS} of a run; empty it, or give another folder")
        there = there or settings
        differ = sorted(key for key in settings | there if there.get(key) != settings.get(key))
        if differ:
            raise error(
                f"{path}: begun with other settings ({', '.join(differ)} differ): give the same or another place"
            )
        self.keep(SETTINGS, json.dumps(settings, indent=1).encode())

    def names(self):
        """Names of the files of finished parts, list."""
        return sorted(path.name for path in self.path.iterdir() if path.name != SETTINGS and path.name[0] != ".")

    def read(self, name):
        """A part's bytes, or None where it is not finished."""
        file = self.path and self.path / name
        return file.read_bytes() if file and file.is_file() else None

    def keep(self, name, data):
        """Write a part, whole or not at all."""
        if self.path is None:
            return
        try:
            write_whole(self.path / name, lambda place: place.write_bytes(data), len(data))
        except SurfaceError as reason:
            raise self.error(f"{reason}; what was finished is kept: run it again to go on") from None
