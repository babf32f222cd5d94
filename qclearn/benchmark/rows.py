"""The benchmark's rows: saved one by one, their means over subjects, and comparisons of runs."""

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..io.checkpoint import Checkpoint
from ..registration.metrics import paired_difference
from .measured import SCHEMA_VERSION, BenchmarkError, plain, write_measured
from .verdicts import judge_start


class Journal:
    """Rows in the folder `OUT.partial` beside the results file, a file each; a task tried again
    replaces its row."""

    def __init__(self, out, settings):
        self.out, self.settings = Path(out), plain(settings)
        settings = {"schema_version": SCHEMA_VERSION} | self.settings
        self.checkpoint = Checkpoint(f"{out}.partial", settings, BenchmarkError)

    @property
    def rows(self):
        """The rows kept so far; a damaged file has none, and its task is run again."""
        rows = []
        for name in self.checkpoint.names():
            with suppress(ValueError):
                rows.append(json.loads(self.checkpoint.read(name)))
        return rows

    def append(self, row):
        """Save a finished row on disk, or BenchmarkError."""
        task = hashlib.sha256(
            json.dumps([row["set"], row["pair"], row["run"]]).encode()
        ).hexdigest()
        self.checkpoint.write(
            f"row-{task[:16]}.json", json.dumps(plain(row), allow_nan=False).encode()
        )

    def finish(self, provenance):
        """Write the results file, whole or not at all, and drop the journal; returns the results."""
        runs = [run["name"] for run in self.settings["runs"]]
        results = {
            "schema_version": SCHEMA_VERSION,
            "settings": self.settings,
            "provenance": plain(provenance),
            "rows": sorted(
                self.rows, key=lambda row: (row["set"], row["pair"], runs.index(row["run"]))
            ),
        }
        write_measured("benchmark", self.out, results)
        shutil.rmtree(self.checkpoint.path)
        return results


def column(rows, run, key):
    """One figure of one run: dict pair -> number, NaN where there is none."""
    values = {row["pair"]: row for row in rows if row["run"] == run}
    return {
        pair: np.nan if row.get(key) is None else float(row[key]) for pair, row in values.items()
    }


def front_ratio(rows, front, baseline, size="mean_abs_mu", error="landmark_error"):
    """The front's error at the baseline's distortion over the baseline's error, dict pair -> ratio;
    below 1: ahead.

    front: names of runs that trade `error` for `size`. Straight lines join their certified points
    that none beats in both, constant beyond the last. Pairs with a certified baseline; NaN where
    its size is below the front's.
    """
    ratios = {}
    for row in (row for row in rows if row["run"] == baseline and row.get("certified")):
        points = sorted(
            (other[size], other[error])
            for other in rows
            if other["pair"] == row["pair"] and other["run"] in front and other.get("certified")
        )
        best = [
            point
            for k, point in enumerate(points)
            if all(point[1] < other[1] for other in points[:k])
        ]
        sizes, errors = np.array(best).reshape(-1, 2).T
        inside = len(best) and sizes[0] <= row[size]
        ratios[row["pair"]] = np.interp(row[size], sizes, errors) / row[error] if inside else np.nan
    return ratios


def compare_fronts(rows, front, baseline, rng, size="mean_abs_mu", error="landmark_error"):
    """`front_ratio` over all pairs, a dict: its geometric mean "ratio" with its 95 % interval
    "low", "high".

    "won" of "pairs": the front is ahead; "state": "ahead", "behind", "level" (the interval holds 1)
    or "unknown".
    """
    ratios = np.array(list(front_ratio(rows, front, baseline, size, error).values()))
    ratio, low, high = np.exp(
        paired_difference(np.log(ratios), np.zeros(len(ratios)), rng)
    ).tolist()
    state = (
        "ahead" if high < 1 else "behind" if low > 1 else "level" if low <= 1 <= high else "unknown"
    )
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
    """Rows of methods and rows of oracles, whose targets are the landmarks' true images: two lists."""
    oracles = [row for row in rows if row["landmarks"] == "exact"]
    return [row for row in rows if row["landmarks"] != "exact"], oracles


def median_pair(rows, run):
    """The pair with a run's median landmark error (the lower of two), to show an example that
    nobody chose."""
    values = sorted(
        (value, pair)
        for pair, value in column(rows, run, "landmark_error").items()
        if np.isfinite(value)
    )
    if not values:
        raise BenchmarkError(
            f"no pair has a landmark error of the run {run!r}: give one that the results hold"
        )
    return values[(len(values) - 1) // 2][1]


def noted(rows, run, text):
    """How many of a run's maps carry a note that contains `text`."""
    return sum(
        any(text in note for note in row.get("notes", ())) for row in rows if row["run"] == run
    )


def failures(rows, run, start="rotation"):
    """The pairs on which a run's map is "failed here" beside the run `start` (`judge_start`), list;
    [] without it."""
    own, begun = ({row["pair"]: row for row in rows if row["run"] == name} for name in (run, start))
    return [pair for pair in own if pair in begun and judge_start(own[pair], begun[pair])]


MAIN = ("landmark_error", "mean_abs_mu", "correspondence_sulci_mm")


def summary(rows):
    """Run -> dict: counts "pairs", "failed", "certified"; each figure's mean over pairs by its
    name, its SD as "sd_of_" and the name (`MAIN` figures always, None where no pair has one);
    medians "seconds" of the map, and "stages"."""
    table = {}
    figures = dict.fromkeys(
        [*MAIN, *(key for row in rows for key, value in row.items() if is_number(value))]
    )
    for run in dict.fromkeys(row["run"] for row in rows):
        own = [row for row in rows if row["run"] == run]
        done = [row for row in own if row["status"] == "done"]
        line = {
            "pairs": len(own),
            "failed": len(own) - len(done),
            "certified": sum(row["certified"] for row in done),
        }
        for key in figures:
            values = [row[key] for row in done if row.get(key) is not None]
            if values or key in MAIN:
                line[key] = float(np.mean(values)) if values else None
                line[f"sd_of_{key}"] = float(np.std(values)) if values else None
        stages = done[0]["seconds"] if done else {}
        line["stages"] = {
            name: float(np.median([row["seconds"][name] for row in done])) for name in stages
        }
        line["seconds"] = line["stages"].get("map")
        table[run] = line
    return table


SHARED = ("disk maps", "landmarks")  # stages that every chain begins with
SOLVES = ("resampling", "DBS-Net", "exact solver")  # what makes a map of a coefficient


def chain_seconds(rows):
    """Seconds of the rows of sizes.json: "smallest", "middle" or "largest" -> chain -> stage ->
    seconds.

    Each chain also has "whole", the sum of its stages; "map", those that it does not share with the
    others; "comes", the map as it comes, without a certificate and without what is done where that
    refuses; "passes", the same without resampling; and "solve", the stages that make a map of a
    coefficient. The harmonic map's correction is a part of it.
    """
    seconds_by_size = {}
    for name, vertices in zip(
        ("smallest", "middle", "largest"), sorted({row["vertices"] for row in rows})
    ):
        chains = seconds_by_size[name] = {}
        for row in rows:
            if row["vertices"] == vertices:
                chains.setdefault(row["chain"], {})[row["stage"]] = row["seconds"]
        for stages in chains.values():
            solve = sum(seconds for stage, seconds in stages.items() if stage in SOLVES)
            apart = sum(seconds for stage, seconds in stages.items() if stage not in SHARED)
            checks = stages.get("certificate", 0.0) + ("DBS-Net" in stages) * stages.get(
                "correction", 0.0
            )
            passes = apart - checks - stages.get("resampling", 0.0)
            sums = {"map": apart, "comes": apart - checks, "passes": passes, "solve": solve}
            stages |= {"whole": sum(stages.values()), **sums}
    return seconds_by_size


def saving(chains, part):
    """What becomes of a saving of 90 % at one size of `chain_seconds`, as text; part: one of its
    sums.

    The networks' seconds over those of the harmonic map with nested dissection, at both weights,
    are at most a tenth.
    """
    seconds = chains["networks"][part]
    holds = [
        seconds <= chains[f"harmonic {weight}, dissected"][part] / 10 for weight in ("0.1", "5")
    ]
    return (
        "holds"
        if all(holds)
        else "holds at the larger weight alone"
        if holds[1]
        else "does not hold"
    )


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool)
