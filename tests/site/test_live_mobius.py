"""The explorable of Möbius maps, on its page and in JupyterLab: the pole, read-outs against the
library's, and what all explorables share."""

import json
import re

import numpy as np
import pytest
from explorables import LISTEN, Explorable, InJupyterLab, OnTheSite
from view import View, axe_findings

import qclearn as qc
from qcbook import Mobius

START = 0.4 * np.exp(1j * np.radians(30))


def pole(state):
    return Mobius.parameters(Mobius.initial | state)[0]


class TestOnTheSite(OnTheSite):
    page, name, slider = "conformal.html", "mobius", "distance of the pole"

    def test_the_pole_is_dragged_and_moved_by_keys(self, shown):
        canvas = shown.root.locator("canvas").first
        shown.reset()
        shown.drag_with_the_mouse(canvas, (START.real, START.imag), (-0.5, 0.0))
        moved = pole(shown.state())
        assert abs(moved + 0.5) < 0.02
        shown.press(canvas, "Shift+ArrowUp")
        assert abs(pole(shown.state()) - moved - 0.1j) < 1e-3

    def test_read_outs_are_the_librarys(self, shown):
        state = Mobius.initial | shown.state()
        a, theta = Mobius.parameters(state)
        radius = Mobius().answer(state)["radius"]
        assert shown.number("has become a circle of radius") == pytest.approx(radius, rel=2e-4)
        small = qc.mobius(1e-6, a, theta) - qc.mobius(0, a, theta)
        assert shown.number("Lengths change by") == pytest.approx(abs(small) / 1e-6, rel=2e-4)
        assert shown.data()["answer"]["radius"] == pytest.approx(radius, rel=1e-12)

    # What all explorables share.

    def test_the_mouse_moves_each_slider(self, shown):
        shown.moves_each_slider(shown.by_mouse)

    def test_undo_and_reset_go_back(self, shown):
        shown.reset()
        start, words = shown.state(), shown.words
        shown.press(shown.slider(self.slider), "End")
        assert shown.state() != start and shown.words != words
        shown.click("Undo")
        assert shown.state() == start == {} and shown.words == words

    def test_a_link_carries_the_state(self, shown):
        shown.press(shown.slider(self.slider), "End")
        state, words = shown.state(), shown.words
        shown.root.get_by_role("button", name="Link to this state").click()
        shown.wait_for("#live-")
        link = re.search(r"http\S+#live-\S+", shown.said)[0]
        shown.reset()
        shown.after(lambda: shown.page.evaluate("link => { location.href = link; }", link))
        assert (shown.state(), shown.words) == (state, words)

    def test_the_guess_is_compared_with_the_present_state(self, shown):
        shown.reset()
        first = shown.guess()
        shown.press(shown.slider(self.slider), "End")
        assert shown.guess() != first

    def test_downloads_hold_the_state(self, shown):
        data = shown.data()
        assert data["page"] == self.name and data["state"] and data["answer"]
        assert shown.download("Picture").path().read_bytes()[:4] == b"\x89PNG"

    def test_without_scripts_a_picture_and_a_message_stand_there(self, silent_window, site_address):
        page = silent_window.new_page()
        page.goto(site_address + self.page)
        root = page.locator(f".qc-live[data-page={self.name}]")
        assert root.locator("img[alt]").count() == 1 and "JavaScript" in root.locator("[role=status]").inner_text()
        page.close()

    def test_a_page_that_is_opened_by_a_link_starts_there(self, window, site_address):
        view = View(window, site_address, f"{self.page}#live-mobius={json.dumps({'size': 0.7})}", script=LISTEN)
        assert Explorable(view, self.name).slider(self.slider).input_value() == "0.7"
        view.page.close()


class TestInJupyterLab(InJupyterLab):
    name, live, sets, gap = "mobius", "Mobius()", {"size": 0.7, "direction": 90.0}, 1e-12

    def test_the_pole_is_dragged(self, shown):
        shown.reset()
        shown.drag(shown.root.locator("canvas").first, (START.real, START.imag), (0.2, 0.2), (-0.5, 0.0))
        shown.tab.until("abs(mobius.live.parameters(mobius.state)[0] + 0.5) < 1e-3")

    # What all explorables share.

    def test_each_control_moves_it_and_has_a_name(self, shown):
        shown.moves_each_slider(shown.by_key)
        shown.takes_each_choice()
        assert axe_findings(shown.page, shown.root) == []

    def test_what_is_moved_is_seen_by_python(self, shown):
        shown.reset()
        shown.press(shown.root.get_by_role("slider").first, "End")
        shown.tab.until(f"json.loads(json.dumps(mobius.state)) == {shown.data()['state']!r}")

    def test_undo_goes_back_and_the_guess_is_compared(self, shown):
        shown.reset()
        words = shown.words
        shown.press(shown.root.get_by_role("slider").first, "End")
        shown.click("Undo")
        assert shown.words == words
        shown.guess()
