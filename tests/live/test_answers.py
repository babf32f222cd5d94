"""What explorables answer, run by node, against Python's side of each: maps with pins, and descents."""

import json

import numpy as np
import pytest
from reference import run_engine

from qclearn.pages.explorables import LBS, Boundary, Growth


def answers(live, module, call, changes):
    """(state, the browser's answer) for each change of the state that an explorable starts with."""
    states = [json.loads(json.dumps(dict(live.initial))) | change for change in changes]
    return zip(states, run_engine("answers", page=live.page, module=module, call=call, states=states))


def test_maps_with_pins_and_misprints_are_scipys():
    live = LBS()
    changes = (
        {},
        {"strength": 0.6, "count": 0},
        *({"strength": 0.6, "count": 3, misprint: True} for misprint in ("e2", "e3", "e4", "e5")),
        {"asked": "stretch", "strength": 1.5, "count": 5, "e4": True, "e5": True, "moves": {"1": [0.1, 0.1]}},
    )
    folds = []
    for state, found in answers(live, "lbs.js", "answerLbs", changes):
        expected = live.answer(state)
        assert abs(np.array(found["map"]).view(complex) - live.map(state)).max() < 1e-9
        assert found["folds"] == expected["folds"]
        folds.append(found["folds"])
    assert folds[0] > 0 == folds[1]  # pins fold a harmonic map; no pins, no folds


@pytest.mark.parametrize("loss, step, tolerance", [("printed", 5, 1e-8), ("penalised", 5, 1e-8), ("right", 100, 1e-5)])
def test_descents_are_numpys(loss, step, tolerance):
    live = Boundary()
    changes = [{"loss": loss, "step": 0}, {"loss": loss, "step": step, "strength": 0.3, "pole": [-0.2, 0.4]}]
    for state, found in answers(live, "boundary.js", "answerBoundary", changes):
        f, _ = live.map(state)
        assert abs(np.array(found["map"]).view(complex) - f).max() < tolerance
        assert found["folds"] == 0


def test_a_frame_beyond_the_last_is_the_last():
    """The slider has a length of its own; the browser shows the last frame there."""
    corners, faces = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 2, 1], [0, 1, 3]])
    live = Growth(np.array([corners, 2 * corners, 3 * corners]), faces, np.array([1, 2, 3]), [0, 0, 0])
    assert [live.answer({"frame": frame})["area"] for frame in (0, 1, 2, 19)] == pytest.approx([1, 4, 9, 9])
