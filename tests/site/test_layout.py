"""What test_site_pages.py relies on finds a fault; and in a narrow window wide tables are stacked, and formulas
broken or in a box that scrolls."""

import pytest
from view import NARROW, View


def test_a_planted_fault_is_found(window, site_address):
    view = View(window, site_address, "glossary.html", NARROW)
    with view.planted("<p style='color: #ccc; background: #fff'>pale</p>"):
        assert any(finding.startswith("color-contrast") for finding in view.axe_findings())
    with view.planted("<div class='math' style='overflow: hidden; white-space: nowrap'>" + "a + " * 80 + "</div>"):
        assert any("px cut off: div" in fault for fault in view.layout_faults())
    view.page.close()


def test_a_formula_that_has_become_too_wide_scrolls_in_its_own_box(window, site_address):
    view = View(window, site_address, "lbs.html")
    assert view.page.locator("mjx-container[role=region]").count() == 0
    view.resize(NARROW)
    scrolls = view.page.locator("mjx-container[role=region]").first
    assert scrolls.get_attribute("aria-label").endswith("that scrolls sideways")
    scrolls.focus()
    view.page.keyboard.press("ArrowRight")
    view.page.wait_for_function("box => box.scrollLeft > 0", arg=scrolls.element_handle())
    assert view.layout_faults() == []
    view.page.close()


def test_code_in_a_table_is_broken_at_its_signs(window, site_address):
    """No line of a table's code in a narrow window ends inside a word."""
    view = View(window, site_address, "files.html", NARROW)
    pieces = view.all("td code .pre", "[e.textContent, e.getClientRects().length]")
    assert [text for text, lines in pieces if lines > 1] == []
    view.page.close()


def test_a_table_that_is_too_wide_has_its_rows_stacked_with_the_names_of_columns(window, site_address):
    view = View(window, site_address, "benchmark.html")
    assert view.page.locator(".stacked").count() == 0
    view.resize(NARROW)
    table = view.page.locator(".stacked").last
    assert table.is_visible() and table.locator("thead").is_hidden()
    named = table.locator("td .column-name").first
    assert named.is_visible() and named.inner_text() == table.locator("thead th").first.text_content().strip()
    assert view.layout_faults() == []
    view.page.close()


# test_site_pages.py comes to a narrow window by a change of size; a telephone opens the page in it.
@pytest.mark.parametrize("name", ["lbs.html", "reference.html"])
def test_a_page_that_is_opened_in_a_narrow_window_breaks_its_formulas_and_cuts_nothing(window, site_address, name):
    view = View(window, site_address, name, NARROW)
    assert view.layout_faults() == [] and view.page.locator("mjx-container[display][role=region]").count() == 0
    view.page.close()
