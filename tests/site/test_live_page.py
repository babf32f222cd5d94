"""The live page in a real JupyterLab: a slider of its own tuner, moved with the keyboard, changes
the answer."""

import nbformat
import pytest
from laboratory import RUN_ALL, Reader, wait_until_idle

pytestmark = pytest.mark.xdist_group("pages in JupyterLab")
ANSWER = ".widget-interact .jp-OutputArea-output"


def up_to_the_tuner(source):
    """The page as far as its own tuner: what follows takes a minute and no part in it."""
    notebook = nbformat.read(source, as_version=4)
    (tuner,) = [k for k, cell in enumerate(notebook.cells) if "\n@ipywidgets.interact(" in cell.source]
    notebook.cells = notebook.cells[: tuner + 1]
    return notebook


def test_a_moved_slider_changes_the_answer(browser, lab):
    nbformat.write(up_to_the_tuner(lab.root / "sources" / "live.ipynb"), lab.root / "planted" / "tuner.ipynb")
    reader = Reader(browser, lab.address)
    page = reader.page
    reader.open("planted/tuner.ipynb")
    page.evaluate(RUN_ALL)
    answer = page.locator(ANSWER, has_text="certified bijective").first
    answer.wait_for(timeout=120_000)
    wait_until_idle(page)
    before = answer.inner_text().split(";")[0]
    sliders = page.locator(".widget-interact .widget-slider")
    assert sliders.locator(".widget-label").all_inner_texts() == ["alpha", "beta", "gamma", "delta"]
    sliders.nth(2).locator(".noUi-handle").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_function(
        "([place, before]) => ![...document.querySelectorAll(place)].some(e => e.innerText.includes(before))",
        arg=[ANSWER, before],
        timeout=30_000,
    )
    wait_until_idle(page)
    assert "certified bijective" in page.locator(ANSWER).first.inner_text()
    errors = "[data-mime-type*='jupyter.error'], [data-mime-type*='jupyter.stderr']"
    assert page.locator(f".jp-OutputArea :is({errors})").count() == 0
    page.close()
