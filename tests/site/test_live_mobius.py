"""The explorable of Möbius maps on its page: every control, read-outs against the library's, links and downloads."""

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
from qclearn.pages.explorables import Mobius

PAGE, NAME = "conformal.html", "mobius"
pytestmark = pytest.mark.xdist_group(PAGE)


@pytest.fixture(scope="module")
def view(browser, site_address):
    needs(SITE, PAGE, NAME)
    view = View(browser, site_address, PAGE, NAME)
    yield view
    view.page.close()


def test_controls_move_it(view):
    every_slider_moves(view)
    every_choice_is_taken(view)
    undo_and_reset_go_back(view, view.slider("distance of the pole"))


def test_the_pole_is_dragged_and_moved_by_keys(view):
    canvas = view.root.locator("canvas").first
    view.after(lambda: view.root.get_by_role("button", name="Reset").click())
    start = 0.4 * np.exp(1j * np.radians(30))
    view.drag(canvas, (start.real, start.imag), (-0.5, 0.0))
    moved = Mobius.parameters(Mobius.initial | view.state())[0]
    assert abs(moved + 0.5) < 0.02
    view.press(canvas, "Shift+ArrowUp")
    assert abs(Mobius.parameters(Mobius.initial | view.state())[0] - moved - 0.1j) < 1e-3


def test_read_outs_are_the_librarys(view):
    state = Mobius.initial | view.state()
    a, theta = Mobius.parameters(state)
    assert view.number("has become a circle of radius") == pytest.approx(Mobius().answer(state)["radius"], rel=2e-4)
    small = qc.mobius(1e-6, a, theta) - qc.mobius(0, a, theta)
    assert view.number("Lengths change by") == pytest.approx(abs(small) / 1e-6, rel=2e-4)
    found = downloads_hold_the_state(view, NAME)["answer"]
    assert found["radius"] == pytest.approx(Mobius().answer(state)["radius"], rel=1e-12)


def test_a_link_carries_the_state(view, browser, site_address):
    address, words = view.page.url, view.words
    other = View(browser, site_address, address[len(site_address) :], NAME)
    assert other.words == words
    other.page.close()


def test_the_guess_is_compared(view):
    the_guess_is_answered(view)


def test_without_scripts_a_picture_and_a_message_stand_there(browser, site_address):
    assert "JavaScript" in without_scripts(browser, site_address, PAGE, NAME)


# It hears what all of the above brought; axe-core comes after it, since it loads style sheets once more in its own way.
def test_nothing_complains_and_nothing_comes_from_elsewhere(view):
    assert view.complaints == [] and view.from_elsewhere() == []


def test_it_is_accessible(view):
    assert axe_findings(view.page) == []
