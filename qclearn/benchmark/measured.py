"""Reads and writes files of measured figures, each checked against its schema."""

import json
from pathlib import Path

import numpy as np

from ..io.extras import require
from ..io.safe import write_whole
from ..surfaces.surface import SurfaceError

# Of the benchmark: raise it when a field's meaning changes, so that old files are not read as new.
SCHEMA_VERSION = 2
RESULTS = Path(__file__).with_name("results")
OWN = "benchmark", "peers", "people"  # files that the benchmark itself writes
WRITERS = {  # of the files in RESULTS
    "benchmark": "qclearn benchmark",
    "foldgrid": "book/studies/fold_grid.py",
    "networks": "book/studies/evaluate_networks.py",
    "peers": "book/studies/peers.py",
    "people": "book/studies/peers.py",
    "sizes": "book/studies/sizes.py",
    "suspect": "book/studies/suspect.py",
    "training": "book/studies/training.py",
    "valleys": "book/studies/valleys.py",
    "weights": "book/studies/choose_weights.py",
}
# Files with a line per entry, and the list in a file that has a line per entry.
DENSE = "training", "valleys", "foldgrid"
LISTED = dict.fromkeys((*OWN, "sizes"), "rows") | {"suspect": "cases"}


class BenchmarkError(ValueError):
    """A benchmark cannot be run, resumed, written or read; the message says why and what to do."""


def plain(value):
    """Numbers, lists and dicts as JSON knows them; NaN and infinite become None."""
    if isinstance(value, dict):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(inner) for inner in value]
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def write_measured(name, path, figures):
    """Write figures, whole or not at all; BenchmarkError if their schema or the disk refuses them."""
    figures = plain(figures)
    check_schema(path, figures, name)
    text = as_text(name, figures)
    try:
        write_whole(Path(path), lambda place: place.write_text(text, encoding="utf-8"))
    except SurfaceError as error:
        raise BenchmarkError(str(error)) from None


def as_text(name, figures):
    """The text of a file: a line per row, case or training; else a line per number."""
    if name in DENSE:
        entries = (f"{json.dumps(key)}: {json.dumps(value)}" for key, value in figures.items())
        return "{\n" + ",\n".join(entries) + "\n}\n"
    if name not in LISTED:
        return json.dumps(figures, indent=1) + "\n"
    key = LISTED[name]
    entries = ",\n  ".join(json.dumps(entry) for entry in figures[key])
    text = json.dumps(figures | {key: []}, indent=1)
    return text.replace(f'"{key}": []', f'"{key}": [\n  {entries}\n ]') + "\n"


def read_measured(name, path=None):
    """The measured figures `name` ("benchmark", ...) of the package, or of a file `path`: dict.

    BenchmarkError where a file is missing or does not fit its schema. Those of the package fit: the
    tests ask.
    """
    if path is None:
        return read_json(RESULTS / f"{name}.json", name)
    figures = read_json(path, name)
    version = figures.get("schema_version") if isinstance(figures, dict) else None
    if name in OWN and version != SCHEMA_VERSION:
        content = "no results of this program"
        if version is not None:
            content = f"results of schema version {version}"
        advice = "run the benchmark again, or use the version that wrote the file"
        raise BenchmarkError(f"{path}: {content}; this version reads {SCHEMA_VERSION}: {advice}")
    check_schema(path, figures, name)
    return figures


def read_json(path, name):
    try:
        return json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BenchmarkError(f"{path}: cannot be read ({error.strerror}); check the name") from None
    except (ValueError, RecursionError) as error:
        raise BenchmarkError(
            f"{path}: not a JSON file ({error}); give a file that `{WRITERS[name]}` wrote"
        ) from None


def schema(name="benchmark"):
    """The JSON schema of a file of measured figures; its descriptions name units."""
    folder = Path(__file__).parent
    own = folder / f"{'benchmark' if name in OWN else name}.schema.json"
    if own.is_file():
        return json.loads(own.read_text(encoding="utf-8"))
    others = json.loads((folder / "measured.schema.json").read_text(encoding="utf-8"))
    return {"$ref": f"#/$defs/{name}", "$defs": others["$defs"]}


def check_schema(path, figures, name):
    require("benchmark", "measured figures")
    from jsonschema import Draft202012Validator

    error = next(Draft202012Validator(schema(name)).iter_errors(figures), None)
    if error:
        fault = f"{error.json_path}: {error.message[:200]}"
        advice = f"run `{WRITERS[name]}` again"
        raise BenchmarkError(f"{path}: not a valid results file: {fault}; {advice}")
