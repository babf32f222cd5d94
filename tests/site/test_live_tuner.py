"""The registration tuner, on its page and in JupyterLab: dragged landmarks, quick moves, what is
missing."""

import json
from urllib.parse import unquote

import pytest
from explorables import InJupyterLab, OnTheSite
from places import SITE
from view import WIDE

from qcbook.liveproblems import example

ASSETS = "**/_static/live/"
ROOT = ".qc-live[data-page=tuner]"
READY = "CP-Net: landmark error"
MANY = """e => { for (let k = 0; k < 50; k++) {
    e.value = 2 + k / 20;
    e.dispatchEvent(new Event(k < 49 ? 'input' : 'change'));
} }"""
HEAR = """() => addEventListener('qc-live-answer', event => {
    window.heard = event.target.querySelector('.qc-live-numbers').textContent;
}, {once: true})"""
ONE = "(e, value) => { e.value = value; e.dispatchEvent(new Event('change')); }"


class TestOnTheSite(OnTheSite):
    page, name, slider, ready = "live.html", "tuner", "beta", READY

    def get_ready_for_choices(self, shown):
        """At the start, unfitted, one refinement of CP-Net's does no more than two."""
        shown.after(lambda: shown.slider("gamma").evaluate(ONE, 3))

    def test_landmarks_and_targets_are_dragged_and_moved_by_keys(self, shown):
        shown.reset()
        shown.choose("problem", "twist")
        problem, words = example("twist").problem, shown.words
        map_, *_, moving = shown.root.locator("canvas").all()
        for canvas, name, points in ((map_, "targets", problem.target), (moving, "starts", problem.moving)):
            shown.drag_with_the_mouse(canvas, (points[4].real, points[4].imag), (points[4].real + 0.1, points[4].imag))
            ((place, moved),) = shown.state()[name].items()
            assert place == "4" and abs(complex(*moved) - points[4] - 0.1) < 0.02
            shown.press(canvas, "PageDown")
            shown.press(canvas, "ArrowUp")
            assert abs(complex(*shown.state()[name]["5"]) - points[5] - 0.01j) < 1e-6
        assert shown.words != words

    @pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
    def test_picture_sliders_and_sentence_are_on_the_first_screen(self, shown, size):
        shown.reset()
        assert shown.said.startswith("Sulci ") and " mm off, distortion " in shown.said and "no folds" in shown.said
        shown.page.set_viewport_size(dict(zip(("width", "height"), size)))
        parts = [shown.root.locator("canvas").first, shown.root.locator(".qc-live-status")]
        parts += [shown.slider(name) for name in ("alpha", "beta", "gamma")]
        shown.page.evaluate("scrollTo(0, 0)")
        lowest = max(box["y"] + box["height"] for box in (part.bounding_box() for part in parts))
        shown.tab.resize(WIDE)
        assert lowest <= size[1]

    def test_fifty_quick_moves_end_in_the_state_of_the_last(self, shown):
        shown.reset()
        slider = shown.slider("gamma")
        shown.after(lambda: slider.evaluate(MANY))
        many, last = shown.words, slider.input_value()
        shown.reset()
        assert shown.words != many
        shown.after(lambda: slider.evaluate(ONE, last))
        assert shown.words == many

    def test_the_fit_is_shown_before_the_other_maps_are_there(self, shown):
        shown.reset()
        shown.page.evaluate(HEAR)
        shown.press(shown.slider("gamma"), "ArrowRight")
        first = shown.page.evaluate("window.heard")
        assert "reference fit: landmark error" in first and "CP-Net: still computing" in first
        assert "CP-Net: landmark error" in shown.words

    def test_it_leads_to_the_surface_where_there_is_one(self, shown):
        shown.reset()
        shown.press(shown.slider("beta"), "ArrowRight")
        link = shown.root.get_by_role("link", name="See it on the surface")
        page, state = unquote(link.get_attribute("href")).split("#live-sulci=")
        assert page == "weights.html" and json.loads(state)["beta"] == shown.state()["beta"]
        shown.choose("problem", "twist")
        assert not link.is_visible()

    # What the page says where something is missing or wrong.

    def said(self, window, site_address, says, state=None, missing=None):
        """The read-outs once they say something, and the number of pictures, of the page without a
        file."""
        page = window.new_page()
        if missing:
            page.route(ASSETS + missing, lambda route: route.abort())
        page.goto(f"{site_address}{self.page}" + (f"#live-tuner={json.dumps(state)}" if state else ""))
        words = page.locator(f"{ROOT} :is([role=status], .qc-live-numbers):has-text('{says}')")
        words.wait_for(state="attached", timeout=60_000)
        found = words.text_content(), page.locator(ROOT).locator("img, canvas").count()
        page.close()
        return found

    def test_points_that_meet_are_refused_in_the_librarys_words(self, window, site_address):
        state = {"problem": "neighbours", "targets": {"0": [0.25, 0.08], "1": [0.25, 0.08]}}
        words, _ = self.said(window, site_address, "coincide", state)
        assert "target landmarks 0 and 1 coincide at 0.25+0.08j" in words

    def test_opened_as_a_file_it_says_why_and_shows_the_picture(self, window):
        page = window.new_page()
        page.goto((SITE / self.page).as_uri())
        assert "opened as a file" in page.locator(f"{ROOT} [role=status]").inner_text()
        assert page.locator(f"{ROOT} img[alt]").count() == 1
        page.close()

    def test_without_its_weights_the_network_is_missing_and_the_fit_stays(self, window, site_address):
        words, _ = self.said(window, site_address, "CP-Net: no map", missing="cpnet.bin")
        assert "reference fit: landmark error" in words

    def test_where_the_library_uses_no_network_none_is_shown(self, window, site_address):
        words, _ = self.said(window, site_address, "CP-Net: no map", {"gamma": 1e5})
        assert "the network is not used where γ is 1,000,000 times β or more" in words
        assert "L_CP of CP-Net" not in words and "L_CP of harmonic map" in words

    def test_the_file_that_is_missing_is_named(self, window, site_address):
        words, _ = self.said(window, site_address, "CP-Net: no map", missing="layers.wasm")
        assert "layers.wasm" in words and "cpnet.bin" not in words

    def test_a_map_that_fails_after_the_fit_says_why(self, window, site_address):
        page, planted = (window.new_page(), (SITE / "_static" / "live" / "solvers.js").read_text(encoding="utf-8"))
        planted = planted.replace("const harmonic = springs(mesh, request);", "throw new Error('a planted fault');")
        page.route(ASSETS + "solvers.js", lambda route: route.fulfill(body=planted, content_type="text/javascript"))
        page.goto(site_address + self.page)
        numbers = page.locator(f"{ROOT} .qc-live-numbers:has-text('harmonic map: no map, a planted fault')")
        numbers.wait_for(state="attached", timeout=60_000)
        said = numbers.text_content()
        assert "reference fit: landmark error" in said and "still computing" not in said
        assert page.locator(f"{ROOT} [role=status]").get_attribute("aria-busy") == "false"
        page.close()

    @pytest.mark.parametrize("name", ["problems.json", "worker.js", "kernels.wasm", "explore_tuner.js"])
    def test_a_file_that_is_missing_is_named_and_the_picture_stays(self, window, site_address, name):
        _, pictures = self.said(window, site_address, "cannot compute here", missing=name)
        assert pictures == 1


class TestInJupyterLab(InJupyterLab):
    # Each fit stops by a rule of its own.
    name, live, ready, gap = "tuner", "Tuner()", READY, 1e-2
    sets = {"problem": "twist", "alpha": 10.0, "gamma": 5e3}  # noqa: RUF012

    def test_the_map_is_pythons(self, shown):
        shown.tab.until("tuner.map.shape == (1729,) and abs(tuner.map).max() < 1 + 1e-9")

    def test_a_target_is_dragged(self, shown):
        shown.reset()
        shown.choose("problem", "twist")
        point = example("twist").problem.target[4]
        canvas = shown.root.locator("canvas").first
        shown.drag(canvas, (point.real, point.imag), (point.real + 0.05, point.imag), (point.real + 0.1, point.imag))
        shown.tab.until(f"abs(complex(*tuner.state['targets'].get('4', (9, 9))) - {point + 0.1}) < 1e-3")
