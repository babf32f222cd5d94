"""The files of the built site: complete, and numbered as the copies are. `make book` builds it first."""

import html
import re

import pytest
from places import REDIRECTS, ROOT, SITE

from book.builder import core, references

LINK = re.compile(r"(?<!!)\[([^\[\]$`{]+)\]\([#\w.-]+\)")


def test_every_page_of_the_contents_is_built():
    expected = {f"{page}.html" for page in references.chapters()}
    assert expected, "book/_toc.yml names no page"
    missing = expected - {path.name for path in SITE.glob("*.html")}
    assert not missing, "build the site with `make book` first"


def test_every_notebook_is_in_the_contents():
    assert {path.stem for path in (ROOT / "book").glob("*.ipynb")} <= set(references.chapters())


def test_the_address_of_a_page_that_went_into_another_leads_there():
    for old, target in REDIRECTS.items():
        assert (SITE / target).exists()
        assert f'"{target}"' in (SITE / f"{old}.html").read_text(encoding="utf-8")


def test_there_are_widgets():
    assert "application/vnd.jupyter.widget-view+json" in (SITE / "fourier.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", references.chapters())
def test_a_link_keeps_its_words(page):
    """Sphinx would put the number of an equation in their place, and sentences would lose words."""
    article = (SITE / f"{page}.html").read_text(encoding="utf-8").split("<article", 1)[1]
    links = re.findall(r"<a [^>]*>(.*?)</a>", article, re.DOTALL)
    shown = {" ".join(html.unescape(re.sub("<[^>]*>", "", link)).split()) for link in links}
    asked = LINK.findall(references.CODE.sub("", references.markdown_of(page)))
    words = (" ".join(re.sub("[*_]", "", each).split()) for each in asked)
    assert {each.replace("'", "\N{RIGHT SINGLE QUOTATION MARK}") for each in words} - shown == set()


@pytest.mark.parametrize("page, onward", [*zip(core.CORE, (*core.CORE[1:], "ownbrain"))])
def test_a_core_page_says_where_it_stands_and_leads_on(page, onward):
    text = (SITE / f"{page}.html").read_text(encoding="utf-8")
    strips = re.findall(r'<p class="core-strip">.*?</p>', text, re.DOTALL)
    assert len(strips) == 2 and all(f'href="{onward}.html"' in strip for strip in strips)
    assert re.search(rf'href="{onward}.html">[^<]*\N{{BLACK STAR}}', text) or onward == "ownbrain"


@pytest.mark.parametrize("path", sorted((ROOT / "book").glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_page_offers_its_notebook(path):
    assert f"_sources/{path.name}" in (SITE / f"{path.stem}.html").read_text(encoding="utf-8")


def test_the_explorables_weigh_at_most_six_megabytes_in_all():
    files = [path for path in (SITE / "_static" / "live").rglob("*") if path.is_file()]
    assert files and sum(path.stat().st_size for path in files) < 6e6
