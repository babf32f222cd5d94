"""The benchmark's results file: its journal while it grows, its schema, and means over subjects."""

import json
import os
from importlib.resources import files
from pathlib import Path

import numpy as np

from .files import write_whole
from .surface import SurfaceError

SCHEMA_VERSION = 1  # raise it when a field's meaning changes, so that old files are not read as new ones


class BenchmarkError(ValueError):
    """A benchmark that cannot be run, resumed, written or read: says what, where and what to do."""


class Journal:
    """Rows that are kept as they come, a line of JSON each, in `OUT.partial` beside the results file.

    The first line holds the run's settings. A journal that is there is gone on with: `rows` are those it has. Its last
    line may be torn, where a run was killed while it wrote; that row is dropped. Rows that failed are tried again.
    """

    def __init__(self, out, settings):
        self.out, self.path = Path(out), Path(f"{out}.partial")
        self.rows = []
        self.settings = plain(settings)
        head = {"schema_version": SCHEMA_VERSION, "settings": self.settings}
        data = self.path.read_bytes() if self.path.is_file() else b""
        whole = data[:data.rfind(b"\n") + 1]
        self.resume(whole or data, head)  # which refuses a file that is not its own, before anything of it is cut off
        if len(whole) < len(data):
            os.truncate(self.path, len(whole))
        if not whole:
            self.append_line(head)

    def resume(self, data, head):
        if encoded(head).startswith(data):  # nothing yet, or killed while it wrote the first line
            return
        try:
            lines = [json.loads(line) for line in data.splitlines()]
        except (ValueError, UnicodeDecodeError) as error:
            raise BenchmarkError(f"{self.path}: not a journal of this program ({error}); move it away, or give another "
                                 "--out") from None
        check_version(self.path, lines[0])
        there = lines[0].get("settings", {})
        differ = sorted(key for key in set(head["settings"]) | set(there) if there.get(key) != head["settings"].get(key))
        if differ:
            raise BenchmarkError(f"{self.path}: begun with other settings ({', '.join(differ)} differ): give the same "
                                 "ones to go on with it, delete it to begin again, or give another --out")
        self.rows = lines[1:]

    def append(self, row):
        """Keep a finished row: on disk, or BenchmarkError."""
        row = plain(row)
        self.append_line(row)
        self.rows.append(row)

    def append_line(self, value):
        line = encoded(value)
        try:
            file = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o666)
            try:
                size = os.fstat(file).st_size
                if os.write(file, line) < len(line):  # one call, so that a line is there or not
                    os.ftruncate(file, size)
                    raise OSError("disk full")
                os.fsync(file)
            finally:
                os.close(file)
        except OSError as error:
            raise BenchmarkError(f"{self.path}: cannot be written ({error.strerror or error}); what was finished is kept: "
                                 "make room or choose another folder, and run it again to go on") from None

    def finish(self, provenance):
        """Write the results file, whole or not at all, and drop the journal: the results."""
        runs = [run["name"] for run in self.settings["runs"]]
        last = {(row["set"], row["pair"], row["run"]): row for row in self.rows}  # of a task that was tried again
        order = sorted(last.values(), key=lambda row: (row["set"], row["pair"], runs.index(row["run"])))
        results = {"schema_version": SCHEMA_VERSION, "settings": self.settings, "provenance": plain(provenance),
                   "rows": order}
        write_results(self.out, results)
        self.path.unlink(missing_ok=True)
        return results


def encoded(value):
    """The journal's line of a row or a head."""
    return (json.dumps(value, allow_nan=False) + "\n").encode()


def plain(value):
    """Numbers, lists and dicts as JSON knows them; NaN and infinite become None."""
    if isinstance(value, dict):
        return {str(name): plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(inner) for inner in value]
    if isinstance(value, (np.bool_, np.integer, np.floating)):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def write_results(path, results):
    """Write a checked results file, whole or not at all; BenchmarkError if it cannot be."""
    check_schema(path, results)
    head = json.dumps({name: value for name, value in results.items() if name != "rows"}, indent=1)
    rows = ",\n  ".join(json.dumps(row) for row in results["rows"])
    text = f'{head[:-2]},\n "rows": [\n  {rows}\n ]\n}}\n'  # a row a line
    try:
        write_whole(Path(path), lambda place: place.write_text(text, encoding="utf-8"))
    except SurfaceError as error:
        raise BenchmarkError(str(error)) from None


def read_results(path):
    """A results file as nested dicts and lists, checked against the schema; BenchmarkError if it is none of this version."""
    try:
        results = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BenchmarkError(f"{path}: cannot be read ({error.strerror}); check the name") from None
    except (ValueError, RecursionError) as error:
        raise BenchmarkError(f"{path}: not a JSON file ({error}); give a file that `qclearn benchmark` wrote") from None
    check_version(path, results)
    check_schema(path, results)
    return results


def check_version(path, results):
    version = results.get("schema_version") if isinstance(results, dict) else None
    if version != SCHEMA_VERSION:
        found = "no results of this program" if version is None else f"results of schema version {version}"
        raise BenchmarkError(f"{path}: {found}; this version reads {SCHEMA_VERSION}: run the benchmark again, or use the "
                             "version that wrote the file")


def schema():
    """The JSON schema of a results file; each field's description says what it is, with units."""
    return json.loads(files("qclearn").joinpath("benchmark.schema.json").read_text(encoding="utf-8"))


def check_schema(path, results):
    try:
        from jsonschema import Draft202012Validator
    except ModuleNotFoundError:
        raise ImportError("the benchmark needs jsonschema: pip install 'qclearn[benchmark]'") from None
    error = next(Draft202012Validator(schema()).iter_errors(results), None)
    if error:
        raise BenchmarkError(f"{path}: not a valid results file: {error.json_path}: {error.message[:200]}; run the "
                             "benchmark again")


def column(rows, run, key):
    """One figure of one run over its pairs: dict pair -> number, NaN where it failed or has none."""
    values = {row["pair"]: row for row in rows if row["run"] == run}
    return {pair: np.nan if row.get(key) is None else float(row[key]) for pair, row in values.items()}


def front_ratio(rows, front, baseline, size="mean_abs_mu", error="landmark_error"):
    """Per pair: the front's error at the baseline's distortion, over the baseline's error, dict; below 1 the front is ahead.

    front: names of runs that trade `error` for `size`. Their certified points, without those that another one beats in
    both, are joined by straight lines, beyond the last one held. Only pairs whose baseline is certified; NaN where the
    baseline's size is below the front's.
    """
    found = {}
    for row in (row for row in rows if row["run"] == baseline and row.get("certified")):
        points = sorted((other[size], other[error]) for other in rows
                        if other["pair"] == row["pair"] and other["run"] in front and other.get("certified"))
        best = [point for k, point in enumerate(points) if all(point[1] < other[1] for other in points[:k])]
        sizes, errors = np.array(best).reshape(-1, 2).T
        inside = len(best) and sizes[0] <= row[size]
        found[row["pair"]] = np.interp(row[size], sizes, errors) / row[error] if inside else np.nan
    return found


def summary(rows):
    """Per run: how many pairs, failed, certified, and the mean and SD over pairs of its main figures; seconds: median."""
    table = {}
    for run in dict.fromkeys(row["run"] for row in rows):
        own = [row for row in rows if row["run"] == run]
        done = [row for row in own if row["status"] == "done"]
        line = {"pairs": len(own), "failed": len(own) - len(done), "certified": sum(row["certified"] for row in done)}
        for key in ("landmark_error", "mean_abs_mu", "correspondence_sulci_mm"):
            values = [row[key] for row in done if row.get(key) is not None]
            line |= {key: float(np.mean(values)) if values else None, f"sd_{key}": float(np.std(values)) if values else None}
        line["seconds"] = float(np.median([row["seconds"]["map"] for row in done])) if done else None
        table[run] = line
    return table
