"""The benchmark's rows: saved one by one, their means over subjects, and which of them failed."""

import hashlib
import json
import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..io.checkpoint import Checkpoint
from .measured import SCHEMA_VERSION, BenchmarkError, plain, write_measured


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
        order = {run["name"]: number for number, run in enumerate(self.settings["runs"])}
        rows = sorted(self.rows, key=lambda row: (row["set"], row["pair"], order[row["run"]]))
        results = {"schema_version": SCHEMA_VERSION, "settings": self.settings}
        results |= {"provenance": plain(provenance), "rows": rows}
        write_measured("benchmark", self.out, results)
        shutil.rmtree(self.checkpoint.path)
        return results


def failures(rows, run):
    """The pairs, list, on which a run's map ends farther off than the rotation, which it may start
    from; [] without the rotation's rows. Such a map counts for no method."""
    both = run, "rotation"
    own, first = ({row["pair"]: row for row in rows if row["run"] == name} for name in both)
    lost = []
    for pair in [pair for pair in own if pair in first]:
        # By the ground truth or, where there is none, by the held-out curves.
        known = own[pair].get("correspondence_mm") is not None
        key = "correspondence_mm" if known else "held_out_mm"
        ends, begins = own[pair].get(key), first[pair].get(key)
        if None not in (ends, begins) and ends > begins:
            lost.append(pair)
    return lost


MAIN = ("landmark_error", "mean_abs_mu", "correspondence_sulci_mm")


def summary(rows):
    """Run -> dict: counts "pairs", "failed", "certified"; each figure's mean over pairs by its
    name, its SD as "sd_of_" and the name (`MAIN` figures always, None where no pair has one);
    medians "seconds" of the map, and "stages"."""
    table = {}
    numbers = [key for row in rows for key, value in row.items() if type(value) in (int, float)]
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
        line["stages"] = {k: float(np.median([row["seconds"][k] for row in done])) for k in stages}
        line["seconds"] = line["stages"].get("map")
        table[run] = line
    return table
