"""The built site as a reader without a network sees it. `make book` builds it first."""

import re
from collections import Counter
from urllib.parse import unquote, urldefrag

import nbformat
import pytest
import references
from expressions import expressions_in
from places import ROOT, SITE

PAGES = sorted(path.name for path in SITE.glob("*.html") if path.name not in ("genindex.html", "search.html"))
# Both come from the theme, with every page, and change nothing that a reader could notice.
HARMLESS = ("THEBE_JS_URL", "Got invalid theme mode")


class View:
    """A page opened in the browser, and everything that it asked for and complained about."""

    def __init__(self, browser, address, name):
        self.address, self.requests, self.complaints = address, [], []
        self.page = browser.new_page()
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("requestfailed", lambda request: self.complain(f"failed: {request.url}"))
        self.page.on("response", lambda answer: answer.status < 400 or self.complain(f"{answer.status}: {answer.url}"))
        self.page.on("console", lambda message: message.type != "error" or self.complain(message.text))
        self.page.on("pageerror", lambda error: self.complain(error.message))
        self.page.goto(address + name, wait_until="load")
        if self.page.locator("script[src*='mathjax']").count():
            self.page.wait_for_function("() => window.MathJax && MathJax.startup && MathJax.startup.promise")
            self.page.evaluate("() => MathJax.startup.promise")
        self.page.wait_for_load_state("networkidle")

    def complain(self, text):
        if not any(known in text for known in HARMLESS):
            self.complaints.append(text)

    def texts(self, selector, attribute):
        return self.page.eval_on_selector_all(selector, f"found => found.map(e => e.getAttribute('{attribute}'))")


# One view per page serves all the tests of that page: xdist keeps a page's tests on one worker by the group's name.
@pytest.fixture(scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in PAGES])
def view(request, browser, site_address):
    view = View(browser, site_address, request.param)
    yield view
    view.page.close()


def test_every_page_of_the_contents_is_built():
    expected = {f"{page}.html" for page in references.chapters()}
    assert expected, "book/_toc.yml names no page"
    assert expected <= set(PAGES), "pages are missing: build the site with `make book` first"


def test_every_notebook_is_in_the_contents():
    assert {path.stem for path in (ROOT / "book").glob("*.ipynb")} <= set(references.chapters())


@pytest.mark.parametrize("page", references.chapters())
def test_the_copies_count_as_the_book_does(page):
    """Numbers of equations, figures and theorems in references to another page are counted from the sources."""
    shown = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1]
    in_book = Counter(re.findall(r'<span class="eqno">(\([\d.]+\))', shown)) + Counter(
        text.strip() for text in re.findall(r'<span class="caption-number">([A-Z][^<]*)', shown)
    )
    counted = Counter(
        target.text
        for _, target in references.numbered(references.markdown_of(page), page, references.chapters()[page])
        if target.kind != "section"
    )
    assert counted == in_book


@pytest.mark.parametrize("path", sorted((ROOT / "book").glob("*.ipynb")), ids=lambda path: path.stem)
def test_the_notebook_offered_for_download_shows_its_results(path):
    assert f"_sources/{path.name}" in (SITE / f"{path.stem}.html").read_text(encoding="utf-8")
    cells = nbformat.read(SITE / "_sources" / path.name, as_version=4).cells
    asked = [expression for cell in cells if cell.cell_type == "markdown" for expression in expressions_in(cell.source)]
    answered = [
        entry["expression"]
        for cell in cells
        for entry in cell.metadata.get("user_expressions", [])
        if entry["result"]["status"] == "ok"
    ]
    shown = [
        cell
        for cell in cells
        if any("page-figure" in output.get("data", {}).get("text/html", "") for output in cell.get("outputs", []))
    ]
    assert answered == asked
    assert len(shown) == sum("show_figure(" in cell.source for cell in cells if cell.cell_type == "code")


def test_nothing_comes_from_elsewhere(view):
    elsewhere = [url for url in view.requests if not url.startswith((view.address, "data:", "blob:", "about:"))]
    assert elsewhere == []


def test_formulas_are_typeset(view):
    formulas = view.page.locator("article .math").count()
    assert view.page.locator("article mjx-container").count() >= formulas
    assert view.page.locator("mjx-merror").count() == 0


def test_every_figure_has_a_description(view):
    # ipywidgets.Image cannot carry a description; an ipywidgets.HTML with an <img alt="..."> can.
    silent = "article img:not([alt]), article img[alt=''], article iframe:not([title]), article iframe[title='']"
    assert view.page.eval_on_selector_all(silent, "found => found.map(e => e.outerHTML.slice(0, 200))") == []


def test_no_cell_shows_an_error_or_a_warning(view):
    assert view.page.locator("article .output.traceback, article .output.stderr").count() == 0
    assert "Traceback (most recent call last)" not in view.page.locator("article").inner_text()


def test_widgets_appear(view):
    if view.page.locator("script[type='application/vnd.jupyter.widget-view+json']").count():
        view.page.wait_for_selector(".jupyter-widgets", state="attached", timeout=20_000)
    assert view.page.locator(".jupyter-widgets-error-widget").count() == 0


def test_links_lead_somewhere(view):
    targets = view.page.eval_on_selector_all("article a[href], nav a[href]", "found => found.map(e => e.href)")
    for target in sorted({link for link in targets if link.startswith(view.address)}):
        path, fragment = urldefrag(target[len(view.address) :])
        file = SITE / unquote(path or "index.html")
        assert file.exists(), target
        if fragment and file.suffix == ".html":
            assert re.search(rf'id="{re.escape(unquote(fragment))}"', file.read_text()), target


def test_a_scene_is_drawn(view):
    if view.page.locator("iframe.scene").count() == 0:
        return
    poster = view.page.locator("button.scene-poster").first
    if poster.count():
        poster.click()
    scene = view.page.frame_locator("iframe.scene:not([hidden])").first
    scene.locator("canvas").first.wait_for(timeout=20_000)


# Last, so that it hears what the clicks above brought.
def test_nothing_fails_and_nothing_complains(view):
    assert view.complaints == []
