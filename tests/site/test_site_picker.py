"""Landmarks clicked in JupyterLab, by mouse and by keys, named, taken back and saved."""

import json
import re

import pytest
from view import axe_findings

pytestmark = pytest.mark.xdist_group("JupyterLab")
MAKE = (
    "from qclearn import fsaverage5\nfrom qcbook import LandmarkPicker\n"
    "sides = [fsaverage5(side, wall='thickness') for side in ('right', 'left')]\n"
    "picker = LandmarkPicker(*sides, 'clicked.json')\npicker"
)


def test_landmarks_are_clicked_named_undone_and_saved(notebook):
    page = notebook.page
    notebook.add(MAKE)
    moving, control = (
        page.get_by_role("application", name=re.compile(f"^{side} surface:")) for side in ("moving", "control")
    )
    said = page.locator(".jp-OutputArea [role=status]")
    moving.locator("img").wait_for(timeout=120_000)
    notebook.until("'picker' in globals()", 60)
    expected = [notebook.run(f"print(picker.views['moving'].vertex_at({x}, 200))") for x in (200, 260)]
    for x in (200, 260):
        moving.locator("img").click(position={"x": x, "y": 200})
    said.filter(has_text="curve 1 lacks ends: 2 on the control side.").wait_for()
    assert notebook.run("print(*picker.curves[0]['moving'])").split() == expected
    before = notebook.run("print(hash(picker.pictures['control']))")
    control.focus()
    page.keyboard.press("Enter")
    said.filter(has_text="curve 1 lacks ends: 1 on the control side.").wait_for()
    for key in ("ArrowLeft", "ArrowUp", "+", "Enter"):
        page.keyboard.press(key)
    said.filter(has_text="curve 1 is complete").wait_for()
    page.keyboard.press("u")
    said.filter(has_text="curve 1 lacks ends: 1 on the control side.").wait_for()
    notebook.until(f"hash(picker.pictures['control']) != {before}")
    box = control.locator("img").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 210, steps=5)
    page.mouse.up()
    page.keyboard.press("Enter")
    said.filter(has_text="curve 1 is complete; name it, go on, or save.").wait_for()
    page.get_by_label("name of the curve").fill("a sulcus")
    page.get_by_role("button", name="Save", exact=True).click()
    said.filter(has_text="1 curve written to clicked.json.").wait_for()
    contents = json.loads(notebook.run("print(open('clicked.json').read())"))
    (curve,) = contents["curves"]
    assert curve["name"] == "a sulcus" and [*map(str, curve["moving"])] == expected
    assert len(set(curve["control"])) == 2 and set(contents["surfaces"]) == {"moving", "control"}
    assert axe_findings(page, page.locator(".jp-OutputArea .widget-subarea, .jp-OutputArea-output").last) == []
    assert notebook.complaints == []
