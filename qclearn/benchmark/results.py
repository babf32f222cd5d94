"""Files of measured figures and their schemas: the benchmark's, its journal while it grows, and that of networks; means
over subjects."""

import json
import os
from importlib.resources import files
from pathlib import Path

import numpy as np

from ..files.extras import require
from ..files.meshes import write_whole
from ..registration.metrics import paired_difference
from ..surfaces.surface import SurfaceError

SCHEMA_VERSION = 2  # raise it when a field's meaning changes, so that old files are not read as new ones
WRITERS = {"benchmark": "qclearn benchmark", "networks": "tools/evaluate_networks.py"}  # of the files of each kind


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
        whole = data[: data.rfind(b"\n") + 1]
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
            raise BenchmarkError(
                f"{self.path}: not a journal of this program ({error}); move it away, or give another --out"
            ) from None
        check_version(self.path, lines[0])
        there = lines[0].get("settings", {})
        differ = sorted(
            key for key in set(head["settings"]) | set(there) if there.get(key) != head["settings"].get(key)
        )
        if differ:
            raise BenchmarkError(
                f"{self.path}: begun with other settings ({', '.join(differ)} differ): give the same "
                "ones to go on with it, delete it to begin again, or give another --out"
            )
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
            raise BenchmarkError(
                f"{self.path}: cannot be written ({error.strerror or error}); what was finished is kept: "
                "make room or choose another folder, and run it again to go on"
            ) from None

    def finish(self, provenance):
        """Write the results file, whole or not at all, and drop the journal: the results."""
        runs = [run["name"] for run in self.settings["runs"]]
        last = {(row["set"], row["pair"], row["run"]): row for row in self.rows}  # of a task that was tried again
        order = sorted(last.values(), key=lambda row: (row["set"], row["pair"], runs.index(row["run"])))
        results = {
            "schema_version": SCHEMA_VERSION,
            "settings": self.settings,
            "provenance": plain(provenance),
            "rows": order,
        }
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
    check_schema(path, results, "benchmark")
    rows = ",\n  ".join(json.dumps(row) for row in results["rows"])  # a row a line
    text = json.dumps(results | {"rows": []}, indent=1).replace('"rows": []', f'"rows": [\n  {rows}\n ]')
    write_text(path, text + "\n")


def write_networks(path, figures):
    """Write the checked figures of networks, whole or not at all; BenchmarkError if it cannot be."""
    figures = plain(figures)
    check_schema(path, figures, "networks")
    write_text(path, json.dumps(figures, indent=1) + "\n")


def write_text(path, text):
    try:
        write_whole(Path(path), lambda place: place.write_text(text, encoding="utf-8"))
    except SurfaceError as error:
        raise BenchmarkError(str(error)) from None


def read_results(path):
    """A results file as nested dicts and lists, checked against the schema;
    BenchmarkError if it is none of this version."""
    results = read_json(path, "benchmark")
    check_version(path, results)
    check_schema(path, results, "benchmark")
    return results


def read_networks(path):
    """The figures of networks as nested dicts and lists; BenchmarkError if they do not fit their schema."""
    figures = read_json(path, "networks")
    check_schema(path, figures, "networks")
    return figures


def read_json(path, kind):
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BenchmarkError(f"{path}: cannot be read ({error.strerror}); check the name") from None
    except (ValueError, RecursionError) as error:
        raise BenchmarkError(f"{path}: not a JSON file ({error}); give a file that `{WRITERS[kind]}` wrote") from None


def check_version(path, results):
    version = results.get("schema_version") if isinstance(results, dict) else None
    if version != SCHEMA_VERSION:
        found = "no results of this program" if version is None else f"results of schema version {version}"
        raise BenchmarkError(
            f"{path}: {found}; this version reads {SCHEMA_VERSION}: run the benchmark again, or use the "
            "version that wrote the file"
        )


def schema(kind="benchmark"):
    """The JSON schema of a file of measured figures, "benchmark" or "networks"; descriptions say what it holds, with
    units."""
    return json.loads(files(__package__).joinpath(f"{kind}.schema.json").read_text(encoding="utf-8"))


def check_schema(path, results, kind):
    require("benchmark", "measured figures")
    from jsonschema import Draft202012Validator

    error = next(Draft202012Validator(schema(kind)).iter_errors(results), None)
    if error:
        raise BenchmarkError(
            f"{path}: not a valid results file: {error.json_path}: {error.message[:200]}; run `{WRITERS[kind]}` again"
        )


def column(rows, run, key):
    """One figure of one run over its pairs: dict pair -> number, NaN where it failed or has none."""
    values = {row["pair"]: row for row in rows if row["run"] == run}
    return {pair: np.nan if row.get(key) is None else float(row[key]) for pair, row in values.items()}


def front_ratio(rows, front, baseline, size="mean_abs_mu", error="landmark_error"):
    """Per pair: the front's error at the baseline's distortion, over the baseline's error, dict; below 1 the front is
    ahead.

    front: names of runs that trade `error` for `size`. Their certified points, without those that another one beats in
    both, are joined by straight lines, beyond the last one held. Only pairs whose baseline is certified; NaN where the
    baseline's size is below the front's.
    """
    found = {}
    for row in (row for row in rows if row["run"] == baseline and row.get("certified")):
        points = sorted(
            (other[size], other[error])
            for other in rows
            if other["pair"] == row["pair"] and other["run"] in front and other.get("certified")
        )
        best = [point for k, point in enumerate(points) if all(point[1] < other[1] for other in points[:k])]
        sizes, errors = np.array(best).reshape(-1, 2).T
        inside = len(best) and sizes[0] <= row[size]
        found[row["pair"]] = np.interp(row[size], sizes, errors) / row[error] if inside else np.nan
    return found


def compare_fronts(rows, front, baseline, rng, size="mean_abs_mu", error="landmark_error"):
    """`front_ratio` in one line: its geometric mean over pairs with its 95 % interval, and who is in front, a dict.

    "ratio", "low", "high"; "won" of "pairs" where the front is ahead; "state": "ahead" or "behind" where the interval
    does not hold 1, "level" where it does, "unknown" without a pair.
    """
    ratios = np.array(list(front_ratio(rows, front, baseline, size, error).values()))
    ratio, low, high = np.exp(paired_difference(np.log(ratios), np.zeros(len(ratios)), rng)).tolist()
    state = "ahead" if high < 1 else "behind" if low > 1 else "level" if low <= 1 <= high else "unknown"
    return {
        "ratio": ratio,
        "low": low,
        "high": high,
        "won": int((ratios < 1).sum()),
        "pairs": int(np.isfinite(ratios).sum()),
        "state": state,
    }


def compare_runs(rows, one, other, key, rng):
    """One run's figure less another's on the same pairs: `paired_difference`, (mean, low, high)."""
    first, second = column(rows, one, key), column(rows, other, key)
    both = [pair for pair in first if pair in second]
    return paired_difference([first[pair] for pair in both], [second[pair] for pair in both], rng)


def methods_and_oracles(rows):
    """Rows of methods, and rows of oracles: runs whose targets are the true images of the landmarks. Two lists."""
    oracles = [row for row in rows if row["landmarks"] == "exact"]
    return [row for row in rows if row["landmarks"] != "exact"], oracles


def median_pair(rows, run, key="landmark_error"):
    """The pair with the median figure of a run (of an even number, the lower): the one to show, chosen by nobody."""
    values = sorted((value, pair) for pair, value in column(rows, run, key).items() if np.isfinite(value))
    if not values:
        raise BenchmarkError(f"no pair has the figure {key!r} of the run {run!r}: give one that the results hold")
    return values[(len(values) - 1) // 2][1]


def noted(rows, run, words):
    """How many of a run's maps carry a note that holds `words`."""
    return sum(any(words in note for note in row.get("notes", ())) for row in rows if row["run"] == run)


MAIN = ("landmark_error", "mean_abs_mu", "correspondence_sulci_mm")


def summary(rows):
    """Per run: a dict with "pairs", "failed", "certified" (counts); each figure's mean over pairs by its own name and
    its SD as "sd_of_" and the name (`MAIN` figures always, None where no pair has one); "seconds" of the map and
    "stages", medians.
    """
    table = {}
    figures = dict.fromkeys([*MAIN, *(key for row in rows for key, value in row.items() if is_number(value))])
    for run in dict.fromkeys(row["run"] for row in rows):
        own = [row for row in rows if row["run"] == run]
        done = [row for row in own if row["status"] == "done"]
        line = {"pairs": len(own), "failed": len(own) - len(done), "certified": sum(row["certified"] for row in done)}
        for key in figures:
            values = [row[key] for row in done if row.get(key) is not None]
            if values or key in MAIN:
                line[key] = float(np.mean(values)) if values else None
                line[f"sd_of_{key}"] = float(np.std(values)) if values else None
        stages = done[0]["seconds"] if done else {}
        line["stages"] = {name: float(np.median([row["seconds"][name] for row in done])) for name in stages}
        line["seconds"] = line["stages"].get("map")
        table[run] = line
    return table


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)
