"""The pipeline with features: curves that take no part are met, landmarks may be absent, and doubts are told."""

import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from test_register import bowl, entries

from qclearn.plane.bijectivity import BijectivityError
from qclearn.plane.grids import polar_disk
from qclearn.registration.curves import check_curves, detect_curves, held_apart
from qclearn.registration.features import Feature
from qclearn.registration.fit import fit_registration
from qclearn.registration.problem import DELTA, Weights
from qclearn.registration.register import register

MOVING, CONTROL = bowl(0.6), bowl(1.2)  # vertices of the same number belong together
HERE = polar_disk(14, 42)[0]
FOLDS = [np.cos(8 * HERE.real + 2 * HERE.imag) + HERE.real, np.sin(7 * HERE.imag + 4 * HERE.real**2) - 0.5 * HERE.imag]
FEATURES = [Feature(name, values, values) for name, values in zip(("sulc", "myelin"), FOLDS)]


def off(result):
    """Mean distance of the registered points from where they belong."""
    return np.linalg.norm(result.points - CONTROL.vertices, axis=1).mean()


def test_features_carry_the_curves_that_were_held_out_and_the_report_tells_it():
    """One curve fitted, two held out: by landmarks alone and with features, at the same gamma."""
    options = {"gamma": np.int64(100), "delta": np.float32(1), "hold_out": ["spoke 1", "spoke 2"]}
    pairs = [register(MOVING, CONTROL, entries(0), features=features, **options) for features in (None, FEATURES)]
    alone, hybrid = (np.array(list(result.report["held_out_mm"].values())) for result in pairs)
    np.testing.assert_allclose(alone[:, 0], hybrid[:, 0])  # of the same Möbius map
    assert alone.shape == (2, 2) and (hybrid[:, 1] < 0.5 * hybrid[:, 0]).all() and (hybrid < alone + 1e-9).all()
    assert off(pairs[1]) < 0.5 * off(pairs[0])
    alone, hybrid = (result.report for result in pairs)
    assert (alone["delta"], alone["features"], alone["r"]) == (0.0, {}, {})
    assert (hybrid["delta"], hybrid["features"]) == (1.0, {"sulc": 0.5, "myelin": 0.5})
    assert all(before < after <= 1 and after > 0.99 for before, after in hybrid["r"].values())
    assert list(hybrid["held_out_mm"]) == options["hold_out"]
    assert [row["name"] for row in hybrid["curves"]] == list(pairs[1].curves) == ["spoke 0"]
    assert all(0 < hybrid[key][0] < hybrid[key][1] for key in ("log2_area", "log2_shape"))
    assert hybrid["suspect"] == [] and hybrid["bijective"] and json.dumps(hybrid)


def test_curves_are_held_out_by_name_or_in_the_file():
    """And a text is one name."""
    held = ["spoke 1", "spoke 2"]
    marked = check_curves(
        [entry | {"hold_out": np.bool_(entry["name"] in held)} for entry in entries(0)], MOVING, CONTROL
    )
    plain = check_curves(entries(0), MOVING, CONTROL)
    for curves, names in ((marked, ()), (plain, held), (plain, "spoke 1")):
        fitted, apart = held_apart(curves, names)
        assert [curve.name for curve in apart] == (held if names != "spoke 1" else [names])
        assert [curve for curve in curves if curve not in apart] == fitted


def test_without_landmarks_features_alone_register():
    result = register(MOVING, CONTROL, [], features=FEATURES, delta=3.0)
    report = result.report
    assert report["landmark_error"] is report["landmark_error_mm"] is report["landmark_error_before"] is None
    assert report["curves"] == [] and result.curves == {} and report["bijective"] and report["suspect"] == []
    assert off(result) < 0.03 and min(after for _, after in report["r"].values()) > 0.99


@pytest.mark.parametrize("walls", [[], ["walls: differ"]])
@pytest.mark.parametrize("there, words", [
    (-FOLDS[0], "features: .sulc. .*is of opposite sign .*its sulc is not"),
    (FOLDS[1], "features: 'sulc' of the two sides hardly agrees .*curve or two.*negate"),
    (FOLDS[0], None),
])  # fmt: skip
def test_features_that_do_not_agree_make_it_suspect(monkeypatch, there, words, walls):
    """And walls that differ come first then, as the likely cause in place of a sign."""
    monkeypatch.setattr("qclearn.registration.report.differing_walls", lambda *_: walls)
    report = register(MOVING, CONTROL, entries(0), gamma=1e2, features=[Feature("sulc", FOLDS[0], there)]).report
    told = "features: .*; probably because of the different walls; .* first$" if walls else words
    assert not words or any(re.match(told, reason) for reason in report["suspect"]), report["suspect"]
    assert report["fallbacks"][: len(walls)] == walls and report["suspect"][: len(walls)] == walls * bool(words)


def test_delta_is_lowered_before_gamma(monkeypatch):
    tried = []

    def folding(problem, weights, *more):
        tried.append((weights.delta, weights.gamma))
        if weights.gamma >= 1e4:
            return SimpleNamespace(bijective=False, flipped=np.array([7]))
        return fit_registration(problem, weights, *more)

    monkeypatch.setattr("qclearn.registration.fit.fit_registration", folding)
    report = register(MOVING, CONTROL, entries(0), features=FEATURES[:1], gamma=1e5, delta=0.4).report
    assert tried == [(0.4, 1e5), (0.1, 1e5), (0.1, 1e4), (0.1, 1e3)]
    assert report["fallbacks"] == ["delta lowered to 0.1", "gamma lowered to 1000"]
    monkeypatch.setattr("qclearn.registration.fit.fit_registration", lambda *_: folding(None, Weights(gamma=1e5)))
    with pytest.raises(BijectivityError, match="for these features down to delta = 0.00390625 .*the features of both"):
        register(MOVING, CONTROL, [], features=FEATURES, delta=1.0)


def test_the_networks_answer_is_where_the_features_begin(monkeypatch):
    seen, loaded, counts, mu = [], [], [], np.full(len(MOVING.faces), 0.1 + 0.05j)
    blocks = SimpleNamespace(detect=detect_curves, predict=lambda *_, **__: mu)
    pipeline = sys.modules["qclearn.registration.register"]
    monkeypatch.setattr("qclearn.nets.load", lambda name: loaded.append(name) or blocks)
    made = pipeline.Stages.__init__
    monkeypatch.setattr(pipeline.Stages, "__init__", lambda self, *given: counts.append(given[0]) or made(self, *given))

    def fit(problem, weights, features, start):
        seen.append(start)
        return fit_registration(problem, weights, features, start)

    monkeypatch.setattr("qclearn.registration.fit.fit_registration", fit)
    result = register(MOVING, CONTROL, entries(0), "network", gamma=1e2, features=FEATURES, delta=1.0, eta=1.0)
    assert seen[0] is mu and off(result) < 0.03 and loaded == ["ldnet", "cpnet"]
    assert counts == [len(result.report["seconds"]) - 1] and "tolerance" not in result.report


def test_folds_lead_unless_they_are_told_not_to():
    report = register(MOVING, CONTROL, entries(0), gamma=1e2).report
    assert list(report["features"]) == list(report["r"]) == ["depth", "curvature", "potential"]
    assert report["delta"] == DELTA
