"""Pins in the Linear Beltrami Solver, on their page and in JupyterLab: drags and misprints."""

import pytest
from explorables import InJupyterLab, OnTheSite

from qcbook import LBS


class TestOnTheSite(OnTheSite):
    page, name, slider = "lbs.html", "lbs", "pins are pulled aside"

    def test_pins_are_dragged_and_moved_by_keys(self, shown):
        shown.reset()
        canvas, words = shown.root.locator("canvas").first, shown.words
        shown.drag_with_the_mouse(canvas, (0.5, 0.2), (0.6, 0.3))
        ((place, moved),) = shown.state()["moves"].items()
        assert place == "0" and abs(complex(*moved) - 0.6 - 0.3j) < 0.02 and shown.words != words
        shown.press(canvas, "PageUp")
        shown.press(canvas, "Shift+ArrowUp")
        assert shown.state()["moves"]["3"] == pytest.approx([0.2, -0.4], abs=1e-3)
        data = shown.data()
        assert len(data["state"]["moves"]) == 2 and data["answer"]["folds"] > 0
        assert f" {data['answer']['folds']} of 3384 triangles folded" in shown.words

    def test_the_answer_to_the_guess_is_the_count_at_half_the_pull(self, shown):
        shown.reset()
        shown.press(shown.slider(self.slider), "End")
        half = LBS().answer(dict(LBS.initial) | {"pull": 0.2})["folds"]
        assert f"it is {half}." in shown.guess()

    def test_each_misprint_is_further_from_the_map_that_is_asked_for(self, shown):
        shown.reset()
        for name, value in (("strength", "0.6"), ("number of pins", "0")):
            shown.after(
                lambda name=name, value=value: shown.slider(name).evaluate(
                    "(e, value) => { e.value = value; e.dispatchEvent(new Event('change')); }", value
                )
            )
        right = shown.number("it is up to")
        for misprint in ("E2", "E3", "E4", "E5"):
            switch = shown.root.get_by_role("checkbox", name=misprint)
            shown.after(switch.check)
            assert shown.number("it is up to") > 20 * right
            shown.after(switch.uncheck)
        assert right < 1e-3


class TestInJupyterLab(InJupyterLab):
    name, live, sets = "lbs", "LBS()", {"strength": 0.6, "pull": 0.3}

    def test_a_pin_is_dragged(self, shown):
        shown.reset()
        shown.drag(shown.root.locator("canvas").first, (0.5, 0.2), (0.6, 0.2), (0.6, 0.3))
        shown.tab.until("abs(lbs.live.pins(lbs.state)[1][0] - 0.6 - 0.3j) < 1e-3")
