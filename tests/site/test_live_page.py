"""The live page in a real JupyterLab: its first cell alone brings the explorable, and a slider moved by
keys changes the sentence."""

import nbformat
import pytest
from laboratory import RUN_ALL

pytestmark = pytest.mark.xdist_group("JupyterLab")
ROOT = ".jp-NotebookPanel:not(.lm-mod-hidden) .qc-live[data-page=tuner][data-ready]"


def test_the_first_cell_alone_brings_the_sliders(reader, lab):
    notebook = nbformat.read(lab.root / "sources" / "live.ipynb", as_version=4)
    notebook.cells = [next(cell for cell in notebook.cells if cell.cell_type == "code")]
    nbformat.write(notebook, lab.root / "planted" / "tuner.ipynb")
    page = reader.page
    reader.open("planted/tuner.ipynb")
    page.evaluate(RUN_ALL)
    page.wait_for_selector(ROOT, timeout=120_000)
    sentence = page.locator(f"{ROOT} [role=status]")
    before = sentence.inner_text()
    assert "mm off" in before
    page.locator(ROOT).get_by_role("slider", name="gamma").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function(
        "([place, before]) => document.querySelector(place).textContent !== before",
        arg=[f"{ROOT} [role=status]", before],
        timeout=30_000,
    )
    reader.close()
