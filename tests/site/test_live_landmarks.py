"""Endpoints of a sulcus, on the page and in JupyterLab: paths, LD-Net's curves and distances
against the library's."""

import json
from urllib.parse import quote, unquote

import numpy as np
import pytest
from explorables import InJupyterLab, OnTheSite

from qcbook.examples import cortices
from qcbook.explore_landmarks import SULCI, Landmarks
from qclearn.nets import load
from qclearn.registration.curves import sample_curve
from qclearn.surfaces.curvature import area_radius


@pytest.fixture(scope="module")
def live():
    return Landmarks()


def place_of(name, vertex):
    """Where a vertex is in the picture, (x, y)."""
    pair = cortices(name)
    w = area_radius(pair.moving.surface, pair.moving.disk.z).to_image(pair.moving.disk.z[vertex])
    return float(w.real), float(w.imag)


class TestOnTheSite(OnTheSite):
    page, name, slider = "ldnet.html", "landmarks", "weight of the depth"

    def test_ldnets_curves_are_the_networks(self, shown):
        """Of the weights that are shipped, whatever they are."""
        shown.reset()
        pair = cortices("first")
        paths = [pair.paths[0][pair.names.index(name)] for name in SULCI]
        ends = np.array([[path[0], path[-1]] for path in paths])
        detected = load("ldnet").detect(pair.moving.surface, pair.moving.disk.z, ends)
        for k in (0, 7):
            shown.choose("sulcus", str(1 - k % 2))
            shown.choose("sulcus", str(k))
            assert np.array_equal(pair.moving.disk.z[shown.data()["answer"]["network"]], detected[k])

    def test_ends_are_dragged_and_moved_by_keys(self, shown, live):
        shown.reset()
        canvas, (start, end) = shown.root.locator("canvas").first, live.ends(dict(live.initial))
        here = place_of("first", end)
        there = here[0] + 0.1, here[1] + 0.05
        shown.drag_with_the_mouse(canvas, here, there)
        moved = shown.state()["ends"]["1"]
        assert abs(complex(*place_of("first", moved)) - complex(*there)) < 0.03
        assert "Ends of your own" in shown.words and "stored for the named sulci" in shown.words
        assert shown.data()["answer"]["path"][0] == start and shown.data()["answer"]["path"][-1] == moved
        shown.press(canvas, "ArrowUp")
        assert place_of("first", shown.state()["ends"]["1"])[1] > place_of("first", moved)[1]

    def test_ends_that_meet_are_refused(self, shown, live):
        shown.reset()
        start, _ = live.ends(dict(live.initial))
        picture, link = (shown.pictures(), "#live-landmarks=" + quote(json.dumps({"ends": {"1": start}})))
        shown.after(lambda: shown.page.evaluate("link => { location.href = link; }", link))
        assert "both ends are at the same place" in shown.said and shown.pictures() == picture

    def test_the_tuner_takes_the_curve(self, shown, live):
        shown.reset()
        link = unquote(shown.root.get_by_role("link", name="to the tuner").get_attribute("href"))
        page, state = link.split("#live-tuner=")
        pair, taken = cortices("first"), json.loads(state)
        assert page == "live.html" and taken["problem"] == "first"
        first = 5 * pair.names.index(SULCI[0])
        path = np.array(shown.data()["answer"]["path"])
        wanted = sample_curve(pair.moving.surface, path, 5) @ pair.moving.disk.z
        for k in range(5):
            assert abs(complex(*taken["starts"][str(first + k)]) - wanted[k]) < 1e-3


class TestInJupyterLab(InJupyterLab):
    name, live, gap, sets = "landmarks", "Landmarks()", 1e-3, {"sulcus": 3, "depth": 3.5}

    def test_python_reads_path_and_curve(self, shown):
        shown.tab.until("len(landmarks.found['path']) > 5 and len(landmarks.found['tuner']['starts']) == 5")
