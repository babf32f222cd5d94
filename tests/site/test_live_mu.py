"""Painting mu on its page: every control, the brush, the map and its compression against the library's."""

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
from view import axe_findings

import qclearn as qc
from qclearn.pages.explorables import Mu
from qclearn.plane.fourier import compression_effect

PAGE, NAME = "quasiconformal.html", "mu"
pytestmark = pytest.mark.xdist_group(PAGE)


@pytest.fixture(scope="module")
def view(browser, site_address):
    needs(SITE, PAGE, NAME)
    view = View(browser, site_address, PAGE, NAME)
    yield view
    view.page.close()


def reset(view):
    view.after(lambda: view.root.get_by_role("button", name="Reset").click())


def test_controls_move_it(view):
    every_slider_moves(view, silent=("radius of the brush",))
    every_choice_is_taken(view)
    undo_and_reset_go_back(view, view.slider("size of mu"))


def test_the_map_and_its_compression_are_the_librarys(view):
    reset(view)
    view.press(view.slider("highest frequency"), "ArrowLeft")
    data = downloads_hold_the_state(view, NAME)
    mu = Mu().coefficient(data["state"])
    f = qc.solve_beltrami_disk(*Mu.mesh, mu)
    assert abs(np.array(data["answer"]["map"]).view(complex) - f).max() < 1e-9
    (row,) = compression_effect(*Mu.mesh, mu, [data["state"]["frequencies"]], size=64)
    # Pixels on the edge of two faces may show either.
    assert data["answer"]["off"] == pytest.approx(row["map_error"], rel=0.03)
    assert view.number("the map moves by up to") == pytest.approx(data["answer"]["off"], rel=1e-3)
    assert view.number("largest .μ.") == pytest.approx(abs(mu).max(), rel=1e-3)


def test_the_brush_paints_with_the_mouse_and_with_keys(view):
    reset(view)
    view.after(lambda: view.root.get_by_role("combobox").select_option("blank"))
    canvas, state = view.root.locator("canvas").first, lambda: dict(Mu.initial) | view.state()
    view.drag(canvas, (-0.4, 0.3), (-0.2, 0.3))
    strokes = state()["strokes"]
    assert len(strokes) >= 2 and strokes[0][1] == pytest.approx(0.3, abs=0.02)
    assert view.number("largest .μ.") == pytest.approx(0.5, rel=1e-3)
    before = state()["brush"]
    view.press(canvas, "Shift+ArrowRight")
    assert state()["brush"][0] == pytest.approx(before[0] + 0.1) and len(state()["strokes"]) == len(strokes)
    view.press(canvas, "Enter")
    assert len(state()["strokes"]) == len(strokes) + 1


def test_too_long_a_pull_has_no_fold(view):
    reset(view)
    view.press(view.slider("size of mu"), "End")
    assert view.number("largest .μ.") == pytest.approx(0.95, abs=2e-3) and " 0 folds" in view.words


def test_dbsnet_stands_beside_the_exact_map(view):
    reset(view)
    switch = view.root.get_by_role("checkbox", name="DBS-Net")
    view.after(switch.check)
    assert 0 < view.number("there by up to") < 0.05 and "with 0 folds" in view.words
    view.press(switch, "Space")
    assert "DBS-Net" not in view.words


def test_the_guess_is_compared(view):
    the_guess_is_answered(view)


def test_without_scripts_a_picture_and_a_message_stand_there(browser, site_address):
    assert "JavaScript" in without_scripts(browser, site_address, PAGE, NAME)


# It hears what all of the above brought; axe-core comes after it, since it loads style sheets once more in its own way.
def test_nothing_complains_and_nothing_comes_from_elsewhere(view):
    assert view.complaints == [] and view.from_elsewhere() == []


def test_it_is_accessible(view):
    assert axe_findings(view.page) == []
