"""At the widths of a desk and of a telephone nothing is cut off, shrunk or bold that should not be: layout.js looks."""

from pathlib import Path

import pytest
from opened import PAGES, WIDTHS, opened

FAULTS = Path(__file__).with_name("layout.js").read_text(encoding="utf-8")
LONG = "a_1 + " * 80
# What is put into a page, and the sentence that this must bring.
PLANTED = {
    "code": ("<pre style='white-space: pre; overflow: auto'>" + "x = 1; " * 90 + "</pre>", "px cut off: pre"),
    "formula": (f"<div class='math' style='overflow: hidden; white-space: nowrap'>{LONG}</div>", "px cut off: div"),
    "hidden part": (
        "<div style='overflow: hidden'><img alt='' style='width: 1500px; max-width: none'></div>",
        "px cut off: img",
    ),
    "table": (
        f"<table style='white-space: nowrap; width: 1500px'><tr><td>{LONG}</td></tr></table>",
        "a table without a box",
    ),
    "wide page": ("<div style='width: 1500px'>wide</div>", "the page scrolls sideways"),
    "small print": ("<pre style='font-size: 9px'>small</pre>", "smaller than 12 px"),
    "shrunk": ("<pre style='transform: scale(0.5)'>shrunk</pre>", "shrunk: pre"),
    "bold caption": (
        "<figure><figcaption style='font-weight: 700 !important'>bold</figcaption></figure>",
        "bold: figcaption",
    ),
    "bold number": ("<p><span class='computed' style='font-weight: 700'>3.14</span></p>", "bold: span"),
}


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", PAGES)
def test_nothing_is_cut_off(browser, site_address, name, width):
    with opened(browser, site_address + name, width) as page:
        assert page.evaluate(FAULTS) == []


@pytest.fixture(scope="module", params=WIDTHS)
def plain_page(request, browser, site_address):
    with opened(browser, site_address + "errata.html", request.param) as page:
        yield page


@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(plain_page, planted):
    html, sentence = PLANTED[planted]
    plain_page.evaluate(
        """html => document.querySelector("article section").insertAdjacentHTML(
        "beforeend", `<div id="planted">${html}</div>`)""",
        html,
    )
    found = plain_page.evaluate(FAULTS)
    plain_page.evaluate("() => document.getElementById('planted').remove()")
    assert any(sentence in fault for fault in found), found


def test_formulas_are_broken_anew_when_the_window_changes(browser, site_address):
    lines = "() => document.querySelectorAll('article mjx-linebox').length"
    with opened(browser, site_address + "lbs.html", 1280) as page:
        wide = page.evaluate(lines)
        page.set_viewport_size({"width": 390, "height": 900})
        page.wait_for_function(f"wide => ({lines})() > wide", arg=wide)
        assert page.evaluate(FAULTS) == []
