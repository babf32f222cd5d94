"""Painting mu, on its page and in JupyterLab: the brush, and DBS-Net beside the map."""

import pytest
from explorables import InJupyterLab, OnTheSite

BRUSH = ("radius of the brush",)


class TestOnTheSite(OnTheSite):
    page, name, slider, silent = "quasiconformal.html", "mu", "size of mu", BRUSH

    def test_the_brush_paints_with_the_mouse_and_with_keys(self, shown):
        shown.reset()
        shown.choose("pattern of mu", "blank")
        canvas = shown.root.locator("canvas").first
        shown.drag_with_the_mouse(canvas, (-0.4, 0.3), (-0.2, 0.3))
        state = shown.state()
        assert len(state["strokes"]) >= 2 and state["strokes"][0][1] == pytest.approx(0.3, abs=0.02)
        assert shown.number("largest .μ.") == pytest.approx(0.5, rel=1e-3)
        shown.press(canvas, "Shift+ArrowRight")
        moved = shown.state()
        assert moved["brush"][0] == pytest.approx(state["brush"][0] + 0.1)
        assert len(moved["strokes"]) == len(state["strokes"])
        shown.press(canvas, "Enter")
        assert len(shown.state()["strokes"]) == len(state["strokes"]) + 1

    def test_too_long_a_pull_has_no_fold(self, shown):
        shown.reset()
        shown.press(shown.slider("size of mu"), "End")
        assert shown.number("largest .μ.") == pytest.approx(0.95, abs=2e-3) and " 0 folds" in shown.words

    def test_dbsnet_stands_beside_the_exact_map(self, shown):
        shown.reset()
        switch = shown.root.get_by_role("checkbox", name="DBS-Net")
        shown.after(switch.check)
        assert 0 < shown.number("there by up to") < 0.05 and "with 0 folds" in shown.words
        shown.press(switch, "Space")
        assert "DBS-Net" not in shown.words


class TestInJupyterLab(InJupyterLab):
    name, live, silent, sets = "mu", "Mu()", BRUSH, {"preset": "radial", "size": 0.3}

    def test_the_brush_paints_what_python_reads(self, shown):
        shown.reset()
        shown.choose("pattern of mu", "blank")
        shown.drag(shown.root.locator("canvas").first, (-0.4, 0.3), (-0.3, 0.3), (-0.2, 0.3))
        shown.tab.until("len(mu.state['strokes']) == 4 and abs(abs(mu.live.coefficient(mu.state)).max() - 0.5) < 1e-3")
