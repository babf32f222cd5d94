"""What a suspect registration is recognised by: six mistakes by name, and outcomes that good landmarks do not have."""

from copy import deepcopy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import meshes
from qclearn.benchmark import read_measured
from qclearn.io.fsaverage import demo_landmarks, fsaverage5
from qclearn.plane.disk import Disk
from qclearn.plane.grids import polar_disk
from qclearn.plane.mobius import mobius
from qclearn.registration import diagnose
from qclearn.registration.curves import check_curves
from qclearn.registration.diagnose import LIMITS, align_by_folds, diagnose_landmarks, reasons, with_folds, worse
from qclearn.registration.problem import LandmarkError
from qclearn.registration.report import ERRORS
from qclearn.registration.start import SurfacePair, align_disks
from qclearn.surfaces.conformal import parameterize
from qclearn.surfaces.surface import Surface, mirror

SULCI = demo_landmarks()["curves"]
# With ends whose numbers on the whole surface are larger than any on the cut one.
BEYOND = "calcarine sulcus", "intraparietal sulcus", "collateral sulcus"
SUBSETS = [slice(0, 4), slice(4, 8), slice(7, 11), slice(None, None, 3), slice(2, 9), slice(None)]  # of the eleven


@pytest.fixture(scope="module")
def sides():
    """fsaverage5's mirrored right hemisphere and its left one, each on its disk."""
    return SurfacePair(parameterize(mirror(fsaverage5("right"))), parameterize(fsaverage5("left")), [], [])


def with_curves(sides, curves):
    return replace(sides, curves=check_curves(curves, sides.moving.surface, sides.control.surface, fewest=0))


def messages_of_curves(sides, curves):
    """The mistakes found in curves of the two sides."""
    return diagnose_landmarks(with_curves(sides, curves))


def messages_of(folded_pair, curves):
    """The mistakes found where the two sides are laid upon each other first, by their folds."""
    return diagnose_landmarks(align_disks(with_curves(folded_pair, curves)))


def backwards(entry):
    return entry | {"moving": entry["moving"][::-1]}


def exchanged(sides):
    return replace(sides, moving=sides.control, control=sides.moving)


def mirrored(sides):
    """The sides with the moving one mirrored, and its features, if any, which know nothing of hands."""
    surface = mirror(sides.moving.surface)
    disk = Disk(sides.moving.disk.z.conj(), surface.faces)
    return replace(sides, moving=replace(sides.moving, surface=surface, disk=disk))


def words(reasons):
    return [reason.split(":")[0] for reason in reasons]


@pytest.mark.parametrize("subset", SUBSETS, ids=str)
def test_good_landmarks_are_not_suspect_and_mistakes_of_all_of_them_are_recognised(sides, subset):
    curves = SULCI[subset]
    back = [entry | {"moving": entry["control"], "control": entry["moving"]} for entry in curves]
    assert messages_of_curves(sides, curves) == messages_of_curves(exchanged(sides), back) == []
    for pair, given, word, *texts in (
        (mirrored(sides), curves, "mirror", "--mirror"),
        (exchanged(sides), curves, "exchanged", "MOVING and CONTROL"),
        (sides, [backwards(entry) for entry in curves], "reversed", *(entry["name"] for entry in curves)),
    ):
        (reason,) = messages_of_curves(pair, given)
        assert reason.startswith(f"{word}: ") and all(text in reason for text in texts)


@pytest.mark.parametrize("subset", SUBSETS[:-1], ids=str)
@pytest.mark.parametrize("wrong", [("moving",), ("control",), ("moving", "control")], ids="+".join)
def test_numbers_of_the_whole_surface_are_recognised(sides, subset, wrong):
    curves = deepcopy(SULCI[subset])
    for entry in curves:
        for side in wrong:
            entry[side] = getattr(sides, side).surface.original_vertices[entry[side]].tolist()
    try:
        (reason,) = messages_of_curves(sides, curves)
    except LandmarkError as error:  # one of them is out of range on the cut surface
        reason = str(error).partition("before it was cut open, say)? ")[2]
        assert any(f"'{name}'" in str(error) for name in BEYOND)
    assert reason.startswith("numbering: ") and "whole surface" in reason


@pytest.mark.parametrize("which", range(11), ids=[entry["name"] for entry in SULCI])
def test_one_curve_run_backwards_is_recognised_and_named(sides, which):
    curves = deepcopy(SULCI)
    curves[which]["control"].reverse()
    (reason,) = messages_of_curves(sides, curves)
    assert reason.startswith(f"reversed: {SULCI[which]['name']!r} fits")


@pytest.mark.parametrize("first, second", [(0, 1), (2, 3), (6, 8), (0, 9), (9, 4), (5, 10)])
def test_two_swapped_names_are_recognised_and_named(sides, first, second):
    curves = deepcopy(SULCI)
    curves[first]["moving"], curves[second]["moving"] = curves[second]["moving"], curves[first]["moving"]
    (reason,) = messages_of_curves(sides, curves)
    assert reason.startswith("swapped: ")
    assert [k for k, entry in enumerate(SULCI) if repr(entry["name"]) in reason] == sorted([first, second])


def test_several_mistakes_are_told_apart(sides):
    """Three names in a ring, another curve backwards, and all of it mirrored."""
    curves = deepcopy(SULCI)
    for k in range(3):
        curves[k]["moving"] = SULCI[(k + 1) % 3]["moving"]
    curves[4]["moving"].reverse()
    found = _, turned, ring = messages_of_curves(mirrored(sides), curves)
    assert words(found) == ["mirror", "reversed", "swapped"]
    assert repr(SULCI[4]["name"]) in turned and all(repr(SULCI[k]["name"]) in ring for k in range(3))


def test_what_is_found_does_not_hang_on_the_disk_maps_gauge(sides):
    curves = [backwards(entry) for entry in SULCI[:5]]
    disk = sides.moving.disk
    moving = replace(sides.moving, disk=disk.at(mobius(disk.z, 0.5 - 0.3j, 2.0)))
    assert messages_of_curves(replace(sides, moving=moving), curves) == messages_of_curves(sides, curves) != []


def test_surfaces_that_share_one_numbering_are_not_called_exchanged(sides):
    """One mesh whose curves lie elsewhere in one of its disk maps, and targets off by as much: exchanged they fit."""
    control, w = sides.control, sides.control.disk.z
    paths = np.array([entry["control"] for entry in SULCI[:6]])
    rng = np.random.default_rng(3)
    away = 0.03 * np.exp(2j * np.pi * rng.uniform(size=paths.shape))
    there = np.array([abs(w - place).argmin() for place in (w[paths] + away).ravel()]).reshape(paths.shape)
    assert not set(there.ravel()) & set(paths.ravel())
    moved = w.copy()
    moved[paths] = w[there]  # where exchanged curves have no misfit, and the given ones twice `away`
    moved[there] = 2 * w[there] - w[paths]
    curves = [
        {"name": str(k), "moving": one.tolist(), "control": other.tolist()}
        for k, (one, other) in enumerate(zip(paths, there))
    ]
    both = with_curves(SurfacePair(control, replace(control, disk=control.disk.at(moved)), [], []), curves)
    given = diagnose.given_hypothesis(both)
    others = diagnose.surface_hypotheses(given, both)
    found = diagnose.compared(given, next(other for other in others if "exchanged" in other.reason))
    assert found["better"] < 0.1 < found["given"] < LIMITS["surface_given"]
    assert diagnose_landmarks(both) == []


# What the map shows


FLAT = SimpleNamespace(
    vertices=np.zeros((1000, 3)), faces=np.zeros((1, 3), int), face_areas=np.ones(1), area=1.0, original_vertices=None
)
GOOD = SimpleNamespace(switched=5, mu=np.zeros(1))


def told(errors, before=0.1, after=0.05):
    """The reasons for curves a, b, ... that end so many millimetres off, of a map without faults."""
    disk = {"landmark_error_before": before, "landmark_error": after}
    rows = [disk | {"name": name, "landmark_error_mm": error} for name, error in zip("abcdefg", errors)]
    return list(reasons(FLAT, rows, GOOD, 1.0, True))


def test_a_large_error_that_the_map_has_not_reduced_an_odd_curve_and_many_switched_rows_are_told():
    assert told([2.9], after=0.1) == told([9.0], after=0.03) == list(reasons(FLAT, [], GOOD, 4.9, True)) == []
    (reason,) = told([3.2, 3.0])
    assert reason.startswith("error: ") and "3.1 mm" in reason and "50 %" in reason and "gamma" in reason
    (reason,) = told([1.0, 1.2, 6.1, 0.9])
    assert reason.startswith("curve: 'c' ends 6.1 mm")
    assert told([0.8, 0.96, 4.88, 0.72]) == told([1.0, 1.2, 6.1, 0.9, 7.0, 7.0, 7.0], after=0.01) == []  # all are bad
    (reason,) = reasons(FLAT, [], SimpleNamespace(switched=6, mu=np.zeros(1)), 1.0, True)
    assert reason.startswith("rows: ") and "6 of 1000 vertices; the features ask for folds" in reason


@pytest.mark.parametrize("numbers, named", [(None, [0, 1, 2]), (np.arange(4, 9), [4, 5, 6])])
def test_needles_and_not_landmarks_are_named_where_a_map_folds_at_them(numbers, named):
    """By the vertices of the file, with as many landmarks as there are."""
    points = [[0, 0, 0], [1, 0, 0], [0.4, 1e-4, 0], [1, 1, 0], [0, 1, 0]]
    surface = Surface(points, [[1, 3, 2], [0, 1, 2], [2, 3, 4], [2, 4, 0]], None, numbers)
    disk = {"landmark_error_before": 1.0, "landmark_error": 0.0, "name": "a", "landmark_error_mm": 0.0}
    for rows in ([], [disk]):
        (reason,) = reasons(surface, rows, SimpleNamespace(switched=2, mu=np.zeros(4)), 1.0, True)
        assert "; needle triangles of the moving surface ask for it (1, up to 1e+04 times" in reason
        assert f"have the vertices [{named}]): merge" in reason
        assert ("the landmarks are probably wrong" in reason) == bool(rows)


def test_areas_are_told_and_those_of_one_curve_alone_have_more_room():
    one = [{"name": "a"} | dict.fromkeys(ERRORS, 0.1)]
    for rows, folds, log2_area in ((one, False, 7.9), (one, True, 4.9), (2 * one, False, 4.9), ([], True, 4.9)):
        assert list(reasons(FLAT, rows, GOOD, log2_area, folds)) == []
        (reason,) = reasons(FLAT, rows, GOOD, log2_area + 0.2, folds)
        assert reason.startswith("areas: on 5 % of the moving surface they change over")


def test_strong_distortion_is_measured_by_area_and_not_by_faces():
    z, faces = polar_disk(10, 30)
    surface = Surface(np.stack([z.real, z.imag, 1 - abs(z) ** 2], axis=1), faces)
    order, mu = np.argsort(surface.face_areas), np.zeros(len(faces), complex)
    small = order[np.cumsum(surface.face_areas[order]) < 0.009 * surface.area]
    assert len(small) > 0.01 * len(faces)
    mu[small] = 0.99j
    assert list(reasons(surface, [], SimpleNamespace(switched=0, mu=mu), 1.0, True)) == []
    mu[order[-10:]] = -0.91
    (reason,) = reasons(surface, [], SimpleNamespace(switched=0, mu=mu), 1.0, True)
    assert reason.startswith("distortion: ") and "|mu| is over 0.9 on" in reason


def test_held_out_curves_that_end_farther_off_are_told():
    near = {"a": (10.0, 4.0), "b": (2.7, 3.1)}
    for one in (near, {}, {"a": (0.1, 0.5), "b": (3.0, 3.1)}, {"a": (50.0, 54.0)}, near | {"c": (8.0, 13.1)}):
        assert list(worse(one, folds=True)) == []
    (reason,) = worse({"a": (2.0, 3.1), "b": (3.0, 3.1)}, folds=True)
    assert reason.startswith("worse: the held-out curves end 3.1 mm from their targets on average (2.5 after")
    assert "lower delta or gamma, or give" in reason
    (reason,) = worse({"a": (30.0, 4.0), "c": (8.0, 18.1)}, folds=False)
    assert reason.startswith("worse: 'c' ends 18.1 mm from its target (8.0 after")
    assert "check what was fitted, lower gamma, or give" in reason


# The measured table


@pytest.fixture(scope="module")
def measured():
    return read_measured("suspect")


def test_the_limits_are_those_that_were_measured_and_no_good_case_is_suspect(measured):
    assert measured["limits"] == LIMITS
    good = [case for case in measured["cases"] if case["kind"].startswith("good")]
    assert {case["kind"] for case in good} == {"good", "good, one or two", "good, folds alone"}
    assert len(good) >= 200 and all(case["mistakes"] == [] for case in good)
    registered = [case for case in good if "suspect" in case]
    assert len(registered) >= 200 and all(case["bijective"] for case in registered)
    told = [case for case in registered if case["suspect"]]
    # A map by one or two curves alone may lead away from the others: `worse:` is then true of a pair without a mistake.
    assert all(case["kind"] == "good, one or two" and not case["features"] for case in told)
    assert len(told) <= 0.35 * sum(case["kind"] == "good, one or two" and not case["features"] for case in good)
    assert [words(case["suspect"]) for case in told] == [["worse"]] * len(told)


KINDS = [
    ("mirror", ["mirrored", "mirrored, folds alone", "mirrored, one or two"]),
    ("exchanged", ["exchanged"]),
    ("numbering", ["whole numbers", "whole numbers, one or two"]),
    ("reversed", ["all reversed", "one reversed", "one reversed, one or two"]),
    ("swapped", ["two swapped"]),
]


@pytest.mark.parametrize("word, kinds", KINDS)
def test_in_the_table_each_mistake_is_recognised(measured, word, kinds):
    for kind in kinds:
        cases = [case for case in measured["cases"] if case["kind"] == kind]
        named = [word in words(case.get("mistakes", [])) or f"{word}: " in case.get("refused", "") for case in cases]
        assert len(cases) >= 20 and np.mean(named) >= 0.95


@pytest.mark.parametrize("kind", ["wrong partner, one", "wrong partners, two"])
def test_in_the_table_wrong_partners_are_told_by_landmarks_alone_and_with_folds(measured, kind):
    cases = [case for case in measured["cases"] if case["kind"] == kind]
    assert len(cases) >= 40 and {case["features"] for case in cases} == {False, True}
    assert np.mean([bool(case.get("suspect", True)) for case in cases]) >= 0.95


# Fewer than three curves, or none: the folds tell a left from a right, and ends that lie elsewhere.


@pytest.fixture(scope="module")
def folded_pair(sides):
    """The two sides with their folds."""
    return with_folds(sides)


def test_the_folds_tell_the_hand_with_a_curve_and_without(folded_pair):
    right, wrong = (align_disks(pair).directions for pair in (folded_pair, mirrored(folded_pair)))
    assert right.r > right.mirrored_r + 0.3 and wrong.mirrored_r > wrong.r + 0.3
    for curves in ([], SULCI[:1]):
        (reason,) = messages_of(mirrored(folded_pair), curves)
        assert reason.startswith("mirror: the folds fit") and "--mirror" in reason


def test_the_folds_tell_lps_from_the_other_hand(folded_pair):
    for pair, what in ((folded_pair, "x and y of"), (mirrored(folded_pair), "y of")):
        surface = Surface(pair.moving.surface.vertices * [-1, -1, 1], pair.moving.surface.faces)
        (reason,) = messages_of(replace(pair, moving=replace(pair.moving, surface=surface)), [])
        assert reason.startswith(
            f"mirror: the folds fit {what} the moving surface negated much better; one file seems to be in LPS"
        )
        assert ("--mirror" in reason) == (what == "y of")


FIRST = SULCI[0] | {"moving": fsaverage5("right").original_vertices[SULCI[0]["moving"]].tolist()}
TURNED = backwards(SULCI[0])
FEW = [
    *[(curves, "") for curves in ([], SULCI[:1], SULCI[7:9])],
    *[(curves, f"reversed: {TURNED['name']!r} fits") for curves in ([TURNED], [TURNED, SULCI[5]])],
    ([FIRST], "numbering: the moving vertices"),
]


@pytest.mark.parametrize("curves, told", FEW)
def test_few_curves_are_judged_by_the_folds(folded_pair, curves, told):
    found = messages_of(folded_pair, curves)
    assert len(found) == bool(told) and all(reason.startswith(told) for reason in found)


def test_each_wrong_partner_of_a_curve_is_told_and_no_right_one(folded_pair, monkeypatch):
    """Of all pairs of the eleven, by folds and, where these are not sure, with axes in space."""
    curves = [
        {"name": f"{i} to {j}", "moving": one["moving"], "control": other["control"]}
        for i, one in enumerate(SULCI)
        for j, other in enumerate(SULCI)
    ]
    (alone,) = messages_of(folded_pair, curves[9:10])
    assert alone.startswith("place: the sides of '0 to 9' lie 20 degrees apart") and "same sulcus" in alone
    pair = with_curves(align_by_folds(folded_pair), curves)
    told = {reason.split("'")[1] for reason in diagnose.out_of_place(pair)}
    assert told == {f"{i} to {j}" for i in range(11) for j in range(11) if i != j}
    monkeypatch.setattr(diagnose, "SURE_R", 1.0)
    fewer = {reason.split("'")[1] for reason in diagnose.out_of_place(pair)}
    assert fewer < told and len(fewer) >= 0.94 * len(told)
    monkeypatch.setitem(LIMITS, "axes_r", 0.9)
    assert list(diagnose.out_of_place(pair)) == []


def test_curves_in_place_are_those_of_no_other_surfaces(folded_pair, monkeypatch):
    monkeypatch.setattr(diagnose, "out_of_place", lambda pair: [])
    assert messages_of(folded_pair, [FIRST]) == []
    monkeypatch.setitem(LIMITS, "axes_r", 0.9)  # where places are not known
    assert words(messages_of(folded_pair, [FIRST])) == ["numbering"]


def test_what_the_folds_say_does_not_hang_on_where_the_landmarks_laid_the_disk(folded_pair):
    pair, disk = with_curves(folded_pair, SULCI[:1]), folded_pair.moving.disk
    aside = replace(pair, moving=replace(pair.moving, disk=disk.at(mobius(disk.z, 0.9 - 0.3j, 2.0))))
    here, there = (align_by_folds(one).moving.disk.z for one in (pair, aside))
    assert abs(here - there).max() < 1e-3


def test_surfaces_of_revolution_and_flat_ones_judge_no_curve():
    """With one spoke, which runs from the rim inwards on one side: what is right?"""
    path = np.arange(1, 1 + 24 * 6, 24)
    moving, control = (parameterize(meshes.bowl(height, curves={"east": path})) for height in (0.6, 0.9))
    curves = [{"name": "east", "moving": path[::-1], "control": path}]
    bowls = SurfacePair(moving, control, check_curves(curves, moving.surface, control.surface), [])
    laid = align_by_folds(with_folds(bowls))
    assert diagnose.rotation_contrast(laid) < LIMITS["rotation_contrast"]
    assert abs(laid.directions.mirrored_r - laid.directions.r) < LIMITS["hand"]
    flat = [
        replace(side, surface=Surface(side.surface.vertices * [1.0, 1.0, 0.0], side.surface.faces))
        for side in (moving, control)
    ]
    plain = replace(bowls, moving=flat[0], control=flat[1])
    assert diagnose_landmarks(align_disks(bowls)) == diagnose_landmarks(plain) == []
