"""The radius: its covariance is the fit's own, its coverage as measured, and what is no radius fails the checks."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_register import bowl, entries

import qclearn as qc
from book.studies import calibrate_uncertainty
from commands import made  # noqa: F401 (a fixture)
from qclearn.benchmark.pairs import cohort_pair, mapped
from qclearn.cli import main, registration
from qclearn.io.hemisphere import read_hemisphere
from qclearn.plane.disk import Disk
from qclearn.registration.features import FOLDS
from qclearn.registration.problem import Problem, Weights
from qclearn.registration.uncertainty import ErrorRadius, Laplace, calibrated, uncertainty_report
from subjects import grown
from test_whole import to_register

KEPT = calibrated()
P = 0.6 * np.exp(2j * np.pi * np.arange(5) / 5)
PROBLEM = Problem(Disk(*qc.polar_disk(16, 48)), P, P * np.exp(0.1j) + 0.02)


def laplace_of(gamma=1e3):
    """The posterior of five landmarks' fit."""
    fit = qc.fit_landmarks(PROBLEM.disk.z, PROBLEM.disk.faces, PROBLEM.moving, PROBLEM.target, gamma=gamma)
    return Laplace(PROBLEM, Weights(gamma=gamma), fit.mu, fit.mobius, rings=6)


def test_the_derivative_is_that_of_the_map():
    """By central differences of the map itself."""
    one = laplace_of()
    state, objective, rng = one.state, one.objective, np.random.default_rng(0)
    change = (rng.normal(size=(len(state.nu), 2)) @ [1, 1j]) * 1e-5
    ahead, behind = (objective.at(state.nu + sign * change, state.mobius).f for sign in (1, -1))
    said = one.G[:, :-3] @ np.ascontiguousarray(change).view(float)
    assert abs(said - (ahead - behind) / 2).max() < 1e-3 * abs(said).max()


def test_a_landmark_more_shrinks_the_covariance_as_said():
    """`shrunk` against the posterior with one more row, made anew."""
    one, node = laplace_of(), 20
    J = np.stack([one.G[node].real, one.G[node].imag]) / np.sqrt(one.noise)
    covariances = np.linalg.inv(one.H), np.linalg.inv(one.H + J.T @ J)
    before, after = (np.einsum("nk,kl,nl->n", one.G.conj(), C, one.G).real for C in covariances)
    np.testing.assert_allclose(one.shrunk()[:, node], after / before, rtol=1e-6)


def test_sureness_comes_from_landmarks():
    """Ellipses at a landmark are small, far from all large, and shrink with gamma."""
    near, far = laplace_of().ellipses(np.array([PROBLEM.moving[0], -0.05 + 0j]))
    assert np.trace(near) < 0.3 * np.trace(far)
    (closer,) = laplace_of(1e5).ellipses(PROBLEM.moving[:1])
    assert np.trace(closer) < 0.1 * np.trace(near)


MOST = {"50": 0.04, "90": 0.03, "95": 0.02}  # by which a coverage may be off on average


def faults(pairs, rank):
    """What of the issue's bounds some judged pairs break: coverage on average and of each, in fifths, and rank."""
    covers = {at: [pair["coverage"][at] for pair in pairs] for at in MOST}
    fifths, ranks = np.mean([pair["fifths"] for pair in pairs], axis=0), [pair["rank"] for pair in pairs]
    apart = np.mean([pair["least_sure_mm"] / pair["surest_mm"] for pair in pairs])
    bounds = [
        *[(f"coverage at {at}, off by", abs(np.mean(covers[at]) - int(at) / 100), 0, off) for at, off in MOST.items()],
        *[("coverage of one pair", end(covers["90"]), 0.8, 0.98) for end in (min, max)],
        *[("coverage of a fifth", end(fifths), 0.84, 0.95) for end in (min, max)],
        *[("rank", np.mean(ranks), rank, 1), ("least rank", min(ranks), 0.05, 1)],
        ("errors of the least sure fifth over the surest's", apart, 1.8, np.inf),
    ]
    return [f"{name}: {value:.3f}" for name, value, low, high in bounds if not low <= value <= high]


def test_the_kept_radius_covers_what_it_says():
    judges = KEPT["folds"]["judge"]
    assert faults(judges, 0.33) == []
    constant = KEPT["folds"]["constant_mm"]["90"]
    assert np.mean([pair["mean_mm"] for pair in judges]) <= 0.95 * constant
    seeds = [{seed for pair in KEPT["folds"][part] for seed in pair["seeds"]} for part in ("calibrate", "judge")]
    assert not seeds[0] & seeds[1] and len(KEPT["folds"]["calibrate"]) >= 40 and len(judges) >= 12


def test_landmarks_alone_and_real_cortex_are_judged_apart():
    alone = KEPT["landmarks"]["judge"]
    assert np.mean([pair["rank"] for pair in alone]) >= 0.5
    assert abs(np.mean([pair["coverage"]["90"] for pair in alone]) - 0.9) <= 0.03
    fifths = np.mean([pair["fifths"] for pair in alone], axis=0)
    assert fifths.min() >= 0.84 and fifths.max() <= 0.96
    assert all(0.85 <= row["coverage"]["90"] <= 0.98 and row["median_mm"] <= 4.5 for row in KEPT["warps"])
    assert len(KEPT["curves"]) == 11 and all(row["distance_mm"] < row["radius_mm"] for row in KEPT["curves"])


def test_it_covers_at_the_ends_of_the_weights_for_which_it_is_given():
    rows = KEPT["ends"]
    usual, most = KEPT["weights"]["folds"], calibrate_uncertainty.MOST
    ends = [{name: usual[name] * factor**end} for name, factor in most.items() for end in (-1, 1)]
    assert [row["weights"] for row in rows[::2]][: len(ends)] == ends
    assert all(0.8 <= row["coverage"]["90"] <= 0.98 and row["rank"] > 0.05 for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in KEPT["folds"]["calibrate"] if max(row["vertices"]) == 6_000][:3])
def test_pairs_run_anew_give_what_was_kept(row):
    subjects = [grown(*of, generation=KEPT["generation"]) for of in zip(row["seeds"], row["vertices"])]
    sides = [replace(mapped(subject.surface), template=subject.template) for subject in subjects]
    arrays = calibrate_uncertainty.run(cohort_pair(*sides), "folds", row["curves"])
    now = calibrate_uncertainty.judged(arrays, KEPT["folds"]["factors"])
    assert now["coverage"] == pytest.approx(row["coverage"], abs=0.02)
    assert now["rank"] == pytest.approx(row["rank"], abs=0.03)
    assert now["mean_mm"] == pytest.approx(row["mean_mm"], rel=0.02)


@pytest.mark.parametrize("planted", ["right", "random", "constant"])
def test_what_is_no_radius_fails_the_same_checks(planted):
    """Errors drawn in the plane around nothing, each with the spread that the right radius tells."""
    rng, pairs = np.random.default_rng(0), []
    for _ in range(3):
        spread = np.exp(0.5 * rng.normal(size=6_000))
        error = spread * abs(rng.normal(size=6_000) + 1j * rng.normal(size=6_000))
        radius = {"right": spread, "random": rng.permutation(spread), "constant": 1 + 1e-9 * np.arange(6_000)}[planted]
        pairs.append({"radius": radius, "error": error, "areas": np.full(6_000, 1 / 6_000)})
    factors, _ = calibrate_uncertainty.factors_of(pairs, share=0.5)
    fault = faults([calibrate_uncertainty.judged(pair, factors) for pair in pairs], 0.33)
    assert fault == [] if planted == "right" else any("rank" in line for line in fault)


def test_the_command_writes_the_radius_and_tells_it(tmp_path, capsys, monkeypatch, plain_figure, made):  # noqa: F811
    """The file, the line, the report and the page; the radius is that of the call, to three digits."""
    results, out = [], tmp_path / "sure"

    def registered(*given, **options):
        results.append(qc.register(*given, **options))
        return results[0]

    monkeypatch.setattr(registration, "run_registration", registered)
    options = "--no-features", "--landmarks", made / "landmarks.json", "--uncertainty", "--report"
    main([*map(str, to_register(made, *options, "--out", out))])
    assert "within" in capsys.readouterr().out
    told = json.loads((out / "report.json").read_text(encoding="utf-8"))["uncertainty"]
    whole = qc.read_values(out / "uncertainty.shape.gii")
    radius = whole[np.isfinite(whole)]  # outside the cut there is none
    np.testing.assert_allclose(radius, results[0].uncertainty, rtol=1e-3)
    assert told["mean_mm"] == pytest.approx(results[0].report["uncertainty"]["mean_mm"], rel=1e-3)
    assert told["factors"] == KEPT["landmarks"]["factors"]
    assert np.isfinite(whole[told["next"]["vertex"]]) and len(whole) == 642 > len(radius)
    assert told["next"]["mean_mm"] < told["mean_mm"]
    assert "nine in ten vertices" in (out / "report.html").read_text(encoding="utf-8")
    assert np.median(radius) == pytest.approx(told["quantiles_mm"]["50"], rel=0.1)


def test_the_advice_on_one_more_curve_was_tried_where_the_truth_is_known():
    pairs = KEPT["next"]["pairs"]
    assert len(pairs) == 24 and all(one["told"] != one["random"] for one in pairs)
    before, told, lot = (np.array([one[f"{name}_mm"] for one in pairs]) for name in ("before", "told", "random"))
    assert (told / before).mean() < min((lot / before).mean(), 1)


@pytest.mark.parametrize("curves, features", [(entries(0), None), ([], FOLDS)], ids=["landmarks", "folds"])
def test_a_small_mesh_is_told_to_be_uncalibrated(curves, features):
    surface = bowl(0.4)
    found = qc.register(surface, surface, curves, features=features, uncertainty=True)
    assert found.report["uncertainty"]["factors"] == KEPT["folds" if features else "landmarks"]["factors"]
    assert found.report["seconds"]["uncertainty"] > 0
    assert found.report["uncertainty"]["calibrated_on"] == "uncalibrated below 6000 and beyond 20000 vertices"


@pytest.mark.parametrize("whole", [True, False])
def test_the_advised_vertex_is_told_in_the_numbers_of_the_surface_as_given(whole, tmp_path):
    side = read_hemisphere("fsaverage5:left")
    result = SimpleNamespace(uncertainty=np.ones(len(side.cut_surface.vertices)))
    report = {"uncertainty": {"next": {"vertex": 5_000, "mean_mm": 1.0}}}
    registration.write_uncertainty(tmp_path, result, report, side if whole else side.cut)
    surface = side.given if whole else side.cut_surface
    told = report["uncertainty"]["next"]["vertex"]
    np.testing.assert_allclose(surface.vertices[told], side.cut_surface.vertices[5_000])


@pytest.mark.parametrize("count, within", [(5_499, False), (5_501, True), (20_499, True), (20_501, False)])
def test_the_sizes_for_which_it_is_calibrated_count_to_a_thousand(count, within):
    surface = SimpleNamespace(vertices=np.zeros((count, 3)), vertex_areas=np.ones(count), area=count)
    side = SimpleNamespace(surface=surface)
    pair = SimpleNamespace(moving=side, control=side, features=None)
    radius, told = uncertainty_report(ErrorRadius(np.full(count, 2.0), 7, 0.5), pair)
    assert told["calibrated_on"].startswith("uncalibrated") != within
    assert told["mean_mm"] == pytest.approx(radius[0]) == pytest.approx(2 * KEPT["landmarks"]["factors"]["90"])
    assert told["next"] == {"vertex": 7, "mean_mm": pytest.approx(radius[0] / 2)}
