"""The benchmark's journal and results file: what is kept, resumed, refused, and what the means are."""

import shutil

import numpy as np
import pytest

from qclearn.benchmark.measured import BenchmarkError, read_measured, schema
from qclearn.benchmark.rows import Journal, failures, summary
from qclearn.benchmark.runs import FRONT
from qclearn.benchmark.runs import RUNS as TABLE

KEPT = read_measured("benchmark")
OF_A_RUN = {"method": "harmonic", "parameters": {}, "landmarks": "given"}
RUNS = [{"name": "one", **OF_A_RUN, "sets": ["cohort"], "keep_field": False}]
SETTINGS, PROVENANCE = KEPT["settings"] | {"runs": RUNS}, KEPT["provenance"]
DONE = next(kept for kept in KEPT["rows"] if kept["status"] == "done" and kept["certified"])


def row(pair="a", run="one", **figures):
    """A failed row, or a done one if it has figures: those not given are a kept row's."""
    own = {"set": "cohort", "pair": pair, "run": run, **OF_A_RUN}
    return DONE | own | figures if figures else own | {"status": "failed", "message": "it broke"}


@pytest.fixture
def out(tmp_path):
    return tmp_path / "results.json"


def test_rows_are_on_disk_at_once_and_become_a_results_file_that_is_read_again(out):
    journal = Journal(out, SETTINGS)
    numbers = {"landmark_error": np.float32(0.5), "max_abs_mu": np.inf, "sd_abs_mu": np.nan, "flipped": np.int64(2)}
    journal.append(row("b", **numbers, histogram=np.arange(50), certified=np.bool_(False), notes=("a",)))
    (kept,) = Journal(out, SETTINGS).rows
    assert [kept[name] for name in numbers] == [0.5, None, None, 2]
    assert kept["histogram"] == list(range(50)) and kept["certified"] is False and kept["notes"] == ["a"]
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


def test_a_journal_of_other_settings_or_whose_folder_goes_is_refused(out):
    journal = Journal(out, SETTINGS)
    with pytest.raises(BenchmarkError, match=r"other settings \(commit, runs differ\)"):
        Journal(out, SETTINGS | {"commit": "another", "runs": []})
    shutil.rmtree(journal.checkpoint.path)
    with pytest.raises(BenchmarkError, match="row-.*json: .*No such file.*what was finished is kept: run it again"):
        journal.append(row())


OTHERS = {
    None: "cannot be read",
    "{": "not a JSON file",
    "[1]": "no results of this program",
    '{"schema_version": 99}': "schema version 99; this version reads 2",
    '{"schema_version": 2}': r"not a valid results file: \$: 'settings' is a required property",
}


@pytest.mark.parametrize("content, message", OTHERS.items())
def test_other_files_are_refused(out, content, message):
    if content is not None:
        out.write_text(content)
    with pytest.raises(BenchmarkError, match=message):
        read_measured("benchmark", out)


def test_the_schema_refuses_rows_without_their_figures(out):
    journal = Journal(out, SETTINGS)
    journal.append({name: value for name, value in row(landmark_error=0.1).items() if name != "certified"})
    with pytest.raises(BenchmarkError, match=r"rows\[0\].*'certified' is a required"):
        journal.finish(PROVENANCE)
    assert journal.checkpoint.path.exists() and not out.exists()


def test_every_field_of_the_schema_is_described():
    figures = schema()["properties"]["rows"]["items"]["properties"]
    own = {"set", "pair", "run", "method", "parameters", "landmarks", "status", "message", "seconds"}
    assert {name for name, entry in figures.items() if "description" not in entry} <= own


def test_means_are_over_the_pairs_that_have_a_figure():
    first = row("a", landmark_error=0.2, sd_landmark_error=0, certified=False, seconds={"map": 1.0})
    second = row("b", landmark_error=0.4, sd_landmark_error=0, seconds={"map": 5.0})
    third = first | {"pair": "d", "landmark_error": 0.3, "certified": True, "seconds": {"map": 2.0}}
    third["correspondence_sulci_mm"] = None
    table = summary([first, second, row("c"), third, row("a", "two")])
    assert table["one"]["pairs"] == 4 and table["one"]["failed"] == 1 and table["one"]["certified"] == 2
    assert table["one"]["landmark_error"] == pytest.approx(0.3)
    assert table["one"]["sd_of_landmark_error"] == pytest.approx(0.1 * np.sqrt(2 / 3))
    assert table["one"]["seconds"] == table["one"]["stages"]["map"] == 2.0
    assert table["two"]["seconds"] is None and table["two"]["landmark_error"] is None
    assert table["one"]["sd_landmark_error"] == 0  # over landmarks, a figure of its own; not that over pairs
    assert "certified" not in [key for key in table["two"] if table["two"][key] is None]


def test_the_kept_results_hold_every_run_on_every_subject():
    rows = [entry["run"] for entry in KEPT["rows"] if entry["set"] == "cohort"]
    everything = {run.name for run in TABLE + FRONT} - {"rotation"}  # newer than the file
    assert {run["name"] for run in KEPT["settings"]["runs"]} >= everything
    assert KEPT["settings"]["commit"].isalnum()  # of files that were committed as they were run
    for name in (run.name for run in TABLE + FRONT if "cohort" in run.sets):
        assert rows.count(name) == KEPT["settings"]["subjects"] >= 12
    fits = [entry for entry in KEPT["rows"] if entry["method"] in ("gauss_newton", "cpnet_steps", "guarded")]
    assert all(entry["status"] == "done" and entry["certified"] for entry in fits)


NONE = None, None
FARTHER = [  # each from the truth and from held-out curves: where it ends and where it began
    ((7.0, 2.0), (1.0, 2.0), True),  # the truth says it, whatever the curves say
    ((1.0, 2.0), (3.0, 2.0), False),
    (NONE, (3.0, 2.0), True),
    (NONE, (2.0, 2.0), False),
    (NONE, NONE, False),
]


@pytest.mark.parametrize("truth, curves, failed", FARTHER)
def test_a_map_that_ends_farther_than_it_began_has_failed(truth, curves, failed):
    row, start = ({"correspondence_mm": a, "held_out_mm": b, "pair": "p"} for a, b in zip(truth, curves))
    rows = [row | {"run": "mine"}, start | {"run": "rotation"}]
    assert failures(rows, "mine") == ["p"] * failed and failures(rows[:1], "mine") == []
