"""What `register` refuses, each once: one line that says what, where and what to do."""

import numpy as np
import pytest
from test_register import bowl, entries, spoke

import qclearn as qc
from qclearn.registration.curves import check_curves, read_landmarks
from qclearn.registration.features import Feature, FeatureError
from qclearn.registration.problem import LandmarkError, Weights
from qclearn.surfaces.surface import Surface, SurfaceError, mirror

BOWL, HIGH = bowl(0.6), bowl(0.9)


def refused(error, message, *given, **options):
    with pytest.raises(error, match=message) as stop:
        qc.register(*given, **options)
    assert "\n" not in str(stop.value)


SULC = np.linspace(0, 1, len(BOWL.vertices))
FEATURES = [Feature("sulc", SULC, SULC)]
SURE = {"uncertainty": True}
ALONE = {"features": None}
OPTIONS = [
    (ValueError, "unknown method 'magic'", {"method": "magic"}),
    (ValueError, r"register\(annotations=\) went with version 0.3: .*f1_score", {"annotations": (["a"], ["a"])}),
    (ValueError, "tolerance belongs to method 'network'", {"tolerance": 1e-3}),
    (ValueError, "tolerance belongs to .*by landmarks alone", {"method": "network", "tolerance": 1e-3}),
    (ValueError, "sliding belongs to method 'exact'", ALONE | {"method": "network", "sliding": True}),
    (ValueError, "tolerance = 0.0: give a positive", ALONE | {"method": "network", "tolerance": 0.0}),
    (ValueError, "tolerance = nan", ALONE | {"method": "network", "tolerance": np.nan}),
    (LandmarkError, "delta = 0: the features would take no part", {"delta": 0}),
    (LandmarkError, "eta = 2 and the networks alone: .*eta=0", ALONE | {"method": "network", "eta": 2.0}),
    (LandmarkError, "network", SURE | {"method": "network"}),
    (LandmarkError, "sliding", SURE | {"sliding": True}),
    (LandmarkError, "other features", SURE | {"features": ["depth"]}),
    (LandmarkError, "delta = 40 is far", SURE | {"delta": 40.0}),
    (LandmarkError, "eta = 50 is far", SURE | {"eta": 50.0}),
    (LandmarkError, "gamma = 100000 is far", SURE | ALONE | {"gamma": 1e5}),
    *[
        (LandmarkError, rf"{name} = .*: over {most} rounding decides; give at most 1e\+07 times the larger", weights)
        for name, most, weights in (
            ("gamma", r"1e\+07", {"gamma": 1e8}),
            ("delta", r"1e\+07", {"delta": 2e7}),
            ("eta", r"1e\+07", {"eta": 2e7}),
            ("gamma", "10", {"alpha": 1e-6, "beta": 1e-7}),
            ("gamma", r"1e\+09", {"alpha": 1e8, "gamma": 1e11}),
        )
    ],
]


@pytest.mark.parametrize("error, message, options", OPTIONS)
def test_options_that_do_not_go_together_are_refused_before_any_work(error, message, options):
    refused(error, message, None, None, None, **options)


NO_WEIGHTS = {
    "alpha": [0, np.nan, None], "beta": [-1, np.inf, 1j], "gamma": [0, -1e5, np.nan, "5"],
    "delta": [-0.1, np.nan, np.inf, "0.3"], "eta": [-0.1, np.nan, np.inf, "much"],
}  # fmt: skip


def test_large_weights_beside_large_others_are_taken():
    assert Weights(gamma=1e7).gamma == 1e7 and Weights(1e-2, 1e-4, 1e5).gamma == Weights(1e5, 1e3, 1e5).gamma


@pytest.mark.parametrize("name, value", [(name, value) for name, values in NO_WEIGHTS.items() for value in values])
def test_weights_that_cannot_be_are_refused_before_any_work(name, value):
    message = f"{name} = {value!r}: alpha and gamma must be positive, the others not negative, and all finite"
    for more in ({}, ALONE):
        refused(LandmarkError, message, None, None, None, **{name: value}, **more)


CURVE = {"name": "a", "moving": [0, 5], "control": [1, 2, 3]}
MET = {side: [entries(0)[0], entries(0)[1] | {side: spoke(0)[::-1]}] for side in ("moving", "control")}
# Both ends of a curve side by side on one rim, and far apart on the other: well beyond the limit, as
# no processor may decide otherwise.
RIM = spoke(0, first=13, last=14)[0]
EDGE = {"name": "edge", "moving": [RIM, RIM + 1], "control": [RIM, RIM + 21], "detect": False}
ENDS = [{"moving": [RIM + k, RIM + k + 20], "control": [RIM + k, RIM + k + 1]} for k in (0, 1)]
EDGES = [EDGE | {"name": f"{k}", **ends} for k, ends in enumerate(ENDS)]
CURVES = [
    *[("hold no curves", none) for none in ([], None, {"curves": []}, {"curves": "a"})],
    ("json.load", "curves.json"),
    ("one key 'curves'; found", {}),
    (r"one key 'curves'; found \['curve'\]", {"curve": [CURVE]}),
    (r"found \['curves', 'version'\]", {"curves": [CURVE], "version": 1}),
    ("curve 0 has int", [7]),
    (r"curve 1 has \['moving', 'name'\]; it needs name, moving, control", [CURVE, {"name": "b", "moving": [0, 5]}]),
    ("curve 0 has .*'colour'.*may have detect", [CURVE | {"colour": "red"}]),
    ("curve 0: name must be text", [CURVE | {"name": 3}]),
    *[("detect, hold_out true or false", [CURVE | {key: "no"}]) for key in ("detect", "hold_out")],
    (r"names used twice: \['a'\]; rename", [CURVE, CURVE]),
    *[("curve 'a', moving side: .*at least two vertex indices", [CURVE | {"moving": few}]) for few in ([0], [])],
    ("curve 'a', moving side: .*float64", [CURVE | {"moving": [0.5, 2]}]),
    ("curve 'a', moving side: .*bool", [CURVE | {"moving": [True, False]}]),
    *[("curve 'a', moving side", [CURVE | {"moving": path}]) for path in ("central", 7, [2**70, 3])],
    ("curve 'a', moving side: .*unequal lengths", [CURVE | {"moving": [[1], [2, 3]]}]),
    (r"curve 'a', moving side: .*\(2, 2\)", [CURVE | {"moving": [[0, 1], [1, 2]]}]),
    ("curve 'a', moving side: .*repeats vertex 5 at position 1; drop", [CURVE | {"moving": [4, 5, 5, 6]}]),
    (r"curve 'a', control side: .*out of range 0..588: \[999999\]", [CURVE | {"control": [0, 999_999]}]),
    (r"curve 'a', control side: .*out of range", [CURVE | {"control": [0, -1]}]),
    *[(f"'spoke 0' and 'spoke 1' share a point on the {side} side only.*let them", MET[side]) for side in MET],
    *[
        ("curve 'edge' pulls the moving disk onto its rim: .* check this curve's ends", [edge])
        for edge in (EDGE, EDGE | {"moving": EDGE["control"], "control": EDGE["moving"]})
    ],
    ("curve '0' pulls the moving disk onto its rim", EDGES),
]


@pytest.mark.parametrize("message, curves", CURVES)
def test_landmarks_that_cannot_be_used_are_refused(message, curves):
    refused(LandmarkError, message, BOWL, HIGH, curves, features=None)


THREE = ["spoke 0", "spoke 1", "spoke 2"]


@pytest.mark.parametrize("error, message, options", [
    (FeatureError, "feature 1, control side: shape", {"features": [(SULC, SULC[1:])]}),
    (LandmarkError, "no curve is called 'spoke 7'.*'spoke 0', 'spoke 1', 'spoke 2'", {"hold_out": ["spoke 7"]}),
    (LandmarkError, "all curves are held out", ALONE | {"hold_out": THREE}),
    (LandmarkError, "hold_out is .*: give a list of names of curves", {"hold_out": None}),
    (LandmarkError, "hold_out is .*: give a list of names of curves", {"hold_out": [1, "a"]}),
    (LandmarkError, "hold_out is .*: give a list of names of curves", {"hold_out": [["a"]]}),
    (LandmarkError, "method 'network' needs landmarks", {"method": "network", "hold_out": THREE}),
])  # fmt: skip
def test_features_and_curves_held_out_that_cannot_be_are_refused(error, message, options):
    refused(error, message, BOWL, HIGH, entries(0), **({"features": FEATURES} | options))


def test_surfaces_that_are_no_disk_or_look_inward_are_refused_with_the_remedy():
    inward = Surface(BOWL.vertices, BOWL.faces[:, ::-1])
    loop = BOWL.boundary
    lid = np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(BOWL.vertices))], axis=1)
    closed = Surface(np.vstack([BOWL.vertices, [0, 0, -1]]), np.vstack([BOWL.faces, lid]))
    for bad, message in ((inward, "inward.*Reverse all faces"), (closed, "closed.*open")):
        for pair in ((bad, BOWL), (BOWL, bad)):
            refused(SurfaceError, message, *pair, entries(0))


@pytest.mark.parametrize("side, wanted, message", [
    ("moving", {"vertices": 588}, r"another moving surface \(588 vertices; this .* 589 vertices, sha256 \w{12}\)"),
    ("control", {"sha256": "0" * 64}, r"another control surface \(sha256 000000000000; .*: numbers of one mesh"),
    ("control", BOWL.fingerprint, "another control surface .*: exchanged: they fit the moving surface; exchange"),
    ("moving", {"vertices": 589, "md5": "0"}, 'surfaces, moving: give "vertices" and "sha256", and nothing else'),
    ("moving", 589, "surfaces, moving: give"),
    ("both", {}, "'surfaces' must be"),
])  # fmt: skip
def test_landmarks_made_for_other_surfaces_are_refused(side, wanted, message):
    """Those made for these, or for their mirrors, are taken."""
    stated = {"moving": BOWL.fingerprint, "control": HIGH.fingerprint}
    curves = {"curves": entries(0), "surfaces": stated}
    assert len(check_curves(curves, BOWL, HIGH)) == len(check_curves(curves, mirror(BOWL), HIGH)) == 3
    assert mirror(BOWL).fingerprint != BOWL.fingerprint
    refused(LandmarkError, message, BOWL, HIGH, curves | {"surfaces": stated | {side: wanted}})


EXCHANGED = " exchanged: or of the control surface, which has so many? then exchange MOVING and CONTROL"
WHOLE = " numbering: all are vertices of the whole surface; give those of the cut one"
TABLE = np.arange(10, 599)


@pytest.mark.parametrize("path, table, rings, hint", [
    ([3, 590], None, 15, EXCHANGED), ([3, 590], None, 3, ""), ([10, 597], TABLE, 15, WHOLE), ([3, 590], TABLE, 3, ""),
    ([-1, 590], None, 15, ""),
])  # fmt: skip
def test_numbers_out_of_range_are_met_with_what_they_may_be(path, table, rings, hint):
    moving = Surface(BOWL.vertices, BOWL.faces, original_vertices=table)
    with pytest.raises(LandmarkError) as refusal:
        check_curves([{"name": "a", "moving": path, "control": [0, 1]}], moving, bowl(0.6, rings=rings))
    assert str(refusal.value).endswith("(before it was cut open, say)?" + hint)


@pytest.mark.parametrize("text", ['{"curves": [{"name": "a", "moving": [' + "7" * 5000 + "]}]}", "[" * 200_000])
def test_a_landmarks_file_that_python_cannot_parse_is_named(tmp_path, text):
    """A number of thousands of digits, lists nested without end."""
    file = tmp_path / "curves.json"
    file.write_text(text)
    with pytest.raises(LandmarkError, match="curves.json: not a JSON file"):
        read_landmarks(file)
    with pytest.raises(LandmarkError, match="none.json: cannot be read .*check the name"):
        read_landmarks(tmp_path / "none.json")
