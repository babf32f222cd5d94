"""How sure the map is between landmarks, on its page and in JupyterLab: a dragged landmark, and one
more."""

import numpy as np
from explorables import InJupyterLab, OnTheSite


class TestOnTheSite(OnTheSite):
    page, name, slider = "howsure.html", "howsure", "γ"

    def test_a_landmark_that_comes_makes_its_place_sure(self, shown):
        shown.reset()
        canvas, place = shown.root.locator("canvas").first, (0.35, -0.55)
        radii = np.array(shown.data()["answer"]["radii"])
        shown.drag_with_the_mouse(canvas, place, (0.69, 0.0))
        moved = shown.state()["places"][5]
        assert abs(complex(*moved) - 0.69) < 0.02
        now = np.array(shown.data()["answer"]["radii"])
        assert now[19] < 0.6 * radii[19]  # at 0.69, the first place of the third ring

    def test_one_landmark_more_lowers_the_mean(self, shown):
        shown.reset()
        before = shown.number("lies within")
        slider = shown.root.get_by_role("slider", name="landmarks", exact=True)  # gamma's name has the word, too
        shown.press(slider, "ArrowRight")
        assert shown.number("lies within") < before


class TestInJupyterLab(InJupyterLab):
    name, live, sets, gap = "howsure", "HowSure()", {"gamma": 10.0, "count": 9}, 1e-6
