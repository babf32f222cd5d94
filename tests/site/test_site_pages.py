"""Every page of the built site as readers without a network see it, opened once: first in a wide window, then, from
`narrow` on, in a telephone's. The order of the tests counts: the last ones hear what all before them brought."""

import re
from functools import cache
from urllib.parse import unquote, urldefrag

import pytest
from places import SITE
from view import HANDLES, NARROW, PAGES, WIDE, WIDGETS, View, axe_findings

LIVE = ".jupyter-widgets :is(button, input, select, textarea):not(:disabled)"
# Colours fade over: what they end in is drawn once each animation is over.
THEME = """async (theme) => {
    document.documentElement.dataset.theme = theme;
    await new Promise(requestAnimationFrame);
    document.getAnimations().filter((fade) => fade.effect.getComputedTiming().endTime < Infinity)
        .forEach((fade) => fade.finish());
    await new Promise(requestAnimationFrame);
}"""
SCREENS = 30  # of 1280 x 900, with what is folded closed: an hour's reading
SCENE = "iframe.scene:not([hidden])"


# xdist keeps a page's tests on one worker by the group's name.
@pytest.fixture(scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in PAGES])
def view(request, window, site_address):
    view = View(window, site_address, request.param)
    yield view
    view.page.close()


@pytest.fixture(scope="module")
def narrow(view):
    view.resize(NARROW)
    return view


def test_formulas_are_typeset(view):
    formulas = view.page.locator("article .math").count()
    assert view.page.locator("article mjx-container").count() >= formulas
    assert view.page.locator("mjx-merror").count() == 0


def test_a_page_is_at_most_thirty_screens_long(view):
    length = view.page.evaluate(
        "() => document.querySelector('article, main:not(:has(article))').scrollHeight / innerHeight"
    )
    assert length <= SCREENS


def test_every_figure_has_a_description(view):
    # ipywidgets.Image cannot carry a description; an ipywidgets.HTML with an <img alt="..."> can.
    silent = "article img:not([alt]), article img[alt=''], article iframe:not([title]), article iframe[title='']"
    assert view.all(silent, "e.outerHTML.slice(0, 200)") == []


def test_no_cell_shows_an_error_or_a_warning(view):
    assert view.page.locator("article .output.traceback, article .output.stderr").count() == 0
    assert "Traceback (most recent call last)" not in view.page.locator("body").inner_text()


@cache
def anchors(file):
    return set(re.findall(r'id="([^"]+)"', file.read_text(encoding="utf-8")))


def test_links_lead_somewhere(view):
    targets = view.all("article a[href], nav a[href]", "e.href")
    for target in sorted({link for link in targets if link.startswith(view.address)}):
        path, fragment = urldefrag(target[len(view.address) :])
        file = SITE / unquote(path or "index.html")
        assert file.exists(), target
        if fragment.startswith("live-"):  # the state of an explorable there
            name = fragment.removeprefix("live-").split("=")[0]
            assert f'data-page="{name}"' in file.read_text(encoding="utf-8"), target
        elif fragment and file.suffix == ".html":
            assert unquote(fragment) in anchors(file), target


def test_widgets_appear(view):
    if view.page.locator(WIDGETS).count():
        assert view.page.locator(".jupyter-widgets").count()
    assert view.page.locator(".jupyter-widgets-error-widget").count() == 0


# On the site no kernel answers: every control of a widget is disabled, and a sentence beside it says so.


def test_no_control_can_be_used(view):
    assert view.page.locator(LIVE).count() == 0
    for name, value in (("aria-disabled", "true"), ("tabindex", "-1")):
        assert set(view.all(HANDLES, f"e.getAttribute('{name}')")) <= {value}
    assert view.page.locator(".jupyter-widgets .widget-readout[contenteditable='true']").count() == 0


def test_handles_have_the_names_of_their_sliders(view):
    names = view.all(HANDLES, "e.getAttribute('aria-label')")
    labels = view.all(HANDLES, "e.closest('.jupyter-widgets').querySelector('.widget-label').textContent")
    assert names == labels and all(names)


def test_neither_key_nor_mouse_moves_a_handle(view):
    handle, readout = (view.page.locator(HANDLES).first, view.page.locator(".jupyter-widgets .widget-readout").first)
    if not handle.count():
        return
    before = handle.get_attribute("aria-valuenow"), readout.inner_text()
    handle.evaluate("e => e.focus()")
    view.page.keyboard.press("ArrowRight")
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    view.page.mouse.move(x, y)
    view.page.mouse.down()
    view.page.mouse.move(x + 40, y, steps=4)
    view.page.mouse.up()
    assert (handle.get_attribute("aria-valuenow"), readout.inner_text()) == before


def test_a_sentence_stands_beside_each_widget(view):
    widgets = view.page.evaluate(
        "() => [...document.querySelectorAll('.jupyter-widgets')].filter(box => "
        "!box.parentElement.closest('.jupyter-widgets') && "
        "box.querySelector('.noUi-handle')).length"
    )
    notes = view.page.locator(".no-kernel").all_inner_texts()
    assert len(notes) == widgets and bool(widgets) == bool(view.page.locator(WIDGETS).count())
    assert all(re.search(r"disabled on the site.*make lab", note) for note in notes)


def test_everybody_can_read_a_wide_window(view):
    assert view.axe_findings() == []


def test_everybody_can_read_a_scene(view):
    """All scenes are built alike, so the first one of a page stands for the others."""
    poster = view.page.locator("button.scene-poster").first
    if poster.count():
        poster.click()
    if view.page.locator("iframe.scene").count() == 0:
        return
    view.page.frame_locator(SCENE).first.locator("canvas").first.wait_for(timeout=20_000)
    scenes = [frame for frame in view.page.frames if frame != view.page.main_frame and frame.locator("canvas").count()]
    assert scenes, "no scene was loaded"
    assert [finding for frame in scenes for finding in axe_findings(frame)] == []


def test_nothing_is_cut_off_in_a_wide_window(view):
    assert view.layout_faults() == []


def test_nothing_is_cut_off_in_a_narrow_window(narrow):
    assert narrow.layout_faults() == []


@pytest.mark.slow
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [WIDE, NARROW])
def test_everybody_can_read_either_window_by_day_and_in_the_dark(view, width, theme):
    view.resize(width)
    view.page.evaluate(THEME, theme)
    assert view.axe_findings() == []


def test_nothing_comes_from_elsewhere(narrow):
    assert narrow.from_elsewhere() == []


def test_it_weighs_at_most_eight_megabytes(narrow):
    assert sum(narrow.sizes.values()) < 8e6, sorted(narrow.sizes.items(), key=lambda item: -item[1])[:5]


def test_nothing_fails_and_nothing_complains(narrow):
    assert narrow.complaints == []
