"""The decks as a lecturer shows them, without a network: nothing is cut off, formulas are set,
explorables move."""

import pytest
from explorables import LISTEN, Explorable
from places import SITE
from view import View, axe_findings

from book.builder import decks

# The height and the width of each slide, the explorable on it at its own size.
MEASURE = """async () => {
  const sizes = [];
  for (const section of document.querySelectorAll('.slides > section > section')) {
    Reveal.slide(sizes.length);
    await new Promise(requestAnimationFrame);
    await new Promise(requestAnimationFrame);
    sizes.push([section.scrollHeight, section.scrollWidth]);
  }
  return sizes;
}"""


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in decks.TITLES]
)
def deck(request, window, site_address):
    if not (SITE / "decks" / f"{request.param}.html").exists():
        pytest.fail("build the site with `make book` first")
    view = View(window, site_address, f"decks/{request.param}.html", script=LISTEN)
    view.page.set_viewport_size({"width": 1280, "height": 720})
    view.page.wait_for_selector(".qc-live[data-ready]", state="attached", timeout=60_000)
    yield view
    view.page.close()


def test_no_slide_is_larger_than_the_window(deck):
    sizes = enumerate(deck.page.evaluate(MEASURE), 1)
    assert [(number, *size) for number, size in sizes if size[0] > 720 or size[1] > 1280] == []


def test_formulas_are_typeset_and_pictures_described(deck):
    assert deck.page.locator("mjx-container").count() > 3 and deck.page.locator("mjx-merror").count() == 0
    assert deck.all(".slides img", "e.alt.length > 40") != [] and all(deck.all(".slides img", "e.alt.length > 40"))
    assert axe_findings(deck.page, deck.page.locator(".slides")) == []


def test_an_explorable_answers_and_keeps_its_keys(deck):
    name = deck.page.locator(".qc-live").first.get_attribute("data-page")
    number = deck.page.evaluate(
        "e => [...document.querySelectorAll('.slides > section')].findIndex(s => s.querySelector('.qc-live'))"
    )
    deck.page.evaluate("number => Reveal.slide(number)", number)
    shown = Explorable(deck, name)
    slider, before = shown.root.get_by_role("slider").first, shown.seen()
    shown.by_key(slider)
    assert shown.seen() != before and deck.page.evaluate("() => Reveal.getIndices().h") == number


def test_nothing_comes_from_elsewhere_and_nothing_complains(deck):
    assert deck.from_elsewhere() == [] and deck.complaints == []
