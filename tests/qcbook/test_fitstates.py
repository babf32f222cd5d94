"""The answers that pages show for one choice of the weights: solvers, words, and a figure."""

import dataclasses

import numpy as np
import pytest

from meshes import bowl
from qcbook.cells import in_powers
from qcbook.examples import Example, cortex_problem, example_problems, spread_vertices
from qcbook.fitstates import describe, exact_fit, fit_state, sentences, states_figure
from qclearn.plane.disk import Disk
from qclearn.plane.grids import square_disk
from qclearn.registration.features import FINEST, Feature, featured
from qclearn.registration.problem import Problem, Weights
from qclearn.surfaces.conformal import ParameterizedSurface
from qclearn.surfaces.surface import Surface


@pytest.fixture(scope="module")
def example():
    """Two short curves on a small mesh, turned by a twist that leaves the circle where it is."""
    moving = np.concatenate([0.4 + 0.1j * np.arange(-1, 2), -0.3 + 0.15 * np.arange(3)])
    target = moving * np.exp(0.6j * (1 - abs(moving) ** 2))
    return Example("twist", Problem(Disk(*square_disk(16)), moving, target, np.repeat([0, 1], 3)))


@pytest.fixture(scope="module")
def state(example):
    return fit_state(example, (1.0, 1e-2, 1e4))


@pytest.fixture(scope="module")
def folded(example):
    """The same with waves on both sides, which the twist takes to each other."""
    disk, z = example.problem.disk, example.problem.disk.z
    flat = ParameterizedSurface(Surface(np.stack([z.real, z.imag, 0 * z.real], axis=1), disk.faces), disk)
    twisted = z * np.exp(0.6j * (1 - abs(z) ** 2))
    waves = Feature("waves", *(np.cos(7 * w.real) + np.sin(6 * w.imag) for w in (twisted, z)))
    return dataclasses.replace(example, name="folded", features=featured(flat, flat, [waves])[2])


def test_delta_brings_folds_together(folded):
    alone, folds = (fit_state(folded, (1.0, 1e-2, 1e2, delta)) for delta in (1e-6, 1.0))
    before, after = (2 * (1 - folded.features.correlation(one.fit.f, FINEST)[0]) for one in (alone, folds))
    assert after < 0.5 * before
    value, weight, product = folds.terms["L_features"]
    assert value == pytest.approx(after, rel=0.2) and weight == 1.0 and product == value
    assert "L_features" not in fit_state(folded, (1.0, 1e-2, 1e2)).terms


def test_terms_are_value_weight_and_product(state):
    for (value, weight, product), expected in zip(state.terms.values(), (1.0, 1e-2, 1e4), strict=True):
        assert weight == expected
        assert product == pytest.approx(value * weight)
    assert sum(row[2] for row in state.terms.values()) == pytest.approx(state.loss)


def test_terms_are_measured_on_the_map_and_not_on_what_the_fit_believes():
    """A fit that reports wonders gets the terms of its map; those of a good fit are near what it believes itself."""
    twist = example_problems()[0]
    state = fit_state(twist, (1.0, 1e-2, 1e4))
    boasting = dataclasses.replace(state.fit, losses=dict.fromkeys(state.fit.losses, 0.0), landmark_error=0.0)
    assert fit_state(twist, (1.0, 1e-2, 1e4), solver=lambda *_: boasting).terms == state.terms
    assert state.terms["L_mu"][0] == pytest.approx(state.fit.losses["L_mu"], rel=0.05)
    assert state.terms["L_Landmark"][0] == pytest.approx(state.fit.losses["L_Landmark"], rel=1e-6)
    assert 0.5 < state.terms["L_grad_mu"][0] / state.fit.losses["L_grad_mu"] < 1  # averages are smoother


def test_flipped_triangles_are_reported_and_drawn(example, state):
    folded = state.fit.f.copy()
    inner = np.flatnonzero(abs(example.problem.disk.z) < 0.1)[0]
    folded[inner] += 0.5
    flipped = example.problem.disk.certify(folded).flipped
    assert len(flipped) > 0
    bad = dataclasses.replace(state.fit, f=folded, bijective=False, flipped=flipped)
    answer = fit_state(example, (1.0, 1e-2, 1e4), solver=lambda *_: bad)
    assert f"not bijective: {len(flipped)} of {len(example.problem.disk.faces)} triangles" in answer.message
    ax = states_figure(example, {"exact fit": answer}).axes[0]
    assert sum(patch.get_hatch() is not None for patch in ax.patches) == len(flipped)


def test_the_figure_draws_the_map(example, state):
    landmarks, colours, bars = states_figure(example, {"exact fit": state}).axes[:3]
    (points,) = [line for line in landmarks.lines if line.get_marker() == "o"]
    there = points.get_xydata() @ [1, 1j]
    np.testing.assert_allclose(there, example.problem.target, atol=10 * state.fit.landmark_error)
    np.testing.assert_array_equal(colours.collections[0].get_array(), abs(state.fit.mu))
    assert sum(patch.get_height() for patch in bars.patches) == len(example.problem.disk.faces)
    grid = np.concatenate(landmarks.collections[0].get_segments()) @ [1, 1j]
    assert abs(grid).max() <= 1 + 1e-12


@pytest.mark.parametrize(
    "weights, word",
    [((0.0, 1e-2, 1e4), "alpha"), ((1.0, 1e-2, np.nan), "gamma"), ((1.0, 1e-2, 1e2, 0.3), "'twist' has no folds")],
)
def test_what_cannot_be_fitted_becomes_a_message(example, state, weights, word):
    bad = fit_state(example, weights)
    assert bad.fit is None and word in describe(bad)
    good, empty = states_figure(example, {"exact fit": state, "bad": bad}).axes[:2]
    assert len(good.lines) > len(empty.lines)


def test_states_are_told_in_words(state):
    assert "certified bijective" in describe(state)
    assert in_powers(f"{state.fit.landmark_error:.1e}") in describe(state)
    worse = dataclasses.replace(state, terms={name: (v, w, 3 * p) for name, (v, w, p) in state.terms.items()})
    assert "L_CP of CP-Net is 3 times that of exact fit" in sentences({"exact fit": state, "CP-Net": worse})
    assert "times" not in sentences({"exact fit": state})
    text = sentences({"<b>": dataclasses.replace(state, fit=None, message="a < b")})
    assert "a &lt; b" in text and "<b>&lt;b&gt;</b>" in text


@pytest.mark.parametrize("example", example_problems(), ids=lambda example: example.name)
def test_examples_are_certified(example):
    for sliding in (False, True):
        assert exact_fit(dataclasses.replace(example.problem, sliding=sliding), Weights(1.0, 1e-2, 1e4)).bijective


def test_vertices_are_spread_evenly():
    surface = bowl(0.5, 9)
    chosen = spread_vertices(surface, 80)
    assert len(np.unique(chosen)) == 80 and set(surface.boundary[::2]) <= set(chosen)
    distance = np.linalg.norm(surface.vertices[:, None] - surface.vertices[chosen], axis=2)
    added = distance[chosen[len(surface.boundary[::2]) :]]
    # No vertex is farther off than two chosen ones are apart.
    assert distance.min(axis=1).max() <= added[added > 0].min() + 1e-12


@pytest.mark.digits
def test_cortex_problem_keeps_landmarks_of_the_full_surfaces():
    moving, control = bowl(0.5, 12), bowl(0.8, 12)
    paths = {"spoke": (np.arange(1, 289, 36), 2), "arc": (np.arange(151, 160), 3)}
    curves = [{"name": name, "moving": path, "control": path + turn} for name, (path, turn) in paths.items()]
    small = cortex_problem("bowls", moving, control, curves, vertices=150, points=4)
    assert len(small.problem.disk.z) == 150 and small.problem.curve.tolist() == [0] * 4 + [1] * 4
    on_arc = small.problem.target[4:]  # the control is a surface of revolution: the arc stays one, equally divided
    np.testing.assert_allclose(abs(on_arc), abs(on_arc[0]), rtol=0.01)
    np.testing.assert_allclose(np.angle(on_arc[1:] / on_arc[:-1]), np.radians(80 / 3), rtol=0.02)
    fit = exact_fit(small.problem, Weights(1.0, 1e-2, 1e4))
    assert fit.bijective and fit.landmark_error < 0.1 * abs(small.problem.moving - small.problem.target).mean()
    polar = cortex_problem("bowls", moving, control, curves, points=4)
    np.testing.assert_array_equal(polar.problem.target, small.problem.target)
    assert polar.problem.disk is example_problems()[0].problem.disk
    assert [len(side.areas) for side in polar.features.smoothings] == [len(polar.problem.disk.z), len(control.vertices)]
