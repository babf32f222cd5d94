"""Registered sulci in 3-D, on the page and in JupyterLab: turned, lifted as the library lifts,
handed to the tuner."""

import json
from urllib.parse import unquote

import numpy as np
import pytest
from explorables import InJupyterLab, OnTheSite

from qcbook import Sulci
from qcbook.examples import cortices
from qcbook.explore_sulci import radius_on_control
from qcbook.liveproblems import as_moved, example
from qclearn.plane.mobius import best_mobius, mobius

VIEWS = ("turn of the surface in degrees", "tilt of the surface in degrees", "zoom", "unfolded, 0 to 1")
NO_WEBGL = """const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function(kind, ...more) {
  return kind === 'webgl' ? null : get.call(this, kind, ...more);
};"""


class TestOnTheSite(OnTheSite):
    page, name, slider, silent = "weights.html", "sulci", "gamma", VIEWS

    def test_millimetres_are_the_librarys(self, shown):
        shown.reset()
        shown.press(shown.slider("beta"), "ArrowRight")
        data = shown.data()
        problem = as_moved(example(data["state"]["problem"]).problem, data["state"], Sulci.mesh)
        f = np.array(data["answer"]["map"]).view(complex)
        off = Sulci.distances(data["state"], problem, f)
        assert data["answer"]["mm"] == pytest.approx(off.mean(), abs=0.02)
        assert shown.number("Registered landmarks are") == pytest.approx(off.mean(), abs=0.02)
        worst = [off[problem.curve == label].mean() for label in np.unique(problem.curve)]
        assert f"Worst is the {cortices('cortex').names[int(np.argmax(worst))]}" in shown.words
        p, q = problem.moving, problem.target
        before = np.linalg.norm(np.subtract(*(lifted(points) for points in (mobius(p, *best_mobius(p, q)), q))), axis=1)
        assert shown.number("Möbius map alone") == pytest.approx(before.mean(), abs=0.05)

    def test_the_surface_is_turned_by_mouse_and_keys(self, shown):
        shown.reset()
        canvas, words, picture = (shown.root.locator("canvas").first, shown.words, shown.pictures()[0])
        shown.drag_with_the_mouse(canvas, (0.3, 0.0), (-0.3, 0.1))
        state = shown.state()
        assert state["turn"] > 10 and state["tilt"] != 10
        assert shown.words == words and shown.pictures()[0] != picture
        shown.press(canvas, "ArrowLeft")
        assert shown.state()["turn"] == pytest.approx(state["turn"] + 5)

    def test_the_surface_is_coloured_by_the_radius_that_register_gives(self, shown):
        shown.reset()
        grey = shown.pictures()[0]
        switch = shown.root.get_by_role("checkbox", name="coloured by how far")
        shown.after(switch.click)
        assert shown.pictures()[0] != grey
        radius = radius_on_control("cortex") / 10
        np.testing.assert_allclose(np.array(shown.data()["answer"]["radius"]) / 10, radius)
        low, high = np.sort(radius)[[int(share * len(radius)) for share in (0.1, 0.9)]]
        assert f"{low:.1f} mm (lightest) to {high:.1f} mm (darkest)" in shown.words
        shown.after(switch.click)
        assert shown.pictures()[0] == grey

    def test_the_tuner_takes_the_state(self, shown):
        shown.reset()
        shown.press(shown.slider("beta"), "ArrowRight")
        link = unquote(shown.root.get_by_role("link", name="Take this to the tuner").get_attribute("href"))
        page, state = link.split("#live-tuner=")
        assert page == "live.html" and json.loads(state)["beta"] == shown.state()["beta"]

    def test_without_webgl_it_says_so_and_the_picture_stays(self, window, site_address):
        page = window.new_page()
        page.add_init_script(NO_WEBGL)
        page.goto(site_address + self.page)
        root = page.locator(f".qc-live[data-page={self.name}]")
        root.locator("[role=status]:has-text('no WebGL')").wait_for(timeout=60_000)
        assert root.locator("img[alt]").count() == 1
        page.close()


def lifted(points):
    return cortices("cortex").control.lift(points)


class TestInJupyterLab(InJupyterLab):
    # Each fit stops by a rule of its own.
    name, live, silent, gap, sets = "sulci", "Sulci()", VIEWS, 1e-2, {"gamma": 1e5, "turn": 40.0}

    def test_its_map_is_pythons(self, shown):
        shown.tab.until("sulci.map.shape == (1729,) and 0 < sulci.found['mm'] < 20")
