"""No page, in either colour scheme and at either width, has a finding of axe-core that it calls serious or critical."""

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from opened import PAGES, opened

# A formula is left out: its glyphs are hidden from screen readers, which get MathML; its colour is the text's.
RUN = """rules => axe.run({exclude: [["mjx-container"]]}, {resultTypes: ["violations"], iframes: false, ...rules})
    .then(found => found.violations.filter(({impact}) => ["serious", "critical"].includes(impact))
    .flatMap(({id, nodes}) => nodes.map(node => `${id}: ${node.target} ${node.html.slice(0, 120)}`)))"""
# What can differ in a narrow window and in the dark.
NARROW = {"runOnly": ["color-contrast", "scrollable-region-focusable", "button-name", "link-name"]}


def findings(frame, **rules):
    frame.evaluate(AXE_SCRIPT)
    return frame.evaluate(RUN, rules)


@pytest.fixture(scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in PAGES])
def wide(request, browser, site_address):
    with opened(browser, site_address + request.param, 1280) as page:
        if page.locator("script[type='application/vnd.jupyter.widget-view+json']").count():
            page.wait_for_selector(".jupyter-widgets", state="attached", timeout=20_000)
        yield page


def test_a_wide_window(wide):
    assert findings(wide) == []


def test_a_scene(wide):
    """All scenes are built alike, so the first one of a page stands for the others."""
    poster = wide.locator("button.scene-poster").first
    if poster.count():
        poster.click()
    if wide.locator("iframe.scene:not([hidden])").count() == 0:
        return
    wide.frame_locator("iframe.scene:not([hidden])").first.locator("canvas").first.wait_for(timeout=20_000)
    scenes = [frame for frame in wide.frames if frame != wide.main_frame and frame.locator("canvas").count()]
    assert scenes, "no scene was loaded"
    assert [finding for frame in scenes for finding in findings(frame)] == []


def test_a_narrow_window_in_the_dark(wide):
    wide.set_viewport_size({"width": 390, "height": 900})
    wide.evaluate("() => { document.documentElement.dataset.theme = 'dark'; }")
    wide.wait_for_timeout(500)  # reflow.js waits for the end of a change of size
    assert findings(wide, **NARROW) == []


PLANTED = {
    "a button without a name": ("<button></button>", "button-name"),
    "a picture without a description": ("<img src='_static/registration.png'>", "image-alt"),
    "pale text": ("<p style='color: #ccc; background: #fff'>pale</p>", "color-contrast"),
    "a slider without a name": ("<div role='slider' tabindex='0' aria-valuenow='1'>o</div>", "aria-input-field-name"),
    "a list of no items": ("<div role='list'><div role='button' tabindex='0'>x</div></div>", "aria-required-children"),
}


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(browser, site_address, planted):
    html, rule = PLANTED[planted]
    with opened(browser, site_address + "genindex.html", 1280) as page:
        page.evaluate("html => document.querySelector('article').insertAdjacentHTML('beforeend', html)", html)
        assert any(finding.startswith(rule) for finding in findings(page))
