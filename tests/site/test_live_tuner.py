"""The registration tuner on its page: controls, read-outs against the library's fit, quick moves, what is missing."""

import json

import numpy as np
import pytest
from explorables import (
    View,
    downloads_hold_the_state,
    every_choice_is_taken,
    every_slider_moves,
    needs,
    the_guess_is_answered,
    undo_and_reset_go_back,
    without_scripts,
)
from places import SITE
from reference import fit_in_steps, pairs
from view import axe_findings

from qclearn.pages.explorables import Tuner
from qclearn.pages.liveproblems import example
from qclearn.pages.widgets import network_fit
from qclearn.plane.beltrami import beltrami_coefficient
from qclearn.registration.metrics import measured_losses
from qclearn.registration.problem import Weights

PAGE, NAME = "live.html", "tuner"
ASSETS = "**/_static/live/"
pytestmark = pytest.mark.xdist_group(PAGE)


@pytest.fixture(scope="module")
def view(browser, site_address):
    needs(SITE, PAGE, NAME)
    view = View(browser, site_address, PAGE, NAME)
    view.root.locator("[role=status]:has-text('CP-Net: landmark error')").wait_for(timeout=60_000)
    yield view
    view.page.close()


@pytest.fixture(scope="module")
def live():
    return Tuner()


def reset(view):
    view.after(lambda: view.root.get_by_role("button", name="Reset").click())


def test_read_outs_are_the_librarys(view, live):
    reset(view)
    view.after(lambda: view.root.get_by_role("combobox", name="problem").select_option("anew"))
    view.press(view.slider("gamma"), "ArrowLeft")
    state = dict(live.initial) | view.state()
    problem, found = live.problem(state), downloads_hold_the_state(view, NAME)["answer"]
    asked = {name: state[name] for name in ("alpha", "beta", "gamma")} | {
        "moving": pairs(problem.moving),
        "target": pairs(problem.target),
        "curve": problem.curve.tolist(),
        "sliding": False,
    }
    engine, fitted = fit_in_steps(asked, *found["steps"])
    f = np.array(found["map"]).view(complex)
    assert abs(f - fitted.f).max() < 1e-5
    mu = beltrami_coefficient(problem.z, problem.faces, fitted.f)
    losses = measured_losses(engine.problem, engine.weights, mu, fitted.points)
    assert view.number("exact fit: landmark error") == pytest.approx(engine.error(fitted), rel=5e-3)
    assert view.number("mean .μ.") == pytest.approx(abs(mu).mean(), rel=1e-3)
    for term, value in losses.items():
        cells = view.root.locator("tr", has=view.page.get_by_role("rowheader", name=term, exact=True)).locator("td")
        assert float(cells.first.inner_text()) == pytest.approx(value, rel=1e-2)
    assert "certified bijective" in view.words and found["left"] < 1e-3


def test_controls_move_it(view):
    reset(view)
    view.after(lambda: view.root.get_by_role("combobox", name="problem").select_option("twist"))
    every_slider_moves(view)
    every_choice_is_taken(view)
    undo_and_reset_go_back(view, view.slider("beta"))


def test_landmarks_and_targets_are_dragged_and_moved_by_keys(view, live):
    reset(view)
    view.after(lambda: view.root.get_by_role("combobox", name="problem").select_option("twist"))
    problem, words = example("twist").problem, view.words
    for canvas, name, points in zip(
        view.root.locator("canvas").all(), ("starts", "targets"), (problem.moving, problem.target)
    ):
        view.drag(canvas, (points[4].real, points[4].imag), (points[4].real + 0.1, points[4].imag))
        ((place, moved),) = view.state()[name].items()
        assert place == "4" and abs(complex(*moved) - points[4] - 0.1) < 0.02
        view.press(canvas, "PageDown")
        view.press(canvas, "ArrowUp")
        assert abs(complex(*view.state()[name]["5"]) - points[5] - 0.01j) < 1e-6
    assert view.words != words


MANY = """e => { for (let k = 0; k < 50; k++) {
    e.value = 2 + k / 20;
    e.dispatchEvent(new Event(k < 49 ? 'input' : 'change'));
} }"""


def test_fifty_quick_moves_end_in_the_state_of_the_last(view):
    reset(view)
    slider = view.slider("gamma")
    view.after(lambda: slider.evaluate(MANY))
    many, last = view.words, slider.input_value()
    reset(view)
    assert view.words != many
    move = "(e, value) => { e.value = value; e.dispatchEvent(new Event('change')); }"
    view.after(lambda: slider.evaluate(move, last))
    assert view.words == many


def test_points_that_meet_are_refused_in_the_librarys_words(browser, site_address):
    state = {"problem": "neighbours", "targets": {"0": [0.25, 0.08], "1": [0.25, 0.08]}}
    page = browser.new_page()
    page.goto(f"{site_address}{PAGE}#live-tuner={json.dumps(state)}")
    words = page.locator(f".qc-live[data-page={NAME}] [role=status]:has-text('coincide')")
    words.wait_for(timeout=60_000)
    assert "target landmarks 0 and 1 coincide at 0.25+0.08j" in words.inner_text()
    page.close()


def test_the_guess_is_compared(browser, site_address):
    view = View(browser, site_address, PAGE, NAME)
    the_guess_is_answered(view)
    view.page.close()


def test_without_scripts_a_picture_and_a_message_stand_there(browser, site_address):
    assert "JavaScript" in without_scripts(browser, site_address, PAGE, NAME)


def message_with(browser, site_address, prepare):
    page = browser.new_page()
    prepare(page)
    page.goto(site_address + PAGE)
    root = page.locator(f".qc-live[data-page={NAME}]")
    page.wait_for_function(
        f"() => {{ const root = document.querySelector('.qc-live[data-page={NAME}]');"
        "return root.dataset.ready || root.textContent.includes('cannot'); }",
        timeout=60_000,
    )
    words, pictures = root.locator("[role=status]").inner_text(), root.locator("img, canvas").count()
    page.close()
    return words, pictures


def test_without_webassembly_it_computes_in_javascript(browser, site_address):
    words, pictures = message_with(
        browser, site_address, lambda page: page.route(ASSETS + "*.wasm", lambda route: route.abort())
    )
    assert "in JavaScript" in words and pictures


def test_without_its_weights_the_network_is_missing_and_the_fit_stays(browser, site_address):
    page = browser.new_page()
    page.route(ASSETS + "cpnet.bin", lambda route: route.fulfill(status=404))
    page.goto(site_address + PAGE)
    words = page.locator(f".qc-live[data-page={NAME}] [role=status]:has-text('cpnet.bin could not be loaded')")
    words.wait_for(timeout=60_000)
    assert "exact fit: landmark error" in words.inner_text()
    page.close()


def test_cpnets_map_is_the_librarys(view, live):
    reset(view)
    view.after(lambda: view.root.get_by_role("combobox", name="problem").select_option("twist"))
    view.after(lambda: view.root.get_by_role("combobox", name="map shown").select_option("network"))
    data = downloads_hold_the_state(view, NAME)
    problem = live.problem(data["state"])
    found = network_fit(problem, Weights(*(data["state"][name] for name in ("alpha", "beta", "gamma"))))
    # Weights in half precision here, in single precision there.
    assert abs(np.array(data["answer"]["map"]).view(complex) - found.f).max() < 1e-3
    assert data["answer"]["landmarkError"] == pytest.approx(found.landmark_error, rel=0.02)


@pytest.mark.parametrize("name", ["problems.json", "worker.js", "explore_tuner.js"])
def test_a_file_that_is_missing_is_named_and_the_picture_stays(browser, site_address, name):
    words, pictures = message_with(
        browser, site_address, lambda page: page.route(ASSETS + name, lambda route: route.abort())
    )
    assert "cannot compute here" in words and pictures == 1


# It hears what all of the above brought; axe-core comes after it, since it loads style sheets once more in its own way.
def test_nothing_complains_and_nothing_comes_from_elsewhere(view):
    assert view.complaints == [] and view.from_elsewhere() == []


def test_it_is_accessible(browser, site_address):
    view = View(browser, site_address, PAGE, NAME, width=390)
    assert axe_findings(view.page) == []
    assert view.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    view.page.close()
