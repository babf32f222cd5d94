"""Widgets in a real JupyterLab: an explorable set by Python, the live page's first cell, clicked landmarks."""

import json
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from explorables import Explorable
from laboratory import RUN_ALL
from view import axe_findings

pytestmark = pytest.mark.xdist_group("JupyterLab")


def test_an_explorable_is_moved_by_hand_and_by_python_and_asks_the_kernel(notebook):
    notebook.add("mobius = explorable(Mobius())\nmobius")
    shown = Explorable(notebook, "mobius")
    words, pictures = shown.seen()
    shown.after(lambda: notebook.run("mobius.set(size=0.7, direction=90.0)"))
    assert shown.words != words and shown.pictures() != pictures
    shown.click("Undo")
    assert shown.words == words
    start = 0.4 * np.exp(1j * np.radians(30))
    shown.drag(shown.root.locator("canvas").first, (start.real, start.imag), (0.2, 0.2), (-0.5, 0.0))
    notebook.until("abs(mobius.live.parameters(mobius.state)[0] + 0.5) < 1e-3")
    shown.press(shown.root.get_by_role("slider").first, "End")
    notebook.until(f"json.loads(json.dumps(mobius.state)) == {shown.data()['state']!r}")
    assert "it is" in shown.guess()
    shown.root.get_by_role("button", name="Ask the kernel").click()
    shown.root.locator('[role=status]:has-text("The kernel\'s")').wait_for(timeout=60_000)
    assert float(re.findall(r"\d\.?\d*e[+-]\d+|0", shown.said)[-1]) < 1e-12
    assert axe_findings(shown.page, shown.root) == []
    assert notebook.complaints == [] and notebook.from_elsewhere() == []


def test_a_folder_that_register_wrote_is_tuned(notebook):
    folder = Path(__file__).resolve().parents[1] / "run_of_0_2"
    notebook.add(f"own = explorable(Tuner({str(folder)!r}))\nown")
    shown = Explorable(notebook, "tuner", "Landmarks alone, on your own surfaces")
    assert "which need `register` again" in shown.said and "held out (blue)" in shown.said
    shown.press(shown.slider("gamma"), "ArrowLeft")
    notebook.until("own.state['gamma'] < own.live.initial['gamma'] and own.state['problem'] == 'own'")
    notebook.until("own.found['held'] > own.found['fitted'] > 0")
    shown.root.get_by_role("button", name="Command with folds").click()
    command = shown.root.locator(".qc-live-copied").inner_text()
    assert command.startswith("qclearn register rh.pial lh.pial --cortex ")
    assert "--gamma 1000 --delta 3 --eta 3.5" in command
    shown.reset()
    notebook.until("own.state['gamma'] == own.live.initial['gamma'] and own.state['held'] == [1]")
    assert notebook.complaints == [] and notebook.from_elsewhere() == []


LIVE = ".jp-NotebookPanel:not(.lm-mod-hidden) .qc-live[data-page=tuner][data-ready]"


def test_the_first_cell_of_the_live_page_alone_brings_the_sliders(reader, lab):
    notebook = nbformat.read(lab.root / "sources" / "live.ipynb", as_version=4)
    notebook.cells = [next(cell for cell in notebook.cells if cell.cell_type == "code")]
    nbformat.write(notebook, lab.root / "planted" / "tuner.ipynb")
    page = reader.page
    reader.open("planted/tuner.ipynb")
    page.evaluate(RUN_ALL)
    page.wait_for_selector(LIVE, timeout=120_000)
    before = page.locator(f"{LIVE} [role=status]").inner_text()
    assert "mm off" in before
    page.locator(LIVE).get_by_role("slider", name="gamma").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function(
        "([place, before]) => document.querySelector(place).textContent !== before",
        arg=[f"{LIVE} [role=status]", before],
        timeout=30_000,
    )
    reader.close()


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
    said.filter(has_text=re.compile(r"1 curve written to .*clicked\.json\.")).wait_for()
    contents = json.loads(notebook.run("print(open('clicked.json').read())"))
    (curve,) = contents["curves"]
    assert curve["name"] == "a sulcus" and [*map(str, curve["moving"])] == expected
    assert len(set(curve["control"])) == 2 and set(contents["surfaces"]) == {"moving", "control"}
    assert axe_findings(page, page.locator(".jp-OutputArea .widget-subarea, .jp-OutputArea-output").last) == []
    assert notebook.complaints == []
