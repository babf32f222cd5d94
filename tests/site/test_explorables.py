"""Explorables on their pages: each opens, answers every control and a pointer, and can be read by
everybody; what all share is tested once, and what the tuner says where something is missing."""

import base64
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from urllib.parse import quote, unquote

import numpy as np
import pytest
from explorables import LISTEN, Explorable
from places import SITE
from view import NARROW, NO_WEBGL, WIDE, View, axe_findings

from qcbook import Mobius
from qcbook.examples import cortices
from qcbook.explore_landmarks import Landmarks
from qcbook.liveproblems import example
from qclearn.surfaces.curvature import area_radius


@dataclass(frozen=True)
class Row:
    """The page of an explorable; where something is dragged from, by how far, and where it is then in
    the state, or None where dragging turns a surface; labels of sliders that change pictures alone;
    choices to begin with, words to wait for, and which canvas is dragged on."""

    page: str
    start: Callable
    by: complex
    place: Callable | None
    silent: tuple = ()
    chosen: tuple = ()
    ready: str = ""
    canvas: int = 0


def pole(state):
    return Mobius.parameters(Mobius.initial | state)[0]


def in_picture(vertex):
    """Where a vertex is in the picture of the sulci's ends."""
    side = cortices("cortex").moving
    return area_radius(side.surface, side.disk.z).to_image(side.disk.z[vertex])


VIEWS = ("turn of the surface in degrees", "tilt of the surface in degrees", "zoom", "unfolded, 0 to 1")
FSAVERAGE = Landmarks.initial | {"hemisphere": "cortex"}
ROWS = {
    "mobius": Row("conformal.html", lambda: pole({}), -0.8, pole),
    "boundary": Row("dbsnet.html", lambda: 0.5 + 0.6j, -0.2 - 0.2j, lambda state: complex(*state["pole"])),
    "growth": Row("cortex.html", lambda: 0.3, -0.6 + 0.1j, None),
    "howsure": Row("howsure.html", lambda: 0.35 - 0.55j, 0.34 + 0.55j, lambda state: complex(*state["places"][5])),
    "landmarks": Row(
        "ldnet.html",
        lambda: in_picture(Landmarks().ends(FSAVERAGE)[1]),
        0.1 + 0.05j,
        lambda state: in_picture(state["ends"]["1"]),
        chosen=("hemisphere", "cortex"),
    ),
    "lbs": Row("lbs.html", lambda: 0.5 + 0.2j, 0.1 + 0.1j, lambda state: complex(*state["moves"]["0"])),
    "mu": Row(
        "quasiconformal.html",
        lambda: -0.4 + 0.3j,
        0.2,
        lambda state: complex(*state["strokes"][-1][:2]),
        silent=("radius of the brush",),
        chosen=("pattern of mu", "blank"),
    ),
    "tuner": Row(
        "live.html",
        lambda: example("twist").problem.target[4],
        0.1,
        lambda state: complex(*state["targets"]["4"]),
        silent=VIEWS,
        chosen=("problem", "twist"),
        ready="CP-Net: landmark error",
        canvas=1,
    ),
}
# Sets a slider as a hand does that lets it go.
TO = "(e, value) => { e.value = value; e.dispatchEvent(new Event('change')); }"


def opened(window, address, name, **more):
    """An explorable on its page; what the page complains of is a failure."""
    row = ROWS[name]
    file = SITE / row.page
    if not file.exists() or f'data-page="{name}"' not in file.read_text(encoding="utf-8"):
        pytest.fail(f"{row.page} has no explorable {name!r}: build the site with `make book` first")
    view = View(window, address, row.page, script=LISTEN, **more)
    yield Explorable(view, name, row.ready)
    view.page.close()
    if found := [*view.complaints, *view.from_elsewhere()]:
        pytest.fail(f"{row.page} complains: {found}")


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(row.page)) for name, row in ROWS.items()]
)
def shown(request, window, site_address):
    yield from opened(window, site_address, request.param)


def test_each_control_moves_it_and_has_a_name(shown):
    shown.moves_each_slider(shown.by_key, ROWS[shown.name].silent)
    if shown.name == "tuner":  # at the start, unfitted, one refinement of CP-Net's does no more than two
        shown.after(lambda: shown.slider("gamma").evaluate(TO, 3))
    shown.takes_each_choice()
    shown.turns_each_switch()
    shown.tab.resize(NARROW)
    assert axe_findings(shown.page, shown.root) == []
    assert shown.page.evaluate("() => document.documentElement.scrollWidth <= innerWidth")
    shown.tab.resize(WIDE)


def test_it_is_dragged_and_moved_by_keys(shown):
    row = ROWS[shown.name]
    canvas = shown.root.locator("canvas").nth(row.canvas)
    shown.reset()
    if row.chosen:
        shown.choose(*row.chosen)
    pictures, start, end = shown.pictures(), row.start(), row.start() + row.by
    shown.drag_with_the_mouse(canvas, (start.real, start.imag), (end.real, end.imag))
    state = shown.state()
    if row.place:
        assert abs(row.place(state) - end) < 0.03
    else:
        assert state["turn"] > 10 and state["tilt"] != 10
    assert shown.pictures() != pictures
    shown.press(canvas, "Shift+ArrowLeft")
    assert shown.state() != state


def test_its_main_picture_comes_first_and_large_and_in_focus(shown):
    shown.reset()
    canvas, control = (shown.root.locator("canvas").first, shown.root.locator("input, select").first)
    main = canvas.bounding_box()
    assert main["width"] >= 340 and main["y"] < control.bounding_box()["y"]
    assert canvas.evaluate("e => e.width / e.clientWidth") >= 1
    assert all(box["width"] >= 150 for box in map(type(canvas).bounding_box, shown.root.locator("canvas").all()))


def test_pictures_are_described_and_the_guess_is_answered(shown):
    labels = shown.root.locator("canvas").evaluate_all("all => all.map(canvas => canvas.ariaLabel)")
    assert labels and all(shown.said in label for label in labels)
    text = (SITE / ROWS[shown.name].page).read_text(encoding="utf-8")
    (alt,) = re.findall(f'data-page="{shown.name}"><img alt="([^"]*)"', text)
    assert len(alt) > 40
    assert "it is" in shown.guess()


# What all explorables share.


@pytest.fixture(scope="module")
def mobius(window, site_address):
    yield from opened(window, site_address, "mobius")


def test_the_mouse_moves_each_slider(mobius):
    mobius.moves_each_slider(mobius.by_mouse)


def test_a_key_moves_a_point_by_a_tenth(mobius):
    mobius.reset()
    mobius.press(mobius.root.locator("canvas").first, "Shift+ArrowUp")
    assert abs(pole(mobius.state()) - pole({}) - 0.1j) < 1e-3


def test_undo_a_link_and_reset_go_back_and_the_guess_is_of_the_present_state(mobius):
    mobius.reset()
    start, first = mobius.words, mobius.guess()
    mobius.press(mobius.slider("distance of the pole"), "End")
    state, words = mobius.state(), mobius.words
    assert state and words != start and mobius.guess() != first
    mobius.root.get_by_role("button", name="Link to this state").click()
    mobius.root.locator("[role=status]:has-text('#live-')").wait_for()
    link = re.search(r"http\S+#live-\S+", mobius.said)[0]
    mobius.click("Undo")
    assert mobius.state() == {} and mobius.words == start
    mobius.after(lambda: mobius.page.evaluate("link => { location.href = link; }", link))
    assert (mobius.state(), mobius.words) == (state, words)
    mobius.reset()
    assert mobius.state() == {} and mobius.words == start


def test_a_guess_is_judged_by_the_state_in_which_it_was_made(mobius):
    mobius.reset()
    first = mobius.guess()
    assert mobius.guess(then=lambda: mobius.press(mobius.slider("distance of the pole"), "End")) == first
    assert mobius.state() and mobius.guess() != first


def test_downloads_hold_the_state(mobius):
    data = mobius.data()
    assert data["page"] == mobius.name and data["state"] and data["answer"]
    assert mobius.download("Picture").path().read_bytes()[:4] == b"\x89PNG"


def test_without_scripts_a_picture_and_a_message_stand_there(silent_window, site_address):
    page = silent_window.new_page()
    page.goto(site_address + ROWS["mobius"].page)
    root = page.locator(".qc-live[data-page=mobius]")
    assert root.locator("img[alt]").count() == 1 and "JavaScript" in root.locator("[role=status]").inner_text()
    page.close()


def test_a_page_that_is_opened_by_a_link_starts_there(window, site_address):
    view = View(window, site_address, f"conformal.html#live-mobius={json.dumps({'size': 0.7})}", script=LISTEN)
    assert Explorable(view, "mobius").slider("distance of the pole").input_value() == "0.7"
    view.page.close()


# What only some of them have, and what node is not asked.


@pytest.fixture
def named(request, window, site_address):
    yield from opened(window, site_address, request.param)


@pytest.mark.parametrize("named", ["growth"], indirect=True)
def test_areas_are_those_of_the_frames_on_the_page(named):
    text = (SITE / ROWS["growth"].page).read_text(encoding="utf-8")
    data = base64.b64decode(re.search(r'<script type="text/plain" data-file="growth.bin">([^<]*)</script>', text)[1])
    (length,) = np.frombuffer(data[:4], "<u4")
    ((_, shape, _), (_, faces, _)) = json.loads(data[4 : 4 + length])["arrays"]
    count, start = int(np.prod(shape)), 4 + length
    positions = np.frombuffer(data[start : start + 2 * count], np.float16).astype(float).reshape(shape)
    faces = np.frombuffer(data[start + 2 * count :], np.float32).astype(int).reshape(faces)
    a, b, c = np.moveaxis(positions[:, faces], 2, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=-1).sum(-1) / 2
    named.press(named.slider("frame"), "End")
    assert named.data()["answer"]["area"] == pytest.approx(areas[-1] / areas[0], rel=1e-9)


@pytest.mark.parametrize("named", ["landmarks"], indirect=True)
def test_ends_that_meet_are_refused(named):
    start, _ = Landmarks().ends(FSAVERAGE)
    named.choose(*ROWS["landmarks"].chosen)
    picture, state = named.pictures(), {"hemisphere": "cortex", "ends": {"1": start}}
    link = "#live-landmarks=" + quote(json.dumps(state))
    named.after(lambda: named.page.evaluate("link => { location.href = link; }", link))
    assert "both ends are at the same place" in named.said and named.pictures() == picture


@pytest.mark.parametrize("named", ["landmarks"], indirect=True)
def test_a_path_is_handed_to_the_tuner(named):
    named.press(named.slider("weight of the depth"), "ArrowRight")
    link = unquote(named.root.get_by_role("link", name="to the tuner").get_attribute("href"))
    assert link.startswith("live.html#live-tuner=")
    state = json.loads(link.removeprefix("live.html#live-tuner="))
    assert state["problem"] == "first" and len(state["starts"]) == 5


def test_without_webgl_it_says_so_and_the_picture_stays(window, site_address):
    page = window.new_page()
    page.add_init_script(NO_WEBGL)
    page.goto(site_address + ROWS["tuner"].page)
    root = page.locator(TUNER)
    root.locator("[role=status]:has-text('no WebGL')").wait_for(timeout=60_000)
    assert root.locator("img[alt]").count() == 1
    page.close()


# The tuner: quick moves, answers that come in parts, and what is missing.

MANY = """e => { for (let k = 0; k < 50; k++) {
    e.value = 2 + k / 20;
    e.dispatchEvent(new Event(k < 49 ? 'input' : 'change'));
} }"""
HEAR = """() => addEventListener('qc-live-answer', event => {
    window.heard = event.target.querySelector('.qc-live-numbers').textContent;
}, {once: true})"""
TUNER = ".qc-live[data-page=tuner]"


@pytest.fixture(scope="module")
def tuner(window, site_address):
    yield from opened(window, site_address, "tuner")


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_picture_sliders_and_sentence_are_on_the_first_screen(tuner, size):
    tuner.reset()
    words = r"Fitted sulci [\d.]+ mm off; mean \|μ\| [\d.]+, largest [\d.]+; no triangle flipped\.$"
    assert re.match(words, tuner.said)
    tuner.page.set_viewport_size(dict(zip(("width", "height"), size)))
    parts = [*tuner.root.locator("canvas").all()[:2], tuner.root.locator(".qc-live-status")]
    parts += [tuner.slider(name) for name in ("alpha", "beta", "gamma")]
    tuner.page.evaluate("scrollTo(0, 0)")
    lowest = max(box["y"] + box["height"] for box in (part.bounding_box() for part in parts))
    tuner.tab.resize(WIDE)
    assert lowest <= size[1]


def test_fifty_quick_moves_end_in_the_state_of_the_last(tuner):
    tuner.reset()
    slider = tuner.slider("gamma")
    tuner.after(lambda: slider.evaluate(MANY))
    many, last = tuner.words, slider.input_value()
    tuner.reset()
    assert tuner.words != many
    tuner.after(lambda: slider.evaluate(TO, last))
    assert tuner.words == many


def test_the_fit_is_shown_before_the_other_maps_are_there(tuner):
    tuner.reset()
    tuner.page.evaluate(HEAR)
    tuner.press(tuner.slider("gamma"), "ArrowRight")
    first = tuner.page.evaluate("window.heard")
    assert "reference fit: landmark error" in first and "CP-Net: still computing" in first
    assert "CP-Net: landmark error" in tuner.words


def test_a_sulcus_is_named_where_the_pointer_is_and_held_out_by_a_click(tuner):
    tuner.reset()
    tuner.after(lambda: tuner.slider("gamma").evaluate(TO, 4))
    pair, problem = cortices("cortex"), example("cortex").problem
    spot = example("cortex").radius.to_image(problem.target[problem.curve == 1][2])  # in the second one's middle
    canvas, name = tuner.root.locator("canvas").nth(1), pair.names[1]
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    half = box["width"] * 150 / 320
    place = box["x"] + box["width"] / 2 + spot.real * half, box["y"] + box["height"] / 2 - spot.imag * half
    tuner.page.mouse.move(*place)
    tuner.root.locator(".qc-live-tip:visible").filter(has_text=name).wait_for()
    tuner.after(lambda: tuner.page.mouse.click(*place))
    button = tuner.root.get_by_role("button", name=re.compile(f"^{name} "))
    assert tuner.state()["held"] == [1] and button.get_attribute("aria-pressed") == "true"
    fitted, held = re.match(r"Fitted sulci ([\d.]+) mm off, held out \(blue\) ([\d.]+) mm;", tuner.said).groups()
    assert float(held) > 5 * float(fitted)
    tuner.after(button.click)
    assert "held" not in tuner.state() and "held out" not in tuner.said


def test_a_is_kept_and_wiped_beside_b(tuner):
    tuner.reset()
    assert tuner.root.get_by_role("slider", name="wipe").count() == 0
    tuner.after(lambda: tuner.slider("gamma").evaluate(TO, 2))
    tuner.click("Keep as A")
    tuner.after(lambda: tuner.slider("gamma").evaluate(TO, 5))
    lines = tuner.root.locator("table").first.locator("tr").all_inner_texts()
    cells = dict(line.split("\t", 1) for line in lines)
    assert cells["gamma"] == "100\t100,000" and cells["fitted"].startswith("0.9")
    seen = [tuner.pictures()[:2]]
    for key in ("End", "Home"):
        tuner.press(tuner.slider("wipe"), key)
        seen.append(tuner.pictures()[:2])
    assert all(len({*one}) == 3 for one in zip(*seen))
    tuner.root.get_by_role("button", name="Copy as command").click()
    assert "--gamma 100000 --no-features" in tuner.root.locator(".qc-live-copied").inner_text()


MET = {"problem": "neighbours", "targets": {"0": [0.25, 0.08], "1": [0.25, 0.08]}}
THE_FIT = "reference fit: landmark error"
NO_NETWORK = "the network is not used where γ is 1,000,000 times β or more"


@pytest.mark.parametrize("missing, state, says, also", [
    (None, MET, "coincide", "target landmarks 0 and 1 coincide at 0.25+0.08j"),
    (None, {"gamma": 1e5}, "CP-Net: no map", NO_NETWORK),
    ("cpnet.bin", None, "CP-Net: no map", THE_FIT),
    ("layers.wasm", None, "CP-Net: no map", "layers.wasm"),
    *((name, None, "cannot compute here", name) for name in ("problems.json", "worker.js", "kernels.wasm")),
])  # fmt: skip
def test_what_is_missing_or_refused_is_said(window, site_address, missing, state, says, also):
    page = window.new_page()
    if missing:
        page.route(f"**/_static/live/{missing}", lambda route: route.abort())
    page.goto(f"{site_address}live.html" + (f"#live-tuner={json.dumps(state)}" if state else ""))
    words = page.locator(f"{TUNER} :is([role=status], .qc-live-numbers):has-text('{says}')")
    words.wait_for(state="attached", timeout=60_000)
    assert also in words.text_content()
    if says == "cannot compute here":
        assert page.locator(TUNER).locator("img, canvas").count() == 1  # the picture stays
    page.close()


def test_a_guess_that_cannot_be_compared_says_why(window, site_address):
    page, state = window.new_page(), {"problem": "twist", "held": [0, 1]}
    page.goto(f"{site_address}live.html#live-tuner={json.dumps(state)}")
    tuner = page.locator(TUNER)
    tuner.get_by_role("button", name="curve 3").click()
    tuner.locator("[role=status]:has-text('all curves are held out')").wait_for()
    tuner.get_by_role("spinbutton").fill("0.5")
    tuner.get_by_role("button", name="Compare").click()
    tuner.locator(".qc-live-truth:has-text('Not compared: all curves are held out')").wait_for()
    page.close()


def test_a_map_that_fails_after_the_fit_says_why(window, site_address):
    page, planted = (window.new_page(), (SITE / "_static" / "live" / "solvers.js").read_text(encoding="utf-8"))
    line = "const network = await pass(bench, meshes.fine, request, stale);"
    planted = planted.replace(line, "throw new Error('a planted fault');")
    page.route("**/_static/live/solvers.js", lambda route: route.fulfill(body=planted, content_type="text/javascript"))
    page.goto(f"{site_address}live.html")
    numbers = page.locator(f"{TUNER} .qc-live-numbers:has-text('CP-Net: no map, a planted fault')")
    numbers.wait_for(state="attached", timeout=60_000)
    assert THE_FIT in numbers.text_content() and "still computing" not in numbers.text_content()
    assert page.locator(f"{TUNER} [role=status]").get_attribute("aria-busy") == "false"
    page.close()


def test_opened_as_a_file_it_says_why_and_shows_the_picture(window):
    page = window.new_page()
    page.goto((SITE / "live.html").as_uri())
    assert "opened as a file" in page.locator(f"{TUNER} [role=status]").inner_text()
    assert page.locator(f"{TUNER} img[alt]").count() == 1
    page.close()
