"""Comparisons of runs: fronts, pairs that both runs have, and intervals."""

from pathlib import Path

import numpy as np
import pytest

from qcbook import comparisons
from qclearn.benchmark import read_measured


def row(pair="a", run="one", **figures):
    return {"pair": pair, "run": run, "certified": True, **figures}


def test_a_figure_that_a_pair_lacks_is_no_number():
    rows = [row("a", landmark_error=0), row("b"), row("c", landmark_error=None)]
    found = comparisons.column(rows, "one", "landmark_error")
    assert list(found) == ["a", "b", "c"] and np.isnan([found["b"], found["c"]]).all() and found["a"] == 0


def test_a_front_is_compared_at_the_baselines_distortion():
    points = [("one", 0.1, 1e-2), ("two", 0.3, 1e-4), ("base", 0.2, 2e-3)]
    rows = [row("a", run, mean_abs_mu=size, landmark_error=error) for run, size, error in points]
    beaten, between = row("a", "three", mean_abs_mu=0.15, landmark_error=0.02), (1e-2 + 1e-4) / 2
    folded = [rows[0], rows[1] | {"certified": False}, rows[2]]
    for given, runs, error in (
        (rows, ["one", "two"], between), ([*rows, beaten], ["one", "two", "three"], between),
        (rows, ["one"], 1e-2), (folded, ["one", "two"], 1e-2),  # held beyond the last point
        (rows, ["two"], np.nan),  # its least distortion is more than the baseline's
    ):  # fmt: skip
        ratio = pytest.approx(error / 2e-3, nan_ok=True)
        assert comparisons.front_ratio(given, runs, "base") == {"a": ratio}
    assert comparisons.front_ratio([*rows[:2], rows[2] | {"certified": False}], ["one", "two"], "base") == {}


def test_fronts_are_ahead_behind_or_level_by_their_interval():
    def rows_of(factors):
        return [
            row(pair, run, mean_abs_mu=0.2, landmark_error=error)
            for pair, factor in zip("abcd", factors)
            for run, error in (("fit", factor * 1e-3), ("base", 1e-3))
        ]

    found = {
        state: comparisons.compare_fronts(rows_of(factors), ["fit"], "base", np.random.default_rng(0))
        for state, factors in (("ahead", (0.5, 0.6, 0.5, 0.4)), ("behind", (2, 3, 2, 2)), ("level", (0.5, 2, 1, 1)))
    }
    assert {state: line["state"] for state, line in found.items()} == {state: state for state in found}
    assert found["behind"]["ratio"] == pytest.approx(24**0.25) and found["ahead"]["won"] == 4
    assert found["level"]["low"] < 1 < found["level"]["high"] and found["level"]["won"] == 1
    nobody = comparisons.compare_fronts([row("a", "fit")], ["fit"], "base", np.random.default_rng(0))
    assert nobody["state"] == "unknown" and nobody["pairs"] == 0


def test_runs_are_compared_on_the_pairs_that_both_have():
    errors = ("a", "one", 3), ("b", "one", 9), ("b", "two", 7), ("a", "two", 1), ("c", "one", 100)
    rows = [row(pair, run, landmark_error=error) for pair, run, error in errors]
    assert comparisons.compare_runs(rows, "one", "two", "landmark_error", np.random.default_rng(0)) == (2, 2, 2)


def test_a_doubtful_curve_counts_on_neither_side():
    held = {"STS": 9.0, "CS": 1.0, "POC": 2.0}
    rows = [row(f"{pair}, first half", held_out=held) for pair in ("CIV to ETI", "ETI to CIV", "CHO to FS5")]
    rows.append(row("FS5 to CIV, first half", held_out={"STS": 9.0}))
    assert ("CIV", "STS") in comparisons.doubtful_curves()
    assert [one["held_out_mm"] for one in comparisons.homologous(rows)] == [1.5, 1.5, 4.0]


def test_notes_are_counted_by_their_words():
    rows = [row("a", notes=["two overlaps mended", "overlap again"]), row("b"), row("a", "two", notes=["an overlap"])]
    assert comparisons.noted(rows, "one", "overlap") == 1 and comparisons.noted(rows, "one", "let go") == 0


def test_the_bootstrap_interval_of_paired_differences_is_the_normal_one_for_many_subjects():
    rng = np.random.default_rng(0)
    subject, noise = 100 * rng.normal(size=400), rng.normal(size=(2, 400))
    mean, low, high = comparisons.paired_difference(subject + noise[0] + 1, subject + noise[1], rng)
    error = np.std(noise[0] - noise[1]) / 20
    assert mean == pytest.approx(1 + (noise[0] - noise[1]).mean())
    assert (high - mean, mean - low) == pytest.approx((1.96 * error, 1.96 * error), rel=0.05)


def test_pairs_that_miss_a_figure_are_left_out():
    rng = np.random.default_rng(0)
    assert comparisons.paired_difference([1, 2, np.nan], [0, np.nan, 5], rng) == (1, 1, 1)
    assert np.isnan(comparisons.paired_difference([np.nan], [1], rng)).all()


@pytest.mark.parametrize(
    "network, rivals, words",
    [
        (2.0, {"exact solver": 4, "conjugate gradients": 5}, "saves 50% of"),
        (2.0, {"exact solver": 4, "conjugate gradients": 2.02}, "saves nothing of"),
        (2.2, {"exact solver": 4, "conjugate gradients": 2}, "adds 10% to"),
    ],
)
def test_dbsnet_saves_what_the_faster_rival_leaves(network, rivals, words):
    chains = {"networks": network, **rivals}
    rows = [
        {"vertices": vertices, "chain": chain, "stage": "landmarks", "seconds": took}
        for vertices in (7, 8, 9)
        for chain, took in chains.items()
    ]
    assert f"DBS-Net, corrected, {words} the whole pipeline" in comparisons.dbsnet_saves(rows)


def test_the_readme_says_that_a_stopped_solver_takes_no_longer():
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    words = "a classical solver that stops at DBS-Net's error takes no longer than DBS-Net." in readme
    assert words == ("DBS-Net, corrected, saves nothing" in comparisons.dbsnet_saves(read_measured("sizes")["rows"]))
