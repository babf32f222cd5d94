"""The decks as a lecturer shows them, without a network: nothing is cut off, pictures are large,
formulas are set, explorables move."""

import pytest
from explorables import LISTEN, Explorable
from places import SITE
from view import NARROW, View, axe_findings

from book.builder.execute_pages import notebooks

# What is wrong with a slide of 1280 x 720, each with its number. A picture is large from 280 pixels on.
FAULTS = """async () => {
  const found = [], drawn = () => new Promise(requestAnimationFrame);
  for (Reveal.slide(0); ; Reveal.next()) {
    await drawn(); await drawn();
    const slide = Reveal.getCurrentSlide(), box = slide.getBoundingClientRect();
    const say = (what, e) => found.push(`${Reveal.getIndices().h + 1}: ${what} ${e.tagName} ${e.className}`);
    if (Math.max(box.height, slide.scrollHeight) > 720 || slide.scrollWidth > 1280) say("too large", slide);
    for (const e of slide.querySelectorAll("*:not(mjx-assistive-mml, mjx-assistive-mml *)")) {
      const { left, top, right, bottom, width } = e.getBoundingClientRect();
      if (!e.checkVisibility({ visibilityProperty: true }) || !width) continue;
      if (left < -1 || top < -1 || right > 1281 || bottom > 721) say("cut off", e);
      if (e.tagName === "MJX-CONTAINER" && e.scrollWidth > e.clientWidth + 1 && e.clientWidth) say("cut off", e);
    }
    for (const e of slide.querySelectorAll("img")) if (!e.complete || !e.naturalWidth) say("not loaded", e);
    const [picture, ...more] = slide.querySelectorAll("img, .qc-live");
    const main = picture?.querySelector("canvas") ?? picture;
    if (more.length || !main || main.getBoundingClientRect().height < 280) say("no large picture", picture ?? slide);
    const fragments = Reveal.availableFragments();
    if (Reveal.isLastSlide() && !fragments.next) return found;
  }
}"""
# The slide that is shown, and the one that the address names.
PLACE = "(() => [Reveal.getIndices().h, Number(location.hash.split('/')[1] ?? 0)])"
# A fault for slide 1, in its words or at its picture, and what is said to it.
PLANTED = {
    "too large": "h1.insertAdjacentHTML('afterend', '<p>word</p>'.repeat(30))",
    "cut off P": "h1.insertAdjacentHTML('afterend', `<p style='width: 1400px'>word</p>`)",
    "cut off MJX": "formula.style.cssText = 'display: block; overflow: hidden; width: 20px'",
    "no large picture": "img.style.flex = '0 0 100px'",
    "not loaded": "img.src = 'nowhere.png'; await new Promise(done => { img.onerror = done; })",
}
PLANT = """async (words) => {
  const h1 = document.querySelector('h1'), img = document.querySelector('.slides img');
  const formula = document.querySelector('mjx-container');
  document.querySelector('.slides section section').append(formula);
  await eval(`(async () => { ${words} })()`);
}"""


def opened(window, site_address, name, width):
    if not (SITE / f"{name}.html").exists():
        pytest.fail("build the site with `make book` first")
    view = View(window, site_address, f"{name}.html", width=width, script=LISTEN)
    if width > NARROW:
        view.page.set_viewport_size({"width": 1280, "height": 720})
    view.page.wait_for_selector(".qc-live[data-ready]", state="attached", timeout=60_000)
    return view


@pytest.fixture(
    scope="module", params=[pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in notebooks("decks")]
)
def deck(request, window, site_address):
    view = opened(window, site_address, request.param, 1280)
    yield view
    view.page.close()


def test_each_slide_is_seen_whole_with_one_large_picture(deck):
    assert deck.page.evaluate("() => Reveal.getTotalSlides()") >= 7
    assert deck.page.evaluate(FAULTS) == []


def test_formulas_are_typeset_and_pictures_described(deck):
    assert deck.page.locator("mjx-container").count() > 3 and deck.page.locator("mjx-merror").count() == 0
    assert "$" not in deck.page.locator(".slides").inner_text()
    assert deck.all(".slides img", "e.alt.length > 40") != [] and all(deck.all(".slides img", "e.alt.length > 40"))
    assert axe_findings(deck.page, deck.page.locator(".slides")) == []


def test_an_explorable_answers_and_keeps_its_keys_but_those_that_turn_the_page(deck):
    name = deck.page.locator(".qc-live").first.get_attribute("data-page")
    number = deck.page.evaluate(
        "e => [...document.querySelectorAll('.slides > section')].findIndex(s => s.querySelector('.qc-live'))"
    )
    deck.page.evaluate("number => Reveal.slide(number)", number)
    shown = Explorable(deck, name)
    slider, before = shown.root.get_by_role("slider").first, shown.seen()
    shown.by_key(slider)
    assert shown.seen() != before
    for key, there in (("ArrowRight", number), ("PageUp", number - 1), ("ArrowRight", number)):
        deck.page.keyboard.press(key)
        deck.page.wait_for_function(f"there => {PLACE}().every((one) => one === there)", arg=there)


def test_nothing_comes_from_elsewhere_and_nothing_complains(deck):
    assert deck.from_elsewhere() == [] and deck.complaints == []


@pytest.mark.parametrize("told", PLANTED)
def test_a_planted_fault_is_found(window, site_address, told):
    view = opened(window, site_address, "decks/opening", 1280)
    view.page.evaluate(PLANT, PLANTED[told])
    assert told in " ".join(found for found in view.page.evaluate(FAULTS) if found.startswith("1: "))
    view.page.close()


@pytest.mark.parametrize("name", notebooks("decks"))
def test_on_a_telephone_the_slides_stand_below_each_other(window, site_address, name):
    view = opened(window, site_address, name, NARROW)
    assert view.page.evaluate("() => document.documentElement.scrollWidth") <= NARROW
    wide = "e.getBoundingClientRect().width"
    assert all(0.8 * NARROW < width <= NARROW for width in view.all(".slides img", wide))
    seen = view.all(":is(h1, h2)", "e.checkVisibility()")
    assert len(seen) >= 7 and all(seen)
    assert view.from_elsewhere() == [] and view.complaints == []
    view.page.close()
