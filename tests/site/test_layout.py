"""What test_site_pages.py relies on: layout.js finds each fault; and what is wider than a narrow window scrolls in a
box of its own."""

import pytest
from view import NARROW, WIDE, View

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
    "no shadow": (
        "<div class='pst-scrollable-table-container' tabindex='0'><p style='width: 1500px'>x</p></div>",
        "without a shadow: div",
    ),
    "no keyboard": (
        "<div class='wide-picture' style='overflow-x: auto'><p style='width: 1500px'>x</p></div>",
        "beyond the keyboard: div",
    ),
    "small picture": ("<figure><img alt='' style='width: 900px; max-width: 350px'></figure>", "only 350 px wide: img"),
    "bold caption": (
        "<figure><figcaption style='font-weight: 700 !important'>bold</figcaption></figure>",
        "bold: figcaption",
    ),
    "bold number": ("<p><span class='computed' style='font-weight: 700'>3.14</span></p>", "bold: span"),
}


@pytest.fixture(scope="module", params=[WIDE, NARROW])
def plain_view(request, window, site_address):
    view = View(window, site_address, "glossary.html", request.param)
    yield view
    view.page.close()


@pytest.mark.xdist_group("planted")
@pytest.mark.parametrize("planted", PLANTED)
def test_a_planted_fault_is_found(plain_view, planted):
    html, sentence = PLANTED[planted]
    with plain_view.planted(html):
        found = plain_view.layout_faults()
    assert any(sentence in fault for fault in found), found


def test_every_complaint_is_heard(window, site_address):
    view = View(window, site_address, "glossary.html")
    for kind in ("warn", "error", "log"):
        view.page.evaluate("kind => console[kind](`of ${kind}`)", kind)
    view.page.evaluate("() => void console.error('strict mode: an error')")
    with view.page.expect_event("pageerror"):
        view.page.evaluate("() => void setTimeout(() => { throw Error('thrown'); })")
    assert view.complaints == ["of warn", "of error", "strict mode: an error", "thrown"]
    view.page.close()


# On these pages are a formula, a table and a picture that are wider than a telephone's window, and none that is wider
# than a desk's.
@pytest.mark.parametrize(
    "name, box",
    [("lbs.html", "mjx-container"), ("files.html", ".pst-scrollable-table-container"), ("fit.html", ".wide-picture")],
)
def test_what_is_too_wide_scrolls_in_its_own_box(window, site_address, name, box):
    view = View(window, site_address, name)
    assert view.page.locator(f"{box}[role=region]").count() == 0
    view.resize(NARROW)
    scrolls = view.page.locator(f"{box}[role=region]").first
    assert scrolls.get_attribute("aria-label").endswith("that scrolls sideways")
    scrolls.focus()
    view.page.keyboard.press("ArrowRight")
    view.page.wait_for_function("box => box.scrollLeft > 0", arg=scrolls.element_handle())
    assert view.layout_faults() == []
    view.page.close()


def test_no_displayed_formula_is_broken(window, site_address):
    view = View(window, site_address, "lbs.html", NARROW)
    assert view.page.locator("mjx-container[display] mjx-linebox").count() == 0
    view.page.close()


def test_code_in_a_table_is_broken_at_its_signs(window, site_address):
    """No line of a table's code in a narrow window ends inside a word."""
    view = View(window, site_address, "files.html", NARROW)
    pieces = view.all("td code .pre", "[e.textContent, e.getClientRects().length]")
    assert [text for text, lines in pieces if lines > 1] == []
    view.page.close()


# test_site_pages.py comes to a narrow window by a change of size; a telephone opens the page in it.
@pytest.mark.parametrize("name", ["lbs.html", "freeboundary.html", "reference.html"])
def test_nothing_is_cut_off_where_a_page_is_opened_in_a_narrow_window(window, site_address, name):
    view = View(window, site_address, name, NARROW)
    assert view.layout_faults() == []
    view.page.close()
