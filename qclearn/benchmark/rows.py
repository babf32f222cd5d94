"""The benchmark's rows: saved one by one, their means over subjects, and comparisons of runs."""

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..io.checkpoint import Checkpoint
from .measured import SCHEMA_VERSION, BenchmarkError, plain, write_measured
from .measures import paired_difference
from .verdicts import judge_start, side


class Journal:
    """Rows in the folder `OUT.partial`, a file each; a task that runs again replaces its row."""

    def __init__(self, out, settings):
        self.out = Path(out)
        self.settings = plain(settings)
        settings = {"schema_version": SCHEMA_VERSION} | self.settings
        self.checkpoint = Checkpoint(f"{out}.partial", settings, BenchmarkError)

    @property
    def rows(self):
        """The stored rows; a damaged file has none, and its task is run again."""
        rows = []
        for name in self.checkpoint.names():
            with suppress(ValueError):
                rows.append(json.loads(self.checkpoint.read(name)))
        return rows

    def append(self, row):
        """Save a finished row on disk, or BenchmarkError."""
        task = json.dumps([row["set"], row["pair"], row["run"]])
        name = f"row-{hashlib.sha256(task.encode()).hexdigest()[:16]}.json"
        self.checkpoint.write(name, json.dumps(plain(row), allow_nan=False).encode())

    def finish(self, provenance):
        """Write the results file, whole or not at all, and drop the journal; the results, dict."""
        runs = [run["name"] for run in self.settings["runs"]]
        order = {name: number for number, name in enumerate(runs)}
        rows = sorted(self.rows, key=lambda row: (row["set"], row["pair"], order[row["run"]]))
        results = {"schema_version": SCHEMA_VERSION, "settings": self.settings}
        results |= {"provenance": plain(provenance), "rows": rows}
        write_measured("benchmark", self.out, results)
        shutil.rmtree(self.checkpoint.path)
        return results


def column(rows, run, key):
    """One figure of one run: dict pair -> number, NaN where there is none."""
    own = {row["pair"]: row.get(key) for row in rows if row["run"] == run}
    return {pair: np.nan if value is None else float(value) for pair, value in own.items()}


def front_ratio(rows, front, baseline, size="mean_abs_mu"):
    """The front's error at the baseline's distortion over the baseline's error, dict by pair.

    front: names of runs that trade landmark error for `size`. Straight lines join their certified
    points that none beats in both, constant beyond the last. Pairs with a certified baseline; NaN where
    its size is below the front's. Below 1 the front is ahead.
    """
    certified = [row for row in rows if row.get("certified")]
    ratios = {}
    for row in certified:
        if row["run"] != baseline:
            continue
        own = [other for other in certified if other["pair"] == row["pair"]]
        points = sorted(
            (other[size], other["landmark_error"]) for other in own if other["run"] in front
        )
        best = []
        for point in points:
            if all(point[1] < other[1] for other in best):
                best.append(point)
        sizes, errors = np.array(best).reshape(-1, 2).T
        inside = len(best) and sizes[0] <= row[size]
        error = row["landmark_error"]
        ratios[row["pair"]] = np.interp(row[size], sizes, errors) / error if inside else np.nan
    return ratios


def compare_fronts(rows, front, baseline, rng, size="mean_abs_mu"):
    """The geometric mean "ratio" of `front_ratio`, with its 95 % interval "low", "high": dict.

    "won" of "pairs": the front is ahead; "state": "ahead", "behind", "level" (the interval holds 1)
    or "unknown".
    """
    ratios = np.array(list(front_ratio(rows, front, baseline, size).values()))
    difference = paired_difference(np.log(ratios), np.zeros(len(ratios)), rng)
    ratio, low, high = np.exp(difference).tolist()
    states = {"below": "ahead", "above": "behind", "level": "level"}
    return {
        "ratio": ratio,
        "low": low,
        "high": high,
        "won": int((ratios < 1).sum()),
        "pairs": int(np.isfinite(ratios).sum()),
        "state": "unknown" if np.isnan(low) else states[side(low, high, of=1)],
    }


def compare_runs(rows, one, other, key, rng):
    """One run's figure less another's on the same pairs: `paired_difference`, (mean, low, high)."""
    first, second = column(rows, one, key), column(rows, other, key)
    both = [pair for pair in first if pair in second]
    return paired_difference([first[pair] for pair in both], [second[pair] for pair in both], rng)


def methods_and_oracles(rows):
    """Rows of methods, and rows of oracles, which know the landmarks' true images: two lists."""
    oracles = [row for row in rows if row["landmarks"] == "exact"]
    return [row for row in rows if row["landmarks"] != "exact"], oracles


def median_pair(rows, run):
    """The pair with a run's median landmark error (the lower of two), an unbiased example."""
    errors = column(rows, run, "landmark_error").items()
    values = sorted((value, pair) for pair, value in errors if np.isfinite(value))
    if not values:
        raise BenchmarkError(
            f"no pair has a landmark error of the run {run!r}: give one that the results hold"
        )
    return values[(len(values) - 1) // 2][1]


def noted(rows, run, text):
    """How many of a run's maps carry a note that contains `text`."""
    notes = [row.get("notes", ()) for row in rows if row["run"] == run]
    return sum(any(text in note for note in own) for own in notes)


def failures(rows, run):
    """The pairs, list, on which a run's map is "failed here" (`judge_start`); [] without the rotation's
    rows."""
    both = run, "rotation"
    own, first = ({row["pair"]: row for row in rows if row["run"] == name} for name in both)
    return [pair for pair in own if pair in first and judge_start(own[pair], first[pair])]


MAIN = ("landmark_error", "mean_abs_mu", "correspondence_sulci_mm")


def summary(rows):
    """Run -> dict: counts "pairs", "failed", "certified"; each figure's mean over pairs by its
    name, its SD as "sd_of_" and the name (`MAIN` figures always, None where no pair has one);
    medians "seconds" of the map, and "stages"."""
    table = {}
    numbers = [key for row in rows for key, value in row.items() if is_number(value)]
    figures = dict.fromkeys([*MAIN, *numbers])
    for run in dict.fromkeys(row["run"] for row in rows):
        own = [row for row in rows if row["run"] == run]
        done = [row for row in own if row["status"] == "done"]
        certified = sum(row["certified"] for row in done)
        line = {"pairs": len(own), "failed": len(own) - len(done), "certified": certified}
        for key in figures:
            values = [row[key] for row in done if row.get(key) is not None]
            if values or key in MAIN:
                line[key] = float(np.mean(values)) if values else None
                line[f"sd_of_{key}"] = float(np.std(values)) if values else None
        stages = done[0]["seconds"] if done else ()
        line["stages"] = {
            name: float(np.median([row["seconds"][name] for row in done])) for name in stages
        }
        line["seconds"] = line["stages"].get("map")
        table[run] = line
    return table


SHARED = ("disk maps", "landmarks")  # stages that every chain begins with
SOLVES = ("resampling", "DBS-Net", "exact solver")  # what makes a map of a coefficient


def chain_seconds(rows):
    """Seconds of the rows of sizes.json: "smallest", "middle" or "largest" -> chain -> stage.

    Each chain also has "whole", the sum of its stages; "map", those that it does not share with the
    others; "comes", the map without a certificate and without corrections; "passes", the same
    without resampling; and "solve", the stages that make a map of a coefficient. The harmonic map's
    correction is a part of it.
    """
    sizes = sorted({row["vertices"] for row in rows})
    seconds_by_size = {}
    for name, vertices in zip(("smallest", "middle", "largest"), sizes):
        chains = seconds_by_size[name] = {}
        for row in rows:
            if row["vertices"] == vertices:
                chains.setdefault(row["chain"], {})[row["stage"]] = row["seconds"]
        for stages in chains.values():
            solve = sum(seconds for stage, seconds in stages.items() if stage in SOLVES)
            apart = sum(seconds for stage, seconds in stages.items() if stage not in SHARED)
            checks = stages.get("certificate", 0.0)
            if "DBS-Net" in stages:
                checks += stages.get("correction", 0.0)
            passes = apart - checks - stages.get("resampling", 0.0)
            sums = {"map": apart, "comes": apart - checks, "passes": passes, "solve": solve}
            stages |= {"whole": sum(stages.values()), **sums}
    return seconds_by_size


def saving(chains, part):
    """The verdict, as text, on a saving of 90 % at one size of `chain_seconds`; part: of its sums.

    It holds if the networks' seconds are at most a tenth of those of the harmonic map with nested
    dissection, at both weights.
    """
    limits = [chains[f"harmonic {weight}, dissected"][part] / 10 for weight in ("0.1", "5")]
    at_smaller, at_larger = (chains["networks"][part] <= limit for limit in limits)
    if at_smaller and at_larger:
        return "holds"
    return "holds at the larger weight alone" if at_larger else "does not hold"


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)
