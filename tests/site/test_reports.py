"""Pages of `qclearn report` in a browser, from files: silent, without a request, readable, and moved by keys."""

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from view import NARROW, NO_WEBGL, WIDE, View

from meshes import bowl
from qclearn.cli import main
from qclearn.io.meshes import write_surface
from reports import drawn

pytestmark = pytest.mark.xdist_group("reports")
TURNED = [{"name": "east", "moving": list(range(1, 145, 24)), "control": list(range(2, 146, 24))}]
SHOWN = "() => [...document.querySelectorAll('.stack > div')].map(e => getComputedStyle(e).visibility)"


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A folder with the page of a pair of bowls."""
    folder, patch = tmp_path_factory.mktemp("reports"), pytest.MonkeyPatch()
    patch.setattr("qclearn.plot.registration_figure", lambda *_: Figure())  # not on these pages
    write_surface(folder / "control.npz", bowl(0.9, lean=0.4))
    (folder / "east.json").write_text(json.dumps({"curves": TURNED}))
    write_surface(folder / "one.npz", bowl(0.6, lean=0.3))
    words = ["register", folder / "one.npz", folder / "control.npz", "--landmarks", folder / "east.json"]
    run(*words, "--no-features", "--report", "--out", folder / "one")
    patch.undo()
    return folder


def run(*arguments):
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        assert stop.code in (None, 0, 3)


@pytest.fixture
def view(window, pages):
    yield from opened(window, pages, "one/report.html")


def opened(window, pages, name, **more):
    view = View(window, pages.as_uri() + "/", name, **more)
    yield view
    view.page.close()


def picture(view):
    return view.page.locator("canvas").evaluate("canvas => canvas.toDataURL()")


def test_everybody_can_read_it_and_nothing_complains(view):
    for width in (WIDE, NARROW):
        if width != WIDE:
            view.resize(width)
        for scheme in ("light", "dark"):
            view.page.emulate_media(color_scheme=scheme)
            assert view.axe_findings() == []
        assert view.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    asked = [url for url in view.requests if not url.startswith("data:")]
    assert asked == [view.page.url] and view.complaints == []


def test_before_and_after_take_each_others_place(view):
    button, choices = view.page.locator(".flip"), view.page.locator(".views input")
    assert view.page.evaluate(SHOWN) == ["hidden", "visible", "hidden"]
    button.focus()
    for shown in (["visible", "hidden", "hidden"], ["hidden", "visible", "hidden"]):
        view.page.keyboard.press("Enter")
        assert view.page.evaluate(SHOWN) == shown
    view.page.locator(".stack").click()
    assert view.page.evaluate(SHOWN) == ["visible", "hidden", "hidden"]
    choices.nth(0).focus()
    view.page.keyboard.press("ArrowLeft")  # round to the last
    assert view.page.evaluate(SHOWN) == ["hidden", "hidden", "visible"]
    sizes = view.all(".stack img", "[e.naturalWidth, e.alt.length > 20]")
    assert len(sizes) == 6 and all(width > 300 and described for width, described in sizes)


def test_the_surface_is_turned_and_its_map_changed_by_keys_and_mouse(view):
    canvas, seen = view.page.locator("canvas"), [picture(view)]
    shown = seen[0], view.page.locator(".stack img").nth(2).get_attribute("src")  # both after registration
    # The map that was sent, from the same side: with another one light leans otherwise.
    to_right = [np.corrcoef(light, places)[0, 2] for light, places in map(drawn, shown)]
    assert min(to_right) > 0.3 and np.ptp(to_right) < 0.02
    canvas.focus()
    for key in ("ArrowRight", "ArrowDown", "+"):
        view.page.keyboard.press(key)
        seen.append(picture(view))
    view.page.keyboard.press("0")
    assert picture(view) == seen[0] and len(set(seen)) == 4
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    view.page.mouse.move(box["x"] + 200, box["y"] + 100)
    view.page.mouse.wheel(0, -300)
    view.page.wait_for_function("old => document.querySelector('canvas').toDataURL() != old", arg=seen[0])
    view.page.mouse.down()
    view.page.mouse.move(box["x"] + 260, box["y"] + 120, steps=3)
    view.page.mouse.up()
    seen.append(picture(view))
    view.page.locator(".maps input").first.focus()
    for _ in range(view.page.locator(".maps input").count() - 1):
        view.page.keyboard.press("ArrowRight")
        seen.append(picture(view))
    assert len(set(seen)) == len(seen) and view.complaints == []


def test_without_webgl_it_says_so_and_the_pictures_stay(window, pages):
    for view in opened(window, pages, "one/report.html", script=NO_WEBGL):
        assert "no WebGL" in view.page.locator(".viewer").inner_text()
        assert view.page.locator(".stack img").count() == 6 and view.complaints == []
