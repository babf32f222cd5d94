"""On the site no kernel answers: every control of a widget is disabled, and a sentence beside it says so."""

import re

import pytest
from places import SITE

STATE = "application/vnd.jupyter.widget-view+json"
WITH_WIDGETS = sorted(path.name for path in SITE.glob("*.html") if STATE in path.read_text())
LIVE = ".jupyter-widgets :is(button, input, select, textarea):not(:disabled)"
HANDLES = ".jupyter-widgets .noUi-handle"


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in WITH_WIDGETS]
)
def page(request, browser, site_address):
    page = browser.new_page()
    page.goto(site_address + request.param, wait_until="load")
    page.wait_for_selector(HANDLES, state="attached", timeout=30_000)
    page.wait_for_load_state("networkidle")
    yield page
    page.close()


def test_there_are_pages_with_widgets():
    assert {"fourier.html", "live.html"} <= set(WITH_WIDGETS), "build the site with `make book` first"


def test_no_control_can_be_used(page):
    assert page.locator(LIVE).count() == 0
    for name, value in (("aria-disabled", "true"), ("tabindex", "-1")):
        assert set(page.eval_on_selector_all(HANDLES, f"all => all.map(e => e.getAttribute('{name}'))")) == {value}
    assert page.locator(".jupyter-widgets .widget-readout[contenteditable='true']").count() == 0


def test_handles_have_the_names_of_their_sliders(page):
    names = page.eval_on_selector_all(HANDLES, "all => all.map(e => e.getAttribute('aria-label'))")
    labels = page.eval_on_selector_all(
        HANDLES, "all => all.map(e => e.closest('.jupyter-widgets').querySelector('.widget-label').textContent)"
    )
    assert names == labels and all(names)


def test_neither_key_nor_mouse_moves_a_handle(page):
    handle, readout = page.locator(HANDLES).first, page.locator(".jupyter-widgets .widget-readout").first
    before = handle.get_attribute("aria-valuenow"), readout.inner_text()
    handle.evaluate("e => e.focus()")
    page.keyboard.press("ArrowRight")
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y, steps=4)
    page.mouse.up()
    assert (handle.get_attribute("aria-valuenow"), readout.inner_text()) == before


def test_a_sentence_stands_beside_each_widget(page):
    widgets = page.evaluate(
        "() => [...document.querySelectorAll('.jupyter-widgets')].filter(box => "
        "!box.parentElement.closest('.jupyter-widgets') && box.querySelector('.noUi-handle')).length"
    )
    notes = page.locator(".no-kernel").all_inner_texts()
    assert len(notes) == widgets > 0
    assert all(re.search(r"disabled on the site.*make lab", note) for note in notes)
