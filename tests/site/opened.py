"""A page of the site in the browser at a given width, formulas typeset: what the checks of layout and access share."""

import contextlib

from places import SITE

PAGES = sorted(path.name for path in SITE.glob("*.html"))
WIDTHS = (1280, 390)


@contextlib.contextmanager
def opened(browser, address, width, dark=False):
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light")
    try:
        page.goto(address, wait_until="load")
        if page.locator("script[src*='mathjax']").count():
            page.wait_for_function("() => window.MathJax?.startup?.promise")
            page.evaluate("() => MathJax.startup.promise.then(() => document.fonts.ready).then(() => null)")
        yield page
    finally:
        page.close()
