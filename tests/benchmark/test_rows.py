"""The benchmark's journal and results file: what is kept, resumed, refused, and what the means are."""

import errno
import json
import os
from pathlib import Path

import numpy as np
import pytest

from qclearn.benchmark.measured import BenchmarkError, plain, read_measured, schema
from qclearn.benchmark.rows import Journal, failures, summary
from qclearn.benchmark.runs import FRONT
from qclearn.benchmark.runs import RUNS as RUNS_OF_THE_BENCHMARK

OF_A_RUN = {"method": "harmonic", "parameters": {}, "landmarks": "given"}
RUNS = [{"name": "one", **OF_A_RUN, "sets": ["cohort"], "keep_field": False}]
SETTINGS = {
    "sets": ["cohort"],
    "subjects": 2,
    "seeds": [1001, 1002],
    "controls": [1000],
    "vertices": 1000,
    "generation": 2,
    "commit": "c0ffee",
    "runs": RUNS,
}
PROVENANCE = {
    "commit": "c0ffee",
    "date": "2026-01-01",
    "versions": {"qclearn": "0"},
    "processors": ["p"],
    "workers": 1,
    "threads_per_task": 1,
    "seconds": 1.0,
    "resumed": False,
    "left_out": {},
}


def row(pair="a", run="one", **figures):
    """A failed row, or a done one if it has figures: those not given are 0."""
    base = {"set": "cohort", "pair": pair, "run": run, **OF_A_RUN}
    if not figures:
        return base | {"status": "failed", "message": "it broke"}
    stages = ("disk_moving", "disk_control", "landmarks", "map", "pull_back")
    rest = {
        "flipped": 0,
        "bijective": True,
        "certified": True,
        "histogram": [0] * 50,
        "repetitions": 1,
        "notes": [],
        "held_out": None,
        "r_maps": None,
        "true_r_maps": None,
        "seconds": dict.fromkeys(stages, figures.pop("seconds", 1.0)),
    }
    needed = schema()["properties"]["rows"]["items"]["then"]["required"]
    return base | {"status": "done"} | dict.fromkeys(needed, 0.0) | rest | figures


@pytest.fixture
def out(tmp_path):
    return tmp_path / "results.json"


def test_rows_are_on_disk_at_once_and_become_a_results_file_that_is_read_again(out):
    journal = Journal(out, SETTINGS)
    journal.append(row("b", landmark_error=np.float64(0.5), max_abs_mu=np.inf, flipped=np.int64(2)))
    (kept,) = Journal(out, SETTINGS).rows
    assert kept["landmark_error"] == 0.5 and kept["max_abs_mu"] is None
    assert not out.exists()
    journal.append(row("a"))
    results = journal.finish(PROVENANCE)
    assert read_measured("benchmark", out) == results and [entry["pair"] for entry in results["rows"]] == ["a", "b"]
    assert sum(line.startswith('  {"set": "cohort"') for line in out.read_text().splitlines()) == 2  # a row a line
    assert not journal.checkpoint.path.exists()


def test_a_journal_is_gone_on_with_and_a_damaged_row_is_dropped(out):
    journal = Journal(out, SETTINGS)
    for pair in "ab":
        journal.append(row(pair, landmark_error=0.1))
    first, *_ = journal.checkpoint.names()
    (journal.checkpoint.path / first).write_bytes(b'{"set": "cohort", "pa')
    again = Journal(out, SETTINGS)
    assert len(again.rows) == 1
    for pair in "cab":  # a row that failed gives way, too
        again.append(row(pair))
        again.append(row(pair, landmark_error=0.2))
    assert sorted(entry["pair"] for entry in Journal(out, SETTINGS).rows) == ["a", "b", "c"]
    assert {entry.get("landmark_error") for entry in again.finish(PROVENANCE)["rows"]} == {0.2}


@pytest.mark.parametrize("changed", ["vertices", "generation", "commit", "runs"])
def test_a_journal_of_other_settings_is_refused(out, changed):
    Journal(out, SETTINGS)
    with pytest.raises(BenchmarkError, match=rf"other settings \({changed} differ\)"):
        Journal(out, SETTINGS | {changed: "another"})


def test_a_disk_that_fills_leaves_no_half_of_a_row(out, monkeypatch):
    def full(place, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    journal = Journal(out, SETTINGS)
    before = os.listdir(journal.checkpoint.path)
    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(BenchmarkError, match="row-.*json: .*No space left.*what was finished is kept: run it again"):
        journal.append(row())
    assert os.listdir(journal.checkpoint.path) == before


@pytest.mark.parametrize(
    "content, message",
    [
        (None, "cannot be read"),
        ("{", "not a JSON file"),
        ("[1]", "no results of this program"),
        ('{"schema_version": 99}', "schema version 99; this version reads 2"),
        ('{"schema_version": 2}', r"not a valid results file: \$: 'settings' is a required property"),
    ],
)
def test_other_files_are_refused(out, content, message):
    if content is not None:
        out.write_text(content)
    with pytest.raises(BenchmarkError, match=message):
        read_measured("benchmark", out)


def test_the_schema_refuses_rows_without_their_figures(out):
    journal = Journal(out, SETTINGS)
    lacking = row(landmark_error=0.1)
    del lacking["certified"]
    journal.append(lacking)
    with pytest.raises(BenchmarkError, match=r"rows\[0\].*'certified' is a required"):
        journal.finish(PROVENANCE)
    assert journal.checkpoint.path.exists() and not out.exists()


def test_every_field_of_the_schema_is_described():
    figures = schema()["properties"]["rows"]["items"]["properties"]
    own = {"set", "pair", "run", "method", "parameters", "landmarks", "status", "message", "seconds"}
    assert {name for name, entry in figures.items() if "description" not in entry} <= own


def test_plain_values_are_json():
    value = {"a": np.arange(2), "b": (np.float32(0.5), np.nan, True), 3: np.bool_(False)}
    assert plain(value) == {"a": [0, 1], "b": [0.5, None, True], "3": False}
    json.dumps(plain(value), allow_nan=False)


def test_means_are_over_the_pairs_that_have_a_figure():
    rows = [
        row("a", landmark_error=0.2, seconds=1.0, certified=False),
        row("b", landmark_error=0.4, seconds=5.0),
        row("c"),
        row("d", landmark_error=0.3, correspondence_sulci_mm=None, seconds=2.0),
        row("a", "two"),
    ]
    table = summary(rows)
    assert table["one"]["pairs"] == 4 and table["one"]["failed"] == 1 and table["one"]["certified"] == 2
    assert table["one"]["landmark_error"] == pytest.approx(0.3)
    assert table["one"]["sd_of_landmark_error"] == pytest.approx(0.1 * np.sqrt(2 / 3))
    assert table["one"]["seconds"] == table["one"]["stages"]["map"] == 2.0
    assert table["two"]["seconds"] is None and table["two"]["landmark_error"] is None
    assert table["one"]["sd_landmark_error"] == 0  # over landmarks, a figure of its own; not that over pairs
    assert "certified" not in [key for key in table["two"] if table["two"][key] is None]


def test_the_kept_results_hold_every_run_on_every_subject():
    results = read_measured("benchmark")
    rows = [entry for entry in results["rows"] if entry["set"] == "cohort"]
    everything = {run.name for run in RUNS_OF_THE_BENCHMARK + FRONT} - {"rotation"}  # newer than the file
    assert {run["name"] for run in results["settings"]["runs"]} >= everything
    assert results["settings"]["commit"].isalnum()  # of files that were committed as they were run
    for name in (run.name for run in RUNS_OF_THE_BENCHMARK + FRONT if "cohort" in run.sets):
        assert [entry["run"] for entry in rows].count(name) == results["settings"]["subjects"] >= 12
    fits = [entry for entry in results["rows"] if entry["method"] in ("gauss_newton", "cpnet_steps", "guarded")]
    assert all(entry["status"] == "done" and entry["certified"] for entry in fits)


@pytest.mark.parametrize(
    "truth, curves, failed",
    [
        ((7.0, 2.0), (1.0, 2.0), True),  # the truth says it, whatever the curves say
        ((1.0, 2.0), (3.0, 2.0), False),
        ((None, None), (3.0, 2.0), True),
        ((None, None), (2.0, 2.0), False),
        ((None, None), (None, None), False),
    ],
)
def test_a_map_that_ends_farther_than_it_began_has_failed(truth, curves, failed):
    row, start = ({"correspondence_mm": a, "held_out_mm": b, "pair": "p"} for a, b in zip(truth, curves))
    rows = [row | {"run": "mine"}, start | {"run": "rotation"}]
    assert failures(rows, "mine") == ["p"] * failed and failures(rows[:1], "mine") == []
