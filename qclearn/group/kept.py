"""What a template's rounds leave in a folder, so that a run that was stopped goes on: a file a subject and round."""

import io
import json
from pathlib import Path

import numpy as np

from ..files.safe import npz_arrays, write_whole
from ..surfaces.surface import SurfaceError
from .subject import Fitted

SETTINGS = "settings.json"


class TemplateError(ValueError):
    """A group that no template can be made of, or a folder that is not this group's: says what and what to do."""


class Folder:
    """The registrations of finished rounds, by round and subject's key; without a path nothing is kept.

    settings: dict for JSON of all that these depend on. TemplateError where the folder is another group's or cannot be
    written.
    """

    def __init__(self, path, settings):
        self.path = None if path is None else Path(path)
        if self.path is None:
            return
        place, settings = self.path / SETTINGS, json.loads(json.dumps(settings))
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            there = json.loads(place.read_text(encoding="utf-8")) if place.exists() else None
            if there is None and any(self.path.glob("round-*.npz")):
                raise TemplateError(f"{path}: has rounds, but no {SETTINGS}; empty it, or give another folder")
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise TemplateError(f"{path}: cannot be used ({reason}); give another folder") from None
        self.check(there or settings, settings)
        self.write(place, json.dumps(settings, indent=1).encode())

    def check(self, there, settings):
        """TemplateError unless the folder's settings are these."""
        differ = sorted(key for key in settings | there if there.get(key) != settings.get(key))
        if differ:
            raise TemplateError(
                f"{self.path}: kept for another group ({', '.join(differ)} differ): give the same subjects and options "
                "to go on with it, or another folder"
            )

    def write(self, place, data):
        try:
            write_whole(place, lambda temporary: temporary.write_bytes(data), len(data))
        except SurfaceError as error:
            raise TemplateError(str(error)) from None

    def file(self, number, key):
        return self.path / f"round-{number}-{key}.npz"

    def read(self, number, key):
        """The `Fitted` of a subject in a round, or None where none is kept or its file is damaged: it is made again."""
        if self.path is None or not self.file(number, key).is_file():
            return None
        try:
            arrays = npz_arrays(self.file(number, key).read_bytes(), lambda name: True)
            told = json.loads(str(arrays["told"]))
            return Fitted(arrays["f"] if arrays["f"].size else None, **told)
        except Exception:
            return None

    def keep(self, number, key, found):
        """Write a `Fitted`, whole or not at all."""
        if self.path is not None:
            told = {name: getattr(found, name) for name in ("reasons", "words", "r")}
            data = io.BytesIO()
            f = np.zeros(0, complex) if found.f is None else found.f
            np.savez(data, f=f, told=np.array(json.dumps(told)))
            self.write(self.file(number, key), data.getvalue())
