"""An explorable of a built page in the browser, and what its tests ask of it."""

import json
import re

import pytest

HARMLESS = ("THEBE_JS_URL", "Got invalid theme mode")
# The number of the answer that is shown, and whether it is the newest, kept where a test can wait for it.
LISTEN = """() => document.addEventListener('qc-live-answer', event => {
  const {number, of} = event.detail;
  window.answered = {number, newest: number === of};
}, true)"""


class View:
    """A page with an explorable in a window of its own: its controls, pictures, read-outs, requests and complaints."""

    def __init__(self, browser, address, page, name, width=1280):
        self.address, self.requests, self.complaints = address, [], []
        self.page = browser.new_page(viewport={"width": width, "height": 1000}, accept_downloads=True)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: message.type != "error" or self.complain(message.text))
        self.page.on("pageerror", lambda error: self.complain(error.message))
        self.page.on("response", lambda answer: answer.status < 400 or self.complain(f"{answer.status}: {answer.url}"))
        self.page.add_init_script(f"({LISTEN})()")
        self.root = self.page.locator(f".qc-live[data-page={name}]")
        self.page.goto(f"{address}{page}")
        self.page.wait_for_selector(f".qc-live[data-page={name}][data-ready]", timeout=60_000)
        self.page.wait_for_function("() => window.MathJax?.startup?.promise")  # which moves what stands below formulas
        self.page.evaluate("() => MathJax.startup.promise.then(() => null)")

    def complain(self, text):
        if not any(known in text for known in HARMLESS):
            self.complaints.append(text)

    @property
    def words(self):
        """The read-outs, without the clock's."""
        return re.sub(r"[\d.]+ ms", "", self.root.locator("[role=status]").inner_text())

    def number(self, pattern):
        """The number that the read-outs have behind some words."""
        found = re.search(pattern + r" (-?[\d.]+(?:e[+-]?\d+)?)", self.words)
        assert found, self.words
        return float(found[1].rstrip("."))

    def pictures(self):
        return self.root.locator("canvas").evaluate_all("all => all.map(canvas => canvas.toDataURL())")

    def after(self, act):
        """Do something and wait for the answer to it."""
        before = self.page.evaluate("() => window.answered?.number ?? 0")
        act()
        self.page.wait_for_function(
            "before => window.answered?.newest && window.answered.number > before", arg=before, timeout=60_000
        )

    def slider(self, name):
        return self.root.get_by_role("slider", name=name)

    def press(self, locator, key):
        locator.focus()
        self.after(lambda: self.page.keyboard.press(key))

    def place(self, canvas, x, y):
        """Where a point of the disk is in the window."""
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        radius = box["width"] * 150 / 320
        return box["x"] + box["width"] / 2 + x * radius, box["y"] + box["height"] / 2 - y * radius

    def drag(self, canvas, start, end):
        mouse, (here, there) = self.page.mouse, (self.place(canvas, *point) for point in (start, end))

        def move():
            mouse.move(*here)
            mouse.down()
            mouse.move(*there, steps=4)
            mouse.up()

        self.after(move)

    def state(self):
        """The state that the link carries, of what differs from the start."""
        found = re.search(r"#live-\w+=(.*)", self.page.evaluate("() => decodeURIComponent(location.hash)"))
        return json.loads(found[1]) if found else {}

    def download(self, name):
        with self.page.expect_download() as found:
            self.root.get_by_role("button", name=name).click()
        return found.value

    def from_elsewhere(self):
        return [url for url in self.requests if not url.startswith((self.address, "data:", "blob:", "about:"))]


def every_slider_moves(view, silent=()):
    """By keyboard and by mouse: the value and the words change; of those named `silent` the pictures alone."""
    for slider in view.root.get_by_role("slider").all():
        name = slider.evaluate("e => document.querySelector(`label[for='${e.id}']`).textContent")
        assert name, "a slider without a name"
        for act in ("keyboard", "mouse"):
            before, seen = slider.input_value(), (view.words, view.pictures())
            if act == "keyboard":
                view.press(slider, "ArrowRight")
            else:
                width = slider.bounding_box()["width"]
                view.after(lambda slider=slider, width=width: slider.click(position={"x": 0.75 * width, "y": 8}))
            assert slider.input_value() != before, (name, act)
            changed = view.words != seen[0], view.pictures() != seen[1]
            assert changed[1] if name in silent else changed[0], (name, act)


def every_choice_is_taken(view):
    for select in view.root.get_by_role("combobox").all():
        for value in select.locator("option").evaluate_all("all => all.map(option => option.value)")[::-1]:
            if value == select.input_value():
                continue
            before = view.words, view.pictures()
            view.after(lambda select=select, value=value: select.select_option(value))
            assert (view.words, view.pictures()) != before, value


def undo_and_reset_go_back(view, slider):
    view.after(lambda: view.root.get_by_role("button", name="Reset").click())
    start, words = view.state(), view.words
    view.press(slider, "End")
    assert view.state() != start and view.words != words
    view.after(lambda: view.root.get_by_role("button", name="Undo").click())
    assert view.state() == start == {}


def downloads_hold_the_state(view, name):
    data = json.loads(view.download("Data").path().read_text())
    assert data["page"] == name and data["state"] and data["answer"]
    assert view.download("Picture").path().read_bytes()[:4] == b"\x89PNG"
    return data


def the_guess_is_answered(view):
    view.root.get_by_role("spinbutton").fill("0.5")
    view.root.get_by_role("button", name="Compare").click()
    view.root.locator(".qc-live-truth:has-text('You said 0.5; it is')").wait_for(timeout=60_000)


def without_scripts(browser, address, page, name):
    """What stands in an explorable's place where scripts are off: its words, and whether the picture is there."""
    context = browser.new_context(java_script_enabled=False)
    try:
        page_ = context.new_page()
        page_.goto(address + page)
        root = page_.locator(f".qc-live[data-page={name}]")
        assert root.locator("img[alt]").count() == 1
        return root.locator("[role=status]").inner_text()
    finally:
        context.close()


def needs(site, page, name):
    file = site / page
    if not file.exists() or f'data-page="{name}"' not in file.read_text(encoding="utf-8"):
        pytest.fail(f"{page} has no explorable {name!r}: build the site with `make book` first")
