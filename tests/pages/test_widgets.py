"""The live page's callback, its figure, its worker thread and its shell, without a browser."""

import base64
import dataclasses
import re
import threading

import numpy as np
import pytest
from meshes import bowl
from qclearn.plane.diskmesh import square_disk

from qclearn.pages.canvas import Canvas
from qclearn.pages.examples import Example, cortex_problem, example_problems, spread_vertices
from qclearn.pages.widgets import (
    SOLVERS,
    NewestOnly,
    Superseded,
    Tuner,
    describe,
    exact_fit,
    fit_state,
    gaps,
    network_fit,
    states_table,
)
from qclearn.plane.bijectivity import check_bijective
from qclearn.registration.features import FINEST, Feature, Features
from qclearn.registration.fit import fit_landmarks
from qclearn.registration.problem import LandmarkError, Problem, Weights
from qclearn.surfaces.surface import Surface

EXACT = {"exact fit": exact_fit}
PNG = b"\x89PNG\r\n\x1a\n"


def png_of(tuner):
    """The bytes of the picture that a Tuner shows."""
    return base64.b64decode(re.search('src="data:image/png;base64,([^"]*)"', tuner.picture.value)[1])


def answered(tuner, control, value):
    """The Tuner's text once a control has been moved."""
    control.value = value
    tuner.worker.wait()
    return tuner.text.value


@pytest.fixture(scope="module")
def example():
    """Two short curves on a small mesh, turned by a twist that leaves the circle where it is."""
    z, faces = square_disk(16)
    moving = np.concatenate([0.4 + 0.1j * np.arange(-1, 2), -0.3 + 0.15 * np.arange(3)])
    target = moving * np.exp(0.6j * (1 - abs(moving) ** 2))
    return Example("twist", Problem(z, faces, moving, target, np.repeat([0, 1], 3)))


@pytest.fixture(scope="module")
def state(example):
    return fit_state(example, (1.0, 1e-2, 1e4))


@pytest.fixture(scope="module")
def folded(example):
    """The same with waves on both sides, which the twist takes to each other."""
    z, faces = example.problem.z, example.problem.faces
    flat = Surface(np.stack([z.real, z.imag, 0 * z.real], axis=1), faces)
    twisted = z * np.exp(0.6j * (1 - abs(z) ** 2))
    waves = Feature("waves", *(np.cos(7 * w.real) + np.sin(6 * w.imag) for w in (twisted, z)))
    return dataclasses.replace(example, name="folded", features=Features(flat, flat, z, [waves]))


def test_gamma_buys_landmarks_with_distortion(example):
    loose, tight = fit_state(example, (1.0, 1e-2, 1e1)), fit_state(example, (1.0, 1e-2, 1e4))
    assert tight.fit.landmark_error < 0.1 * loose.fit.landmark_error
    assert tight.terms["L_mu"][0] > loose.terms["L_mu"][0]


def test_delta_brings_folds_together(folded):
    alone, folds = (fit_state(folded, (1.0, 1e-2, 1e2, delta)) for delta in (1e-6, 1.0))
    before, after = (2 * (1 - folded.features.correlation(one.fit.f, FINEST)[0]) for one in (alone, folds))
    assert after < 0.5 * before
    value, weight, product = folds.terms["L_features"]
    assert value == pytest.approx(after, rel=0.2) and weight == 1.0 and product == value
    assert folds.loss == pytest.approx(sum(row[2] for row in folds.terms.values()))
    assert "L_features" not in fit_state(folded, (1.0, 1e-2, 1e2)).terms


def test_folds_where_there_are_none_become_a_message(example):
    answer = fit_state(example, (1.0, 1e-2, 1e2, 0.3))
    assert answer.fit is None and "'twist' has no folds" in answer.message


def test_delta_reaches_the_solver_where_there_are_folds(example, folded):
    tuner = Tuner([folded, example], EXACT)
    tuner.gamma.value = 1e2
    text = answered(tuner, tuner.delta, 0.3)
    expected = fit_state(folded, (1.0, 1e-2, 1e2, 0.3))
    assert f"{expected.fit.landmark_error:.2e}" in text and "L<sub>Features</sub>" in text
    assert not tuner.delta.disabled
    text = answered(tuner, tuner.problem, "twist")
    assert tuner.delta.disabled and tuner.setting()[1] == (1.0, 1e-2, 1e2, 0.0) and "Features" not in text


def test_alpha_and_beta_press_on_their_own_terms(example):
    reference = fit_state(example, (1.0, 1e-2, 1e2))
    assert fit_state(example, (100.0, 1e-2, 1e2)).terms["L_mu"][0] < 0.6 * reference.terms["L_mu"][0]
    assert fit_state(example, (1.0, 1.0, 1e2)).terms["L_grad_mu"][0] < 0.6 * reference.terms["L_grad_mu"][0]


def test_terms_are_value_weight_and_product(state):
    for (value, weight, product), expected in zip(state.terms.values(), (1.0, 1e-2, 1e4), strict=True):
        assert weight == expected
        assert product == pytest.approx(value * weight)
    assert sum(row[2] for row in state.terms.values()) == pytest.approx(state.loss)


def test_terms_are_measured_on_the_map_and_not_on_what_the_fit_believes():
    """A fit that reports wonders gets the terms of its map,
    and those of a good fit are near what it believes itself."""
    twist = example_problems()[0]
    state = fit_state(twist, (1.0, 1e-2, 1e4))
    boasting = dataclasses.replace(state.fit, losses=dict.fromkeys(state.fit.losses, 0.0), landmark_error=0.0)
    assert fit_state(twist, (1.0, 1e-2, 1e4), solver=lambda *_: boasting).terms == state.terms
    assert state.terms["L_mu"][0] == pytest.approx(state.fit.losses["L_mu"], rel=0.05)
    assert state.terms["L_Landmark"][0] == pytest.approx(state.fit.losses["L_Landmark"], rel=1e-6)
    assert 0.5 < state.terms["L_grad_mu"][0] / state.fit.losses["L_grad_mu"] < 1  # averages are smoother


def test_state_tells_certificate_and_error_in_words(state):
    assert "certified bijective" in describe(state)
    assert f"{state.fit.landmark_error:.2e}" in describe(state)


def test_flipped_triangles_are_reported_and_drawn(example, state):
    folded = state.fit.f.copy()
    inner = np.flatnonzero(abs(example.problem.z) < 0.1)[0]
    folded[inner] += 0.5
    flipped = check_bijective(example.problem.z, example.problem.faces, folded).flipped
    assert len(flipped) > 0
    bad = dataclasses.replace(state.fit, f=folded, bijective=False, flipped=flipped)
    answer = fit_state(example, (1.0, 1e-2, 1e4), solver=lambda *_: bad)
    assert f"not bijective: {len(flipped)} of {len(example.problem.faces)} triangles" in answer.message
    canvas = Canvas(example, ["exact fit"])
    canvas.draw({"exact fit": answer})
    assert len(canvas.rows["exact fit"][1].get_paths()) == len(flipped)


@pytest.mark.parametrize("weights, word", [((0.0, 1e-2, 1e4), "alpha"), ((1.0, 1e-2, np.nan), "gamma")])
def test_weights_out_of_range_become_a_message(example, weights, word):
    answer = fit_state(example, weights)
    assert answer.fit is None and word in answer.message


def test_bad_landmarks_become_a_message(example):
    twice = example.problem.moving.copy()
    twice[1] = twice[0]

    def on_bad_landmarks(problem, *rest):
        return exact_fit(dataclasses.replace(problem, moving=twice), *rest)

    answer = fit_state(example, (1.0, 1e-2, 1e4), solver=on_bad_landmarks)
    assert "coincide" in describe(answer)
    assert "coincide" in states_table({"exact fit": answer})


def test_table_escapes_messages(state):
    text = states_table({"<b>": dataclasses.replace(state, fit=None, message="a < b")})
    assert "a &lt; b" in text and "<b>&lt;b&gt;</b>" in text


def test_canvas_draws_the_map(example, state):
    canvas = Canvas(example, ["exact fit"])
    assert canvas.draw({"exact fit": state}).startswith(PNG)
    points, _, grid, colours, bars = canvas.rows["exact fit"]
    np.testing.assert_allclose(
        points.get_xydata() @ [1, 1j], example.problem.target, atol=10 * state.fit.landmark_error
    )
    np.testing.assert_array_equal(colours.get_array(), abs(state.fit.mu))
    assert bars.get_data().values.sum() == len(example.problem.faces)
    assert abs(np.concatenate(grid.get_segments()) @ [1, 1j]).max() <= 1 + 1e-12


def test_canvas_shows_no_stale_map_beside_an_error(example, state):
    canvas = Canvas(example, ["exact fit"])
    good = canvas.draw({"exact fit": state})
    bad = canvas.draw({"exact fit": fit_state(example, (-1.0, 1e-2, 1e4))})
    assert not any(artist.get_visible() for artist in canvas.rows["exact fit"])
    assert bad != good
    assert canvas.draw({"exact fit": state}) == good


def test_newest_request_wins_and_older_work_stops():
    started, release, finished, shown = threading.Event(), threading.Event(), [], []

    def work(number, watch):
        started.set()
        release.wait(10)
        watch()
        finished.append(number)
        return number

    worker = NewestOnly(work, shown.append, pause=0)
    worker.submit(0)
    assert started.wait(10)
    for number in range(1, 6):
        worker.submit(number)
    release.set()
    worker.wait()
    assert finished == shown == [5]
    worker.submit(6)
    worker.wait()
    assert shown == [5, 6]


def test_watch_stops_a_fit(example):
    def watch():
        raise Superseded

    with pytest.raises(Superseded):
        fit_state(example, (1.0, 1e-2, 1e4), watch=watch)


def test_moving_a_slider_changes_picture_and_text(example):
    tuner = Tuner([example], EXACT)
    image, text = png_of(tuner), tuner.text.value
    assert image.startswith(PNG) and "certified" in text
    assert answered(tuner, tuner.gamma, 10.0) != text
    assert png_of(tuner).startswith(PNG) and png_of(tuner) != image
    expected = fit_state(example, (1.0, 1e-2, 10.0))
    assert f"{expected.fit.landmark_error:.2e}" in re.search('alt="([^"]*)"', tuner.picture.value)[1]


def test_every_control_reaches_the_solver(example):
    other = dataclasses.replace(example, name="other")
    tuner = Tuner([example, other], EXACT)
    for control, value in (
        (tuner.alpha, 2.0),
        (tuner.beta, 0.1),
        (tuner.gamma, 1e3),
        (tuner.landmarks, "sliding"),
        (tuner.problem, "other"),
    ):
        text = answered(tuner, control, value)
    assert tuner.setting() == ("other", (2.0, 0.1, 1e3, 0.0), True)
    expected = fit_state(other, (2.0, 0.1, 1e3), sliding=True)
    assert f"{expected.fit.landmark_error:.2e}" in text
    assert tuner.canvas.example is other


def test_an_unexpected_error_is_shown_and_the_next_move_works(example):
    def fails_above(problem, weights, features, watch):
        if weights.gamma > 1e2:
            raise RuntimeError("no <answer> here")
        return exact_fit(problem, weights, features, watch)

    tuner = Tuner([example], {"fragile": fails_above})
    assert "no &lt;answer&gt; here" in tuner.text.value
    assert "certified" in answered(tuner, tuner.gamma, 1e1) and png_of(tuner).startswith(PNG)
    assert "RuntimeError" in answered(tuner, tuner.gamma, 1e6)
    assert not tuner.picture.value  # no stale picture beside an error


def test_answers_of_several_solvers_stand_below_each_other(example):
    tuner = Tuner(
        [example],
        {"exact fit": exact_fit, "half gamma": lambda p, w, *rest: exact_fit(p, w.at(w.gamma / 2), *rest)},
    )
    assert set(tuner.canvas.rows) == {"exact fit", "half gamma"}
    assert "<b>exact fit</b>" in tuner.text.value and "<b>half gamma</b>" in tuner.text.value
    first, second = (row[0].get_xydata() for row in tuner.canvas.rows.values())
    assert abs(first - second).max() > 0


class StandIn:
    """In CP-Net's place: the fit's own coefficient, some shares of it."""

    share, calls, most = 1.0, (), np.inf

    def gamma_used(self, weights):
        return min(weights.gamma, self.most)

    def predict(self, z, faces, moving, target, *, alpha, beta, gamma, curve):
        self.calls = (*self.calls, (alpha, beta, gamma))
        return self.share * fit_landmarks(z, faces, moving, target, alpha, beta, gamma, curve).mu


@pytest.fixture
def network(monkeypatch):
    stand_in = StandIn()
    monkeypatch.setattr("qclearn.pages.widgets.load", lambda name: {"cpnet": stand_in}[name])
    return stand_in


def test_the_network_stands_below_the_fit_with_the_gap_between_them(example, network):
    tuner = Tuner([example])
    assert list(tuner.canvas.rows) == ["exact fit", "CP-Net"]
    usual = Weights.alpha, Weights.beta, Weights.gamma
    assert network.calls == (usual,)
    ratio = float(re.search(r"L_CP of CP-Net is (\S+) times that of exact fit", tuner.text.value)[1])
    alternative = re.search('alt="([^"]*)"', tuner.picture.value)[1]
    assert f"is {ratio:.3g} times" in alternative and "CP-Net: landmark error" in alternative
    states = {name: fit_state(example, usual, solver=solver) for name, solver in SOLVERS.items()}
    assert ratio == pytest.approx(states["CP-Net"].loss / states["exact fit"].loss, rel=1e-2)
    network.share = 0.5
    assert float(re.search(r"is (\S+) times", answered(tuner, tuner.gamma, 1e4))[1]) > 2
    assert network.calls[-1] == (1.0, 1e-2, 1e4)


def test_the_network_fit_is_the_exact_map_of_its_coefficient(example, network):
    fit = exact_fit(example.problem, Weights(1.0, 1e-2, 1e4))
    answer = network_fit(example.problem, Weights(1.0, 1e-2, 1e4))
    assert answer.bijective and abs(answer.f - fit.f).max() < 5e-3
    network.most = 1e3
    assert "answered for gamma = 1e+03" in describe(
        fit_state(example, (1.0, 1e-2, np.float64(1e4)), solver=network_fit)
    )
    network.share = 0.0
    assert abs(network_fit(example.problem, Weights(1.0, 1e-2, 1e4)).mu).max() < 0.05  # a Möbius map between vertices
    np.testing.assert_array_equal(gaps({"a": fit_state(example, (1.0, 1e-2, 1e4))}), [])


def test_the_shipped_network_comes_near_the_fit_on_a_smooth_problem():
    twist = example_problems()[0]
    passed, fitted = (fit_state(twist, (1.0, 1e-2, 1e3), solver=solver) for solver in (network_fit, exact_fit))
    assert passed.fit.bijective and passed.loss < 2 * fitted.loss
    assert "answered for gamma" not in passed.message


def test_where_the_network_cannot_answer_the_fit_still_does(example, network, monkeypatch):
    def refuse(*_, **__):
        raise LandmarkError("200 landmarks, and CP-Net takes 128")

    def missing(name):
        raise ImportError("the networks need torch")

    monkeypatch.setattr(network, "predict", refuse)
    tuner = Tuner([example])
    assert "<b>CP-Net</b>: No map: 200 landmarks" in tuner.text.value and "times" not in tuner.text.value
    assert "certified" in tuner.text.value and png_of(tuner).startswith(PNG)
    assert "it knows no sliding" in answered(tuner, tuner.landmarks, "sliding")
    monkeypatch.setattr("qclearn.pages.widgets.load", missing)
    tuner.landmarks.value = "points"
    assert "No map: the networks need torch" in answered(tuner, tuner.gamma, 1e3)


@pytest.mark.parametrize("weights", [(0.0, 1e-2, 1e4), (1.0, -1.0, 1e4), (1.0, 1e-2, np.inf)])
def test_the_network_is_not_asked_for_weights_out_of_range(example, network, weights):
    answer = fit_state(example, weights, solver=network_fit)
    assert answer.fit is None and "must be positive" in answer.message and network.calls == ()


@pytest.mark.parametrize("example", example_problems(), ids=lambda example: example.name)
def test_examples_are_certified(example):
    for sliding in (False, True):
        assert exact_fit(dataclasses.replace(example.problem, sliding=sliding), Weights(1.0, 1e-2, 1e4)).bijective


def test_vertices_are_spread_evenly():
    surface = bowl(0.5, 9)
    chosen = spread_vertices(surface, 80)
    assert len(np.unique(chosen)) == 80 and set(surface.boundary[::2]) <= set(chosen)
    distance = np.linalg.norm(surface.vertices[:, None] - surface.vertices[chosen], axis=2)
    added = distance[chosen[len(surface.boundary[::2]) :]] + np.where(
        distance[chosen[len(surface.boundary[::2]) :]] == 0, 9, 0
    )
    assert distance.min(axis=1).max() <= added.min() + 1e-12  # no vertex is farther off than two chosen ones are apart


def test_cortex_problem_keeps_landmarks_of_the_full_surfaces():
    moving, control = bowl(0.5, 12), bowl(0.8, 12)
    spoke = [1 + 36 * ring for ring in range(8)]
    arc = list(range(151, 160))
    curves = [
        {"name": "spoke", "moving": spoke, "control": [vertex + 2 for vertex in spoke]},
        {"name": "arc", "moving": arc, "control": [vertex + 3 for vertex in arc]},
    ]
    small = cortex_problem("bowls", moving, control, curves, vertices=150, points=4)
    assert len(small.problem.z) == 150 and small.problem.curve.tolist() == [0] * 4 + [1] * 4
    on_arc = small.problem.target[4:]  # the control is a surface of revolution: the arc stays one, equally divided
    np.testing.assert_allclose(abs(on_arc), abs(on_arc[0]), rtol=0.01)
    np.testing.assert_allclose(np.angle(on_arc[1:] / on_arc[:-1]), np.radians(80 / 3), rtol=0.02)
    fit = exact_fit(small.problem, Weights(1.0, 1e-2, 1e4))
    assert fit.bijective and fit.landmark_error < 0.1 * abs(small.problem.moving - small.problem.target).mean()
    polar = cortex_problem("bowls", moving, control, curves, points=4)
    np.testing.assert_array_equal(polar.problem.target, small.problem.target)
    np.testing.assert_array_equal(polar.problem.z, example_problems()[0].problem.z)
    assert [len(side.areas) for side in polar.features.sides] == [len(polar.problem.z), len(control.vertices)]
