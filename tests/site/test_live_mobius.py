"""The explorable of Möbius maps, on its page and in JupyterLab: the pole, and read-outs against the library's."""

import json

import numpy as np
import pytest
from explorables import LISTEN, Explorable, InJupyterLab, OnTheSite
from view import View

import qclearn as qc
from qclearn.pages.explorables import Mobius

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

    def test_a_page_that_is_opened_by_a_link_starts_there(self, window, site_address):
        view = View(window, site_address, f"{self.page}#live-mobius={json.dumps({'size': 0.7})}", script=LISTEN)
        assert Explorable(view, self.name).slider(self.slider).input_value() == "0.7"
        view.page.close()


class TestInJupyterLab(InJupyterLab):
    name, live, sets, gap = "mobius", "Mobius()", {"size": 0.7, "direction": 90.0}, 1e-12

    def test_the_pole_is_dragged(self, shown):
        shown.reset()
        shown.drag(shown.root.locator("canvas").first, (START.real, START.imag), (0.2, 0.2), (-0.5, 0.0))
        shown.tab.until("abs(mobius.a + 0.5) < 1e-3")
