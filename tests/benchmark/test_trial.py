"""The benchmark's problems and what it measures of a map, on domes with known answers."""

import warnings
from dataclasses import replace
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from qclearn import nets
from qclearn.benchmark import Run
from qclearn.benchmark.pairs import Pair, cohort_pair, displacement_pair, mapped, prepare, twisted
from qclearn.benchmark.trial import judge_radius, trial
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.grids import polar, polar_disk
from qclearn.plane.mobius import mobius
from qclearn.registration.curves import curves_of_both, detect_curves
from qclearn.registration.start import sample_lines
from qclearn.surfaces.surface import Surface

RINGS, SPOKES = 14, 42


def dome(height=1.0, turn=0.0, power=1.0):
    """A cap with two curves along spokes and one across, in mm, mapped; the template is the unit hemisphere."""
    z, faces = polar_disk(RINGS, SPOKES)
    bent = z * abs(z) ** (power - 1) * np.exp(1j * turn * (1 - abs(z)))
    vertices = 50 * np.stack([bent.real, bent.imag, height * (1 - abs(bent) ** 2)], 1)
    spokes = [1 + SPOKES * np.arange(3, 9) + spoke for spoke in (4, 20)]
    curves = dict(zip(("first", "second"), spokes)) | {"third": 1 + SPOKES * 6 + np.arange(28, 38)}
    template = np.stack([z.real, z.imag, 1.2 - abs(z) ** 2], 1)
    return replace(
        mapped(Surface(vertices, faces, curves)), template=template / np.linalg.norm(template, axis=1, keepdims=True)
    )


@pytest.fixture(scope="module")
def pair():
    """The same template twice: every vertex corresponds to the one of its number."""
    return cohort_pair(dome(), dome(0.6, 0.4, 1.1))


def mine(problem, shift=0.0):
    return mobius(problem.disk.z, shift)


def test_the_true_map_of_a_pair_is_the_templates(pair):
    np.testing.assert_allclose(pair.truth, pair.control.surface.vertices, atol=1e-9)
    np.testing.assert_allclose(pair.truth_disk, pair.control.disk.z, atol=1e-12)
    assert [curve["name"] for curve in pair.curves] == ["first", "second", "third"]


def test_landmarks_are_the_curves_matched_by_arc_length_or_their_true_images(pair):
    given, exact = prepare(pair), prepare(pair, "exact")
    assert len(given.problem.moving) == 30 and given.problem.curve.tolist() == np.repeat(range(3), 10).tolist()
    ends = [0, 9, 10, 19]
    np.testing.assert_allclose(given.target[ends], exact.target[ends], atol=1e-9)
    assert abs(given.target - exact.target).max() > 1e-3  # between the ends the arc lengths differ
    np.testing.assert_allclose(exact.target, exact.samples @ pair.truth_disk)
    there = [curve["control"][k] for curve in pair.curves[:2] for k in (0, -1)]
    np.testing.assert_allclose(given.target_mm[ends], pair.control.surface.vertices[there], atol=1e-9)


def test_detected_curves_are_found_between_the_moving_ends(pair, monkeypatch):
    detect = Mock(side_effect=detect_curves)
    # A landmarks file of both surfaces' own curves says that these are not to be detected.
    fixed = replace(pair, curves=tuple(curve | {"detect": False} for curve in pair.curves))
    moving, ends = pair.moving, [[curve["moving"][0], curve["moving"][-1]] for curve in pair.curves]
    shortest = sample_lines(moving, detect_curves(moving.surface, moving.disk.z, ends))
    monkeypatch.setattr(nets, "load", lambda *_: SimpleNamespace(detect=detect))
    for source in ("path", "ldnet"):
        found = prepare(fixed, source)
        np.testing.assert_allclose(found.target, prepare(pair).target)
        np.testing.assert_allclose((found.samples - shortest).toarray(), 0, atol=1e-9)
    assert [call.args[2].tolist() for call in detect.mock_calls] == [ends]


@pytest.mark.parametrize("distance", [0.05, 0.3])
def test_displaced_landmarks_lie_that_far_from_their_targets(distance):
    control = dome()
    pair = displacement_pair(control, distance, 2, seed=0)
    path = np.concatenate([curve["moving"] for curve in pair.curves])
    assert len(pair.curves) == 2
    assert abs(control.disk.z - pair.truth_disk)[path].mean() == pytest.approx(distance, abs=5e-3)
    prepared = prepare(pair)
    np.testing.assert_allclose(prepared.target, prepared.samples @ pair.truth_disk)


def test_twists_keep_the_circle_and_are_undone_in_reverse():
    z, centres, turns = polar_disk(6, 18)[0], np.array([0.3, -0.2j]), np.array([0.7, -1.1])
    w = twisted(z, centres, turns)
    np.testing.assert_allclose(w[-18:], z[-18:], atol=1e-12)
    np.testing.assert_allclose(twisted(w, centres[::-1], -turns[::-1]), z, atol=1e-12)
    assert abs(w - z).max() > 0.2


def test_the_true_map_is_measured_as_one(pair):
    row = trial(pair, Run("truth", "mine", landmarks="exact"), lambda problem: pair.truth_disk)
    assert row["status"] == "done"
    assert row["landmark_error"] < 1e-12 and row["landmark_error_mm"] < 1e-9
    assert row["correspondence_mm"] < 1e-3 and row["correspondence_sulci_mm"] < 1e-9  # rim points are set in by 1e-4
    assert row["certified"] and row["flipped"] == 0 and sum(row["histogram"]) == len(pair.moving.surface.faces)
    assert row["landmark_error_true"] > 1e-4  # between their ends the curves' arc lengths do not correspond
    assert 0 < row["floor_curve_mm"] < row["floor_mm"] < 5  # curves correspond as sets, up to their shape there


def test_a_radius_is_judged_where_it_is_asked_for_and_the_truth_is_known(pair, monkeypatch):
    def far(moving, control, curves, **settings):
        assert settings == {"uncertainty": True, "features": None, "gamma": 1e4} and curves == list(pair.curves)
        radius = np.arange(1.0, len(pair.truth) + 1)
        off = np.where(np.arange(len(radius)) % 4, 0.5, 2.0) * radius
        return SimpleNamespace(points=pair.truth + off[:, None] * [1, 0, 0], uncertainty=radius)

    monkeypatch.setattr("qclearn.benchmark.trial.register", far)
    run = Run("fit", "gauss_newton", {"gamma": 1e4}, uncertainty=True)
    inside = np.average(np.arange(len(pair.truth)) % 4 > 0, weights=pair.moving.surface.vertex_areas)
    found = judge_radius(pair, run)
    assert found["coverage"] == pytest.approx(inside) and 0.5 < found["rank"] < 0.9
    for other, problem in ((replace(run, uncertainty=False), pair), (run, replace(pair, truth=None))):
        assert set(judge_radius(problem, other).values()) == {None}


def test_a_radius_is_judged_by_held_out_curves_where_no_truth_is_known(monkeypatch):
    """Two thirds of the vertices lie on the other side's curve, the others 2 mm above it."""
    side = dome()
    fitted, held, _ = curves_of_both(side.surface, side.surface)
    points, path = side.surface.vertices.copy(), held["moving"]
    points[path[::3], 2] += 2
    answer = SimpleNamespace(points=points, uncertainty=np.ones(len(points)))
    monkeypatch.setattr("qclearn.benchmark.trial.register", lambda *given, **settings: answer)
    found = judge_radius(Pair(side, side, (fitted,), held=(held,)), Run("folds", "landmark_free", uncertainty=True))
    assert found["curve_coverage"] == pytest.approx(1 - len(path[::3]) / len(path)) and found["curve_radius_mm"] == 1
    assert 1 < found["curve_ratio_90"] < 2.1 and found["coverage"] is None


def test_a_shifted_map_is_off_by_its_shift(pair):
    row = trial(displacement_pair(dome(), 0.1, 2, 0), Run("shift", "mine", {"shift": 0.1}), mine)
    assert row["floor_mm"] == 0 and row["landmark_error_true"] is None
    assert row["max_abs_mu"] < 0.05 and row["certified"]
    assert 0.05 < row["landmark_error"] < 0.25 and 1 < row["correspondence_mm"] < 15


def test_a_folded_map_is_not_certified_and_one_off_the_circle_neither(pair):
    def folded(problem):
        return np.where(np.arange(len(problem.disk.z)) == 5, 0.9, problem.disk.z)

    row = trial(pair, Run("folded", "folded"), folded)
    assert row["flipped"] > 0 and not row["bijective"] and not row["certified"]
    assert row["histogram"][-1] >= row["flipped"]  # |mu| > 1 is counted last
    row = trial(pair, Run("small", "small"), lambda problem: 0.9 * problem.disk.z)
    assert row["bijective"] and row["off_circle"] == pytest.approx(0.1) and not row["certified"]


FAILING = [
    (lambda problem: 1 / 0, "ZeroDivisionError: division by zero"),
    (lambda problem: problem.disk.z[:5], "returned an array of shape (5,)"),
    (lambda problem: problem.disk.z * np.nan, "not finite"),
]


@pytest.mark.parametrize("method, message", FAILING)
def test_a_method_that_fails_gives_a_row_that_says_so(pair, method, message):
    row = trial(pair, Run("bad", "bad"), method)
    assert row["status"] == "failed" and message in row["message"]


def test_times_are_medians_of_repetitions_that_know_nothing_of_the_disks_and_notes_are_kept(pair, monkeypatch):
    clock, durations = ([0.0], [0.5, 0.25, 0.125])  # a clock of our own, and what the three repetitions take by it
    monkeypatch.setattr("qclearn.benchmark.trial.time", SimpleNamespace(perf_counter=lambda: clock[0]))

    def slow_at_first(problem):
        for disk in (problem.disk, problem.pair.moving.disk, problem.pair.control.disk):
            assert set(vars(disk)) == {"z", "faces"} and disk.areas.all()  # known from here on
        clock[0] += durations.pop(0)
        warnings.warn("one row switched", RepairWarning, stacklevel=1)
        return problem.disk.z

    row = trial(pair, Run("slow", "slow"), slow_at_first)
    assert row.get("repetitions") == 3, row
    assert row["seconds"]["map"] == np.median([0.25, 0.125]) and row["seconds"]["landmarks"] > 0
    assert row["notes"] == ["one row switched"] and row["seconds"]["disk_moving"] == pair.moving.seconds


@pytest.mark.parametrize("pieces", [1, 20_000])  # small ones are kept by the allocator from one repetition to the next
def test_memory_that_a_method_takes_is_seen(pair, pieces):
    def large(problem):
        [np.ones(20_000_000 // pieces) for _ in range(pieces)]
        return problem.disk.z

    rows = [trial(pair, Run("any", "any"), method) for method in (lambda problem: problem.disk.z, large)]
    nothing, much = (row["peak_memory_mb"] for row in rows)
    assert much is None or nothing < much / 2


def test_a_field_is_kept_on_the_controls_disk(pair):
    row = trial(pair, Run("kept", "mine", {"shift": 0.2}, keep_field=True), mine)
    assert len(row["field"]) == len(polar(16).faces) and max(row["field"]) < 0.05
    assert "field" not in trial(pair, Run("plain", "mine"), mine)
