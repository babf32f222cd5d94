"""The pipeline on small surfaces: what it must find, what it must refuse, and maps carried over."""

import json
import re
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

import meshes
from known_surfaces import grooved_sphere
from meshes import random_disk
from qclearn.plane.beltrami import beltrami_coefficient, solve_beltrami_disk
from qclearn.plane.bijectivity import BijectivityError, check_bijective
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import best_mobius, compose_mobius, mobius
from qclearn.registration import register as pipeline
from qclearn.registration.curves import detect_curves, sample_curve
from qclearn.registration.fit import fit_landmarks, fit_problem
from qclearn.registration.problem import Weights
from qclearn.registration.transfer import transfer
from qclearn.surfaces.conformal import ParameterizedSurface, parameterize
from qclearn.surfaces.surface import Surface, mirror
from qclearn.surfaces.units import size_of
from reports import REPORT

register = partial(pipeline.register, features=None)  # bowls have no folds
bowl = partial(meshes.bowl, rings=14, lean=0.4)


def spoke(angle, rings=14, first=2, last=9):
    """The vertices of one spoke of the bowl, from the inside out."""
    return [1 + ring * 3 * rings + angle for ring in range(first, last)]


def entries(turn, **more):
    """Three spokes, on the control side turned by `turn` vertices."""
    return [{"name": f"spoke {k}", "moving": spoke(14 * k), "control": spoke(14 * k + turn), **more} for k in range(3)]


def moved(surface):
    """The surface elsewhere in space, in another unit."""
    turn = Rotation.from_euler("xyz", [0.5, -1, 2]).as_matrix()
    return Surface(30 * surface.vertices @ turn.T + [1, 2, 3], surface.faces)


@pytest.fixture(scope="module")
def pair():
    """Two bowls and spokes of which one is turned by two vertices and two by one."""
    curves = entries(1)
    curves[0]["control"] = spoke(2)
    return bowl(0.6), bowl(0.9), curves


@pytest.fixture(scope="module")
def turned(pair):
    return register(*pair), *pair


def test_a_surface_is_registered_to_itself_wherever_it_lies():
    surface = bowl(0.6)
    result = register(surface, moved(surface), entries(0))
    np.testing.assert_allclose(result.points, moved(surface).vertices, atol=30 * 2e-3)
    assert result.report["landmark_error"] < 1e-4 and result.report["max_abs_mu"] < 0.02


def test_mirrored_surfaces_are_registered_alike():
    """The same two surfaces seen in a mirror: the points are those of the mirror."""
    moving, control = bowl(0.6), bowl(0.9)
    usual = register(moving, control, entries(1))
    seen = register(mirror(moving), mirror(control), entries(1))
    np.testing.assert_allclose(seen.points, mirror(Surface(usual.points, moving.faces)).vertices, atol=2e-2)


def test_landmarks_are_met_and_the_report_measures_what_it_says(turned):
    result, moving, control, curves = turned
    report = result.report
    here = sparse.vstack([sample_curve(moving, entry["moving"]) for entry in curves])
    there = sparse.vstack([sample_curve(control, entry["control"]) for entry in curves])
    p, mapped, q = here @ result.disk_moving, here @ result.disk_map, there @ result.disk_control
    before = abs(mobius(p, *best_mobius(p, q)) - q).mean()
    assert report["landmark_error_before"] == pytest.approx(before)
    assert abs(p - q).mean() == pytest.approx(before, rel=1e-3)  # the moving disk is turned to the control
    assert report["landmark_error"] == pytest.approx(abs(mapped - q).mean(), rel=1e-6)
    assert report["landmark_error"] < before / 10
    lifted = ParameterizedSurface(control, Disk(result.disk_control, control.faces)).lift(mapped)
    millimetres = np.linalg.norm(lifted - there @ control.vertices, axis=1).mean() / size_of(control).mm
    assert report["landmark_error_mm"] == pytest.approx(millimetres)
    by_curve = [row["landmark_error"] for row in report["curves"]]
    assert by_curve == pytest.approx(abs(mapped - q).reshape(3, 10).mean(1), rel=1e-6)
    assert report["landmark_error"] == pytest.approx(np.mean(by_curve))
    assert [row["name"] for row in report["curves"]] == ["spoke 0", "spoke 1", "spoke 2"]


def test_the_map_is_certified_and_lands_on_the_control(turned):
    result, moving, _, _ = turned
    np.testing.assert_array_equal(result.mu, beltrami_coefficient(result.disk_moving, moving.faces, result.disk_map))
    size = abs(result.mu)
    found = [result.report[key] for key in ("mean_abs_mu", "sd_abs_mu", "max_abs_mu")]
    assert found == pytest.approx([size.mean(), size.std(), size.max()]) and size.max() < 1
    certificate = check_bijective(result.disk_moving, moving.faces, result.disk_map)
    assert certificate.bijective and result.report["bijective"] and result.report["flipped"] == 0
    Surface(result.points, moving.faces)
    assert result.report["degenerate"] == 0
    rim = result.points[moving.boundary]
    assert abs(np.hypot(rim[:, 0], rim[:, 1]) - 1).max() < 0.01  # on the control's own rim, between its vertices
    np.testing.assert_allclose(abs(result.disk_map[moving.boundary]), 1, atol=1e-12)


def test_the_report_has_the_agreed_keys_and_is_json(turned):
    report = turned[0].report
    assert set(report) >= REPORT and set(report) - REPORT == {"curves"}
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["fallbacks"] == report["suspect"] == [] and report["method"] == "exact"
    assert [report[name] for name in ("alpha", "beta", "gamma")] == [Weights.alpha, Weights.beta, Weights.gamma]
    for name in ("log2_area", "log2_shape"):
        half, most, all_of_it = report["distortion"][name].values()
        assert half < report[name][1] == most < all_of_it
    stages = dict(report["seconds"])
    assert stages.pop("total") == pytest.approx(sum(stages.values()), abs=1e-3) and min(stages.values()) >= 0


def test_a_sulcus_is_detected_where_only_its_ends_are_given():
    """And a chord between these stays, where the file says so."""
    surface, ends = grooved_sphere()
    curves = [
        {"name": "groove", "moving": ends, "control": ends},
        {"name": "chord", "moving": ends[::-1], "control": ends[::-1], "detect": False},
    ]
    result = register(surface, moved(surface), curves, gamma=1e2)
    moving, control = result.curves["groove"]
    assert len(moving) > 30 and (moving[[0, -1]] == result.disk_moving[ends]).all()
    np.testing.assert_allclose(control, moving, atol=0.02)
    np.testing.assert_array_equal(result.curves["chord"][0], result.disk_moving[ends[::-1]])


def test_curves_that_meet_on_both_sides_share_a_landmark():
    curves, ring = entries(1), np.arange(6)
    curves[1] = {"name": "along the ring", "moving": spoke(0)[0] + ring, "control": spoke(1)[0] + ring}
    result = register(bowl(0.6), bowl(0.9), curves)
    assert result.report["bijective"] and result.report["landmark_error"] < 1e-3


def test_wrong_landmarks_are_told_before_anything_is_fitted(monkeypatch):
    curves = entries(1)
    curves[1]["control"] = curves[1]["control"][::-1]
    fitted = register(bowl(0.6), bowl(0.9), curves, accept_suspect=True).report
    monkeypatch.setattr("qclearn.registration.register.fit_with_fallbacks", None)  # a fit would raise
    held = [*curves, {"name": "held", "moving": spoke(9), "control": spoke(9)}]
    result = register(bowl(0.6), bowl(0.9), held, uncertainty=False, hold_out=["held"])
    report = result.report
    assert report["stopped"].startswith("the landmarks or the surfaces are wrong") and fitted["stopped"] is None
    assert report["suspect"] == fitted["suspect"][:1] and report["suspect"][0].startswith("reversed: 'spoke 1' fits")
    assert report["bijective"] and report["flipped"] == 0 and report["held_out_mm"] == report["r"] == {}
    np.testing.assert_array_equal(result.disk_map, result.disk_moving)
    assert json.loads(json.dumps(report, allow_nan=False)) == report


@pytest.fixture
def folding_above(monkeypatch):
    """Let the fit report a fold wherever gamma exceeds a limit."""

    def limit(largest):
        def folding(problem, weights, *rest, **more):
            fit = fit_problem(problem, weights, *rest, **more)
            return fit if weights.gamma <= largest else replace(fit, bijective=False, flipped=np.array([7]))

        monkeypatch.setattr("qclearn.registration.fit.fit_problem", folding)

    return limit


def test_where_the_fit_folds_gamma_is_lowered_and_the_report_says_so(folding_above):
    folding_above(2e3)
    report = register(bowl(0.6), bowl(0.9), entries(0), gamma=1e5).report
    assert report["fallbacks"] == ["gamma lowered to 1000"] and report["bijective"]
    folding_above(0)
    message = r"down to gamma = 10 \(1 faces flipped\); check that no two curves cross"
    with pytest.raises(BijectivityError, match=message):
        register(bowl(0.6), bowl(0.9), entries(0), gamma=1e5)


def test_sliding_costs_less_distortion():
    """Targets spaced anew along the same spokes: by arc length the points move, as curves they need not."""
    moving, control = bowl(0.6), bowl(0.6)
    curves = [entry | {"control": spoke(14 * k, first=2, last=10)} for k, entry in enumerate(entries(0))]
    points, curved = (register(moving, control, curves, sliding=sliding, gamma=1e3).report for sliding in (False, True))
    assert curved["mean_abs_mu"] < points["mean_abs_mu"]


def test_detected_curves_are_measured_against_the_true_ones_where_the_surfaces_carry_them():
    bent = spoke(0)[:3] + [vertex + 1 for vertex in spoke(0)[3:6]] + spoke(0)[6:]
    # The moving side's path is carried the other way round than its ends are given, the control's as they are.
    moving = bowl(0.6, curves={"bent": bent, "elsewhere": spoke(20)})
    control = bowl(0.9, curves={"bent": bent[::-1], "elsewhere": spoke(20)})
    curves = [
        {"name": "bent", "moving": [bent[-1], bent[0]], "control": [bent[-1], bent[0]]},
        {"name": "elsewhere", "moving": [spoke(14)[0], spoke(14)[-1]], "control": spoke(14)},
    ]
    result = register(moving, control, curves)
    assert len(result.curves["elsewhere"][0]) > 2  # of two ends, whatever the other side gives
    found, unknown = result.report["curves"]
    p, q = (sample_curve(*side) for side in ((moving, bent), (control, bent)))
    off = abs(p @ result.disk_map - q @ result.disk_control).mean()
    assert found["landmark_error_true"] == pytest.approx(off) and "landmark_error_true" not in unknown
    assert result.report["landmark_error_true"] == found["landmark_error_true"] > 2 * found["landmark_error"]


# With networks, for which stand-ins serve here


def exact_predict(z, faces, moving, target, *, alpha, beta, gamma, curve=None):
    return fit_landmarks(z, faces, moving, target, alpha, beta, gamma, curve).mu


def no_predict(z, faces, moving, target, **_):
    return np.zeros(len(faces), complex)


def folding_solve(z, faces, mu):
    """The exact map with one vertex in the wrong place."""
    f = solve_beltrami_disk(z, faces, mu)
    f[np.argmin(abs(z - 0.5))] *= -1
    return f


@pytest.fixture
def networks(monkeypatch):
    """Puts stand-ins in the networks' places; the exact counterpart where none is named."""

    def install(detect=detect_curves, predict=exact_predict, solve=solve_beltrami_disk):
        blocks = SimpleNamespace(detect=detect, predict=predict, solve=solve)
        monkeypatch.setattr("qclearn.nets.load", lambda name: blocks)

    return install


def by_networks(pair, **options):
    return register(*pair, method="network", **options)


def test_exact_twins_behind_the_networks_calls_need_no_fallback(networks, pair, turned):
    seen = []

    def predict(z, faces, moving, target, **more):
        seen.append((len(moving), len(target), more.pop("curve").tolist(), more))
        return exact_predict(z, faces, moving, target, **more)

    networks(predict=predict)
    result = by_networks(pair, alpha=2.0, beta=0.1, gamma=1e4)
    report = result.report
    assert seen == [(30, 30, [0] * 10 + [1] * 10 + [2] * 10, {"alpha": 2.0, "beta": 0.1, "gamma": 1e4})]
    assert report["fallbacks"] == [] and report["bijective"] and report["method"] == "network"
    stages = "load disk_moving disk_control align detect predict solve certify refine pull_back total"
    assert list(report["seconds"]) == stages.split()
    assert REPORT | {"curves", "tolerance"} == set(report) and report["tolerance"] == 5e-3
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert report["landmark_error"] < 2e-3 and report["landmark_error_before"] > 2e-2
    np.testing.assert_array_equal(result.mu, beltrami_coefficient(result.disk_moving, pair[0].faces, result.disk_map))
    before = turned[0].report["landmark_error_before"]
    assert report["landmark_error_before"] == pytest.approx(before, rel=1e-9)  # the same curves, filled up


def test_the_mobius_part_is_found_after_the_network(networks, pair):
    """A solver in another gauge changes nothing but the Möbius map that is reported."""
    networks()
    usual = by_networks(pair)
    networks(solve=lambda z, faces, mu: mobius(solve_beltrami_disk(z, faces, mu), 0.2 - 0.1j, 1.0))
    other = by_networks(pair)
    np.testing.assert_allclose(other.disk_map, usual.disk_map, atol=2e-4)  # maps are linear between vertices
    here, there = ((complex(*r.report["mobius"]["a"]), r.report["mobius"]["theta"]) for r in (usual, other))
    assert compose_mobius((0.2 - 0.1j, 1.0), there) == pytest.approx(here, abs=1e-3)


@pytest.mark.parametrize("solve, words", [
    (folding_solve, r"folded \d faces"), (lambda z, *_: z * np.nan, "was not finite"),
    (lambda *given: solve_beltrami_disk(*given).conj(), r"folded \d+ faces"),
])  # fmt: skip
def test_where_the_solver_network_folds_the_exact_solver_steps_in(networks, pair, solve, words):
    networks()
    usual = by_networks(pair)
    networks(solve=solve)
    result = by_networks(pair)
    (fallback,) = result.report["fallbacks"]
    assert re.fullmatch(f"DBS-Net's map {words}: exact solver", fallback)
    np.testing.assert_allclose(result.disk_map, usual.disk_map, atol=1e-9)
    assert result.report["bijective"] and result.report["flipped"] == 0


def test_where_the_exact_solver_folds_too_its_rows_are_switched(networks, pair):
    """A coefficient that jumps from face to face, which no mesh of this size can follow."""
    rough = 0.97 * np.exp(1j * np.pi * np.random.default_rng(3).uniform(-1, 1, len(pair[0].faces)))
    networks(predict=lambda *_, **__: rough, solve=folding_solve)
    result = by_networks(pair, tolerance=np.inf)
    folded, switched, _ = result.report["fallbacks"]
    assert folded.startswith("DBS-Net's map folded") and re.fullmatch(r"\d+ rows switched", switched)
    (reason,) = [reason for reason in result.report["suspect"] if reason.startswith("rows: ")]
    assert f"at {switched.split()[0]} of 589 vertices" in reason
    assert check_bijective(result.disk_moving, pair[0].faces, result.disk_map).bijective
    assert result.report["tolerance"] is None


def test_where_the_landmarks_are_missed_steps_follow_from_the_networks_coefficient_until_the_tolerance(
    networks, pair, monkeypatch
):
    networks(predict=no_predict)
    missed = by_networks(pair, tolerance=np.inf).report
    assert missed["fallbacks"] == []
    assert missed["landmark_error"] == pytest.approx(missed["landmark_error_before"], rel=1e-3)
    seen, prediction = [], no_predict(*[pair[0].faces] * 4)

    def fit(*arguments, **options):
        seen.append(options)
        return fit_problem(*arguments, **options)

    monkeypatch.setattr("qclearn.registration.fit.fit_problem", fit)
    networks(predict=lambda *_, **__: prediction)
    report = by_networks(pair, tolerance=2e-3).report
    assert seen[0]["start_mu"] is prediction and seen[0]["enough"] == pytest.approx(1.8e-3)
    (words,) = report["fallbacks"]
    found = re.fullmatch(r"landmark error (\S+) above (\S+): (\d+) Gauss-Newton steps, to (\S+)", words)
    told = [missed["landmark_error"], 2e-3, report["landmark_error"]]
    assert [float(found[k]) for k in (1, 2, 4)] == pytest.approx(told, rel=0.06)
    assert report["landmark_error"] <= 2e-3 and report["bijective"] and int(found[3]) > 0


def test_a_curve_that_wanders_is_replaced_and_the_report_says_so(networks):
    networks(lambda surface, z, ends: [line * np.nan for line in detect_curves(surface, z, ends)], no_predict)
    surface, ends = bowl(0.6), [spoke(0)[0], spoke(0)[-1]]
    report = register(surface, surface, [{"name": "groove", "moving": ends, "control": ends}], "network").report
    told = [f"LD-Net's {side} curve 'groove' leaves the disk: shortest path" for side in ("moving", "control")]
    assert report["fallbacks"][:2] == told


def test_a_coarse_curve_is_measured_along_the_surface(networks):
    """Two points on a bowl: the landmarks are equally spaced over its rise, not along the chord below it."""
    surface = bowl(2.0)
    networks(lambda surface, z, ends: [z[pair] for pair in ends], no_predict)
    across = [spoke(0)[-1], spoke(21)[-1]]
    curves = [{"name": "across", "moving": across, "control": across}]
    line = register(surface, surface, curves, method="network", tolerance=np.inf).curves["across"][0]
    where = parameterize(surface).lift(line)
    assert np.linalg.norm(np.diff(where, axis=0), axis=1).sum() > 1.3 * np.linalg.norm(where[-1] - where[0])


def test_the_shipped_networks_register(pair):
    """Whatever they propose for these bowls: what comes back is certified and within the tolerance."""
    moving, control, curves = pair
    curves = [curves[0], curves[1] | {"moving": curves[1]["moving"][::6], "control": curves[1]["control"][::6]}]
    report = register(moving, control, curves, method="network", gamma=1e4).report
    assert report["bijective"] and report["flipped"] == 0 and report["landmark_error"] <= 5e-3


# Maps carried over


def test_coordinates_are_carried_to_the_points_and_back(turned):
    result, moving, control, _ = turned
    there = transfer(control.vertices, result.disk_control, control.faces, result.disk_map)
    np.testing.assert_allclose(there, result.points, atol=1e-12)
    back = transfer(there, result.disk_map, moving.faces, result.disk_control)
    assert np.linalg.norm(back - control.vertices, axis=1).max() < 0.03  # a third of an edge, where a face is cut off


def test_labels_are_carried_by_the_nearest_corner_and_must_be_one_a_vertex(turned):
    result, moving, control, _ = turned
    labels = np.where(control.vertices[:, 0] > 0, 7, 3)
    there = transfer(labels, result.disk_control, control.faces, result.disk_map, nearest=True)
    assert there.dtype == labels.dtype and set(there.tolist()) == {3, 7}
    clear = abs(result.points[:, 0]) > 0.1
    np.testing.assert_array_equal(there[clear], np.where(result.points[clear, 0] > 0, 7, 3))
    itself = transfer(np.arange(len(moving.vertices)), result.disk_map, moving.faces, result.disk_map, nearest=True)
    np.testing.assert_array_equal(itself, np.arange(len(moving.vertices)))
    with pytest.raises(ValueError, match=r"1 values for .* read_values\(path\)"):
        transfer("lh.sulc", result.disk_control, control.faces, result.disk_map)
    with pytest.raises(ValueError, match="5 values for 589 vertices: give one a vertex"):
        transfer(np.zeros(5), result.disk_control, control.faces, result.disk_map)


def test_whole_numbers_are_not_blended_and_a_hint_tells_of_floats(turned):
    result, moving, control, _ = turned
    there = partial(transfer, z_from=result.disk_control, faces_from=control.faces, z_to=result.disk_map)
    labels = np.arange(len(control.vertices)) % 3
    for values in (labels, labels > 1, labels.astype(np.uint8), [None] * len(labels)):
        with pytest.raises(ValueError, match=r"may be labels, .* nearest=True, or give values.astype\(float\)"):
            there(values)
        with pytest.raises(ValueError, match=r"sum needs amounts \(floats\), and faces_to"):
            there(values, sum=True, faces_to=moving.faces)
    with pytest.raises(ValueError, match="in no face; do the mesh and the vertices belong together"):
        there(control.vertices[:, 0], sum=True, faces_to=moving.faces[:99])
    with pytest.warns(UserWarning, match="whole numbers, carried as numbers; give nearest=True"):
        there(np.where(labels, labels, np.nan))


@pytest.mark.parametrize("rings", [14, 30, 7])
def test_amounts_keep_their_sum_and_a_constant_density(pair, rings):
    """From a mesh to a like, a finer and a coarser one, against what fine parts of faces fall to."""
    at, to = Disk(*random_disk(0, 90)), Disk(*polar_disk(rings, 3 * rings))
    a, A = (mesh.to_faces.T @ mesh.areas for mesh in (at, to))
    there = partial(transfer, z_from=at.z, faces_from=at.faces, z_to=to.z, sum=True, faces_to=to.faces)
    np.testing.assert_allclose(there(3 * a), 3 * A * a.sum() / A.sum(), rtol=1e-12)
    density = np.exp(at.z.real + 2 * at.z.imag)
    amounts = np.stack([a * density, a, -a * density], axis=1)
    for nearest in (False, True):
        np.testing.assert_allclose(there(amounts, nearest=nearest).sum(0), amounts.sum(0), rtol=1e-12)
    wanted = A * np.exp(to.z.real + 2 * to.z.imag)
    np.testing.assert_allclose(there(amounts[:, 0]), wanted, rtol=0.05)
    itself = transfer(amounts, at.z, at.faces, at.z, sum=True, faces_to=at.faces)
    np.testing.assert_allclose(itself, amounts, rtol=1e-12)
    lost = np.where(abs(at.z) > abs(at.z).min(), a, np.nan)
    part = there(lost)
    np.testing.assert_array_equal(part[~np.isnan(part)], there(np.nan_to_num(lost))[~np.isnan(part)])
