"""What explorables answer, run by node, against the library: maps with pins, misprints, where descents end."""

import json

import numpy as np
import pytest
from reference import run_engine
from scipy.optimize import minimize

from qcbook import LBS, Boundary, Growth, HowSure


def answers(live, changes):
    """(state, the browser's answer) for each change of the state that an explorable starts with."""
    states = [json.loads(json.dumps(dict(live.initial))) | change for change in changes]
    found = run_engine("answers", page=live.page, states=states)
    return [(state, one | {"map": np.array(one["map"]).view(complex)}) for state, one in zip(states, found)]


def test_maps_with_pins_are_the_librarys():
    live, folds = LBS(), []
    changes = ({}, {"strength": 0.6, "count": 0}, {"asked": "stretch", "strength": 1.5, "moves": {"1": [0.1, 0.1]}})
    for state, found in answers(live, changes):
        assert abs(found["map"] - live.map(state)).max() < 1e-9
        assert found["folds"] == live.answer(state)["folds"]
        folds.append(found["folds"])
    assert folds[0] > 0 == folds[1]  # pins fold a harmonic map; no pins, no folds


def test_maps_of_misprints_obey_the_misprinted_rows():
    """Each row of what the paper prints is zero at the free vertices, and those held are where they should be."""
    live, asked = LBS(), {"strength": 0.6, "count": 3}
    changes = [*(asked | {misprint: True} for misprint in ("e2", "e3", "e4", "e5")), asked | {"e4": True, "e5": True}]
    z, faces, hats, area = (live.mesh.z, live.mesh.faces, live.mesh.gradients, live.mesh.areas[:, None])
    for state, found in answers(live, changes):
        f, mu = found["map"][faces], live.coefficient(state)[:, None]
        flux = ((1 + abs(mu) ** 2) * hats - 2 * mu * hats.conj()) / (1 - abs(mu) ** 2)
        blocks = area[:, None] * (hats.conj()[:, :, None] * flux[:, None, :]).real
        blocks = blocks * (area[:, None] ** 4 if state["e2"] else 1) / (area[:, None] if state["e3"] else 1)
        if state["e5"]:
            blocks = blocks[:, np.arange(3)[:, None], [[0, 2, 1], [2, 1, 0], [1, 0, 2]]]
        rows, sizes = np.zeros(len(z), complex), np.zeros(len(z))
        np.add.at(rows, faces, (blocks * f[:, None, :]).sum(2))
        np.add.at(sizes, faces, abs(blocks).sum(2))
        (vertices, targets), fixed = (live.pins(state), np.array([0, live.rim[0]]) if state["e4"] else live.rim)
        free = np.setdiff1d(np.arange(len(z)), np.append(vertices, fixed))
        assert (abs(rows[free]) / sizes[free]).max() < 1e-9
        assert abs(found["map"][fixed] - z[fixed]).max() < 1e-12
        assert abs(found["map"][vertices] - targets).max() < 1e-12


@pytest.mark.parametrize("loss", ["printed", "penalised", "right"])
def test_descents_begin_at_the_librarys_map_and_go_down(loss):
    live = Boundary()
    there = {"loss": loss, "strength": 0.3, "pole": [-0.2, 0.4]}
    start, later, end = answers(live, [there | {"step": step, "centred": step == 100} for step in (0, 5, 100)])
    assert abs(start[1]["map"] - live.map(start[0]))[live.rim].max() < 1e-8
    K = live.mesh.stiffness(live.coefficient(start[0]))
    for _, found in (start, later):
        f = found["map"]
        rows, rim = K @ f, f[live.rim]
        printed = (abs(rows.real) + abs(rows.imag)).sum() / (2 * len(f))
        energy = 0.5 * (f.conj() @ rows).real - 0.5 * (rim.conj() * np.roll(rim, -1)).imag.sum()
        assert found["losses"] == pytest.approx([printed, energy], rel=1e-8, abs=1e-10)
        assert found["folds"] == 0
    kind = int(loss == "right")
    assert start[1]["losses"][kind] > later[1]["losses"][kind] > end[1]["losses"][kind]
    if loss == "right":  # near the library's map, which other meshes would have nearer
        assert abs(end[1]["map"] - live.map(end[0])).max() < 5e-3
        assert end[1]["losses"][1] == pytest.approx(least_gap(K.toarray(), live.rim), abs=1e-5)


def least_gap(K, rim):
    """Energy minus area of the best boundary points, by SciPy's minimiser over their angles."""
    inside = np.setdiff1d(np.arange(len(K)), rim)
    S = K[np.ix_(rim, rim)] - K[np.ix_(rim, inside)] @ np.linalg.solve(
        K[np.ix_(inside, inside)], K[np.ix_(inside, rim)]
    )

    def gap(turns):
        f = np.exp(1j * turns)
        row, after, before = S @ f, np.roll(f, -1), np.roll(f, 1)
        slope = row + 0.5j * (after - before)
        return 0.5 * (f.conj() @ row).real - 0.5 * (f.conj() @ after).imag, (slope * f.conj()).imag

    return minimize(gap, 2 * np.pi * np.arange(len(rim)) / len(rim), jac=True).fun


def test_a_frame_beyond_the_last_is_the_last():
    """The slider has a length of its own; the browser shows the last frame there."""
    corners, faces = (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 2, 1], [0, 1, 3]]))
    live = Growth(np.array([corners, 2 * corners, 3 * corners]), faces, np.array([1, 2, 3]), [0, 0, 0])
    assert [live.answer({"frame": frame})["area"] for frame in (0, 1, 2, 19)] == pytest.approx([1, 4, 9, 9])


def test_the_ellipses_between_landmarks_are_the_librarys():
    """The browser works in the dual, with the prior's covariance between points; the library with a
    dense Hessian. What the page says of one landmark more is what the library finds with it."""
    live = HowSure()
    state = json.loads(json.dumps(dict(live.initial))) | {"count": 5, "gamma": 30.0, "beta": 0.1}
    (found,) = run_engine("answers", page=live.page, states=[state])
    best = int(np.argmin(found["left"]))
    there = [live.seen[best].real, live.seen[best].imag]
    more = state | {"places": [*state["places"][:5], there], "count": 6, "gamma": 36.0}  # each counts as much as before
    roots = []
    for asked, covariances in (state, found["covariances"]), (more, None):
        wanted = live.posterior(asked).ellipses(live.seen)
        sizes = np.trace(wanted, axis1=1, axis2=2)
        roots.append(np.sqrt(sizes).mean())
        if covariances:
            off = abs(np.array(covariances) - wanted[:, [0, 0, 1], [0, 1, 1]]) / sizes[:, None]
            assert off.max() < 1e-6
    assert found["left"][best] == pytest.approx(roots[1] / roots[0], rel=1e-6)
