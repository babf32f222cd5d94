"""The growing cortex on its page and in JupyterLab: areas against Python's, frames, views."""

import base64
import json
import re

import numpy as np
import pytest
from explorables import InJupyterLab, OnTheSite
from places import SITE

CARRIED = re.compile(r'<script type="text/plain" data-file="growth.bin">([^<]*)</script>')


class TestOnTheSite(OnTheSite):
    page, name, slider = "cortex.html", "growth", "frame"

    def test_areas_are_those_of_the_frames_on_the_page(self, shown):
        shown.reset()
        data = base64.b64decode(CARRIED.search((SITE / self.page).read_text(encoding="utf-8"))[1])
        (length,) = np.frombuffer(data[:4], "<u4")
        ((_, shape, _), (_, faces, _)) = json.loads(data[4 : 4 + length])["arrays"]
        count, start = int(np.prod(shape)), 4 + length
        positions = np.frombuffer(data[start : start + 2 * count], np.float16).astype(float).reshape(shape)
        faces = np.frombuffer(data[start + 2 * count :], np.float32).astype(int).reshape(faces)
        a, b, c = np.moveaxis(positions[:, faces], 2, 0)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum(-1) / 2
        assert shown.number("The area is") == pytest.approx(areas[0] / 100, rel=1e-3)
        shown.press(shown.slider("frame"), "End")
        assert shown.data()["answer"]["area"] == pytest.approx(areas[-1] / areas[0], rel=1e-9)
        assert len(data) < 1.8e6 and " 0 of " in shown.words and "triangles cross" in shown.words

    def test_pointing_turns_it(self, shown):
        shown.reset()
        canvas, before = shown.root.locator("canvas").first, shown.pictures()[0]
        shown.drag_with_the_mouse(canvas, (0.3, 0.0), (-0.3, 0.1))
        state = shown.state()
        assert state["turn"] > 10 and state["tilt"] != 10
        assert shown.pictures()[0] != before
        shown.press(canvas, "Shift+ArrowLeft")
        assert shown.state()["turn"] == pytest.approx(state["turn"] + 15, abs=1)


class TestInJupyterLab(InJupyterLab):
    # A ball that grows stands for a cortex.
    before = """import numpy as np, pyvista as pv
ball = pv.Icosphere(1, nsub=2)
frames = [np.array([k * ball.points for k in (1, 2, 3)]), ball.regular_faces, np.array([1, 2, 3]), [0, 0, 0]]"""
    name, live = "growth", "Growth(*frames)"
    sets = {"frame": 2, "turn": 60}  # noqa: RUF012
