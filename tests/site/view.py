"""A page in a tab of a browser's window, and what is to be heard and found there."""

import contextlib
from pathlib import Path

from axe_playwright_python.base import AXE_SCRIPT
from places import REDIRECTS, SITE

PAGES = sorted(path.name for path in SITE.glob("*.html") if path.stem not in REDIRECTS)
WIDE, NARROW = 1280, 390  # a desk, a telephone
# Warnings of libraries that no setting of ours can answer; no error is among them.
REMARKS = (
    # A11y/assistive-mml sets it for a menu that is not vendored.
    'MathJax: Invalid option "menuOptions"',
    "strict mode: ",  # the widgets' checker of schemas, of its own schema
    # Of a renderer without a graphics card, where a test reads a scene's pixels.
    "GL Driver Message",
)
WIDGETS = "script[type='application/vnd.jupyter.widget-view+json']"
HANDLES = ".jupyter-widgets .noUi-handle"
LAYOUT = Path(__file__).with_name("layout.js").read_text(encoding="utf-8")
AXE = Path(__file__).with_name("axe.js").read_text(encoding="utf-8")
TYPESET = "() => MathJax.startup.promise.then(() => document.fonts.ready).then(() => null)"
PLANT = """html => (document.querySelector("article section") ?? document.querySelector("article"))
    .insertAdjacentHTML("beforeend", `<div id="planted">${html}</div>`)"""
NO_WEBGL = """const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function(kind, ...more) {
  return kind === 'webgl' ? null : get.call(this, kind, ...more);
};"""
DRAWN = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(null))))"


def axe_findings(frame, part=None, **rules):
    """What axe-core calls serious or critical in a page or a frame of it, or in a part of it alone."""
    frame.evaluate(AXE_SCRIPT)
    return frame.evaluate(AXE, [rules, part and part.element_handle()])


class Tab:
    """A page opened in a tab of a window; everything that it asked for and complained about."""

    heard = ("error",)  # which messages of the console are complaints

    def __init__(self, window, address, name, width=WIDE, script=None):
        """script: what the page runs before its own scripts."""
        self.address, self.requests, self.complaints, self.sizes = address, [], [], {}
        self.page = window.new_page()
        self.page.set_viewport_size({"width": width, "height": 900})
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("requestfailed", lambda request: self.complaints.append(f"failed: {request.url}"))
        self.page.on("response", self.receive)
        self.page.on("console", self.hear)
        self.page.on("pageerror", lambda error: self.complaints.append(error.message))
        if script:
            self.page.add_init_script(script)
        self.page.goto(address + name, wait_until="load")

    def hear(self, message):
        remark = message.type == "warning" and any(known in message.text for known in REMARKS)
        if message.type in self.heard and not remark:
            self.complaints.append(message.text)

    def receive(self, answer):
        """Keep how many bytes an answer has as it is sent, unpacked; what the window had already counts, too."""
        self.sizes[answer.url] = int(answer.headers.get("content-length", 0))
        if answer.status >= 400:
            self.complaints.append(f"{answer.status}: {answer.url}")

    def from_elsewhere(self):
        """What the page asked for that is not of its own server."""
        return [url for url in self.requests if not url.startswith((self.address, "data:", "blob:", "about:"))]


class View(Tab):
    """A page of the site, formulas typeset and widgets built; its console is to be empty."""

    heard = ("error", "warning")

    def __init__(self, window, address, name, width=WIDE, script=None):
        super().__init__(window, address, name, width, script)
        if self.page.locator("script[src*='mathjax']").count():
            self.page.wait_for_function("() => window.MathJax?.startup?.promise")
            self.page.evaluate(TYPESET)
        if self.page.locator(WIDGETS).count():
            self.page.wait_for_selector(HANDLES, state="attached", timeout=30_000)
            self.page.wait_for_load_state("networkidle")

    def resize(self, width):
        self.page.set_viewport_size({"width": width, "height": 900})
        self.page.evaluate(DRAWN)

    def layout_faults(self):
        return self.page.evaluate(LAYOUT)

    def axe_findings(self, **rules):
        return axe_findings(self.page, **rules)

    def all(self, selector, what):
        """`what`, an expression of JavaScript in e, of all elements that a selector finds."""
        return self.page.eval_on_selector_all(selector, f"found => found.map(e => {what})")

    @contextlib.contextmanager
    def planted(self, html):
        """The page with something more at its end."""
        self.page.evaluate(PLANT, html)
        yield
        self.page.evaluate("() => document.getElementById('planted').remove()")
