"""An explorable in a tab, on the site or in JupyterLab: its controls, pictures and read-outs."""

import json
import re

# The number of the answer that each explorable shows, and whether it is the newest, kept where a test can wait for it.
LISTEN = """window.answered = {};
document.addEventListener('qc-live-answer', event => {
  const {number, of} = event.detail;
  window.answered[event.target.dataset.page] = {number, newest: number === of};
}, true);"""
# A drag is over once the page has heard of its end; an answer from before that is none to it.
DROP = """() => { window.dropped = new Promise(done => addEventListener('pointerup', () => {
  window.answered = {};
  done();
}, {capture: true, once: true})); }"""
# Until the read-outs are whole: of some answers a part comes later.
ANSWERED = """([name, before]) => window.answered[name]?.newest && window.answered[name].number > before
  && document.querySelector(`.qc-live[data-page=${name}] [role=status]`).ariaBusy !== 'true'"""
# Pointer events where a point of the disk is on a canvas, whatever moves in the window meanwhile.
DRAG = """(canvas, points) => {
  canvas.setPointerCapture = () => {}; // there is no pointer to capture
  points.forEach(([x, y], k) => {
    const box = canvas.getBoundingClientRect(), radius = box.width * 150 / 320;
    const at = {clientX: box.left + box.width / 2 + x * radius, clientY: box.top + box.height / 2 - y * radius};
    const kinds = k ? ['pointermove'] : ['pointerdown'];
    if (k === points.length - 1) kinds.push('pointerup');
    for (const kind of kinds) canvas.dispatchEvent(new PointerEvent(kind, {...at, bubbles: true, pointerId: 1}));
  });
}"""


class Explorable:
    """An explorable in a tab: its controls, pictures and read-outs."""

    def __init__(self, tab, name, ready=""):
        """ready: words of the read-outs to wait for."""
        self.tab, self.page, self.name = tab, tab.page, name
        self.root = self.page.locator(f".qc-live[data-page={name}]")
        self.page.wait_for_selector(f".qc-live[data-page={name}][data-ready]", timeout=60_000)
        self.root.locator("details").evaluate_all("all => all.forEach(one => { one.open = true; })")
        place = f":is([role=status], .qc-live-numbers):has-text({json.dumps(ready)})"
        self.root.locator(place).first.wait_for(timeout=60_000)

    @property
    def said(self):
        return self.root.locator("[role=status]").inner_text()

    @property
    def words(self):
        """The read-outs, without the clock's; some have a sentence, and their numbers are folded."""
        numbers = self.root.locator(".qc-live-numbers").all_inner_texts()
        return re.sub(r"[\d.]+ ms", "", " ".join([self.said, *numbers]))

    def pictures(self):
        return self.root.locator("canvas").evaluate_all("all => all.map(canvas => canvas.toDataURL())")

    def after(self, act):
        """Do something and wait for the answer to it."""
        before = self.page.evaluate("name => window.answered[name]?.number ?? 0", self.name)
        act()
        self.page.wait_for_function(ANSWERED, arg=[self.name, before], timeout=60_000)

    def slider(self, name):
        return self.root.get_by_role("slider", name=name)

    def choose(self, name, value):
        self.after(lambda: self.root.get_by_role("combobox", name=name).select_option(value))

    def press(self, locator, key):
        locator.focus()
        self.after(lambda: self.page.keyboard.press(key))

    def click(self, button):
        self.after(lambda: self.root.get_by_role("button", name=button).click())

    def reset(self):
        self.click("Reset")

    def drag(self, canvas, *points):
        """Pointer events from point to point of the disk."""
        self.after(lambda: canvas.evaluate(DRAG, [list(point) for point in points]))

    def drag_with_the_mouse(self, canvas, start, end):
        canvas.scroll_into_view_if_needed()
        box, mouse = canvas.bounding_box(), self.page.mouse
        radius = box["width"] * 150 / 320
        here, there = (
            (box["x"] + box["width"] / 2 + x * radius, box["y"] + box["height"] / 2 - y * radius)
            for x, y in (start, end)
        )

        def move():
            self.page.evaluate(DROP)
            mouse.move(*here)
            mouse.down()
            mouse.move(*there, steps=4)
            mouse.up()
            self.page.evaluate("() => window.dropped")

        self.after(move)

    def state(self):
        """The state that the page's address carries, of what differs from the start."""
        found = re.search(r"#live-\w+=(.*)", self.page.evaluate("() => decodeURIComponent(location.hash)"))
        return json.loads(found[1]) if found else {}

    def download(self, name):
        with self.page.expect_download() as found:
            self.root.get_by_role("button", name=name).click()
        return found.value

    def data(self):
        """What 'Data (JSON)' holds."""
        return json.loads(self.download("Data").path().read_text())

    def guess(self, number="0.5", then=lambda: None):
        """What is said to a guess, if the reader does something before he compares."""
        said = self.root.locator(".qc-live-truth")
        said.evaluate("e => { e.textContent = ''; }")
        self.root.get_by_role("spinbutton").fill(number)
        then()
        self.root.get_by_role("button", name="Compare").click()
        self.root.locator(f".qc-live-truth:has-text('You said {number}; it is')").wait_for(timeout=60_000)
        return said.inner_text()

    # What a control does, seen from outside.

    def seen(self):
        return self.words, self.pictures()

    def moves_each_slider(self, act, silent=()):
        """`act` on each slider changes its value and the words; of those named `silent` the pictures alone."""
        for slider in self.root.get_by_role("slider").all():
            name = slider.evaluate("e => document.querySelector(`label[for='${e.id}']`).textContent")
            assert name, "a slider without a name"
            value, (words, pictures) = slider.input_value(), self.seen()
            act(slider)
            assert slider.input_value() != value, name
            assert self.pictures() != pictures if name in silent else self.words != words, name

    def by_key(self, slider):
        self.press(slider, "ArrowLeft" if slider.input_value() == slider.get_attribute("max") else "ArrowRight")

    def by_mouse(self, slider):
        share = 0.25 if slider.evaluate("e => (e.value - e.min) / (e.max - e.min)") > 0.6 else 0.75
        width = slider.bounding_box()["width"]
        self.after(lambda: slider.click(position={"x": share * width, "y": 8}))

    def takes_each_choice(self):
        for select in self.root.get_by_role("combobox").all():
            for value in select.locator("option").evaluate_all("all => all.map(option => option.value)")[::-1]:
                if value != select.input_value():
                    before = self.seen()
                    self.after(lambda select=select, value=value: select.select_option(value))
                    assert self.seen() != before, value

    def turns_each_switch(self):
        for switch in self.root.get_by_role("checkbox").all():
            for act in (lambda: self.press(switch, "Space"), lambda: self.after(switch.click)):  # noqa: B023
                on, before = switch.is_checked(), self.seen()
                act()
                assert switch.is_checked() != on and self.seen() != before
