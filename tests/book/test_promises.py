"""What the preface and the README say of the pages is so."""

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from prose import pages, prose, text_of

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"
INDEX = text_of(BOOK / "index.ipynb")
CONTENTS = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))
PARTS = {part["caption"]: [chapter["file"] for chapter in part["chapters"]] for part in CONTENTS["parts"]}


def page_links(text):
    return set(re.findall(r"\]\((\w+)\.(?:ipynb|md)\)", text))


def test_the_route_names_every_page():
    (route,) = re.findall(r"^\| part \| pages \|$.*?\n\n", INDEX, re.DOTALL | re.MULTILINE)
    assert page_links(route) == {page for chapters in PARTS.values() for page in chapters}


def read_or_quoted():
    """Pages before the part on networks that read a kept file, or quote figures that no cell computes."""
    literals = tomllib.loads((ROOT / "tests/book/literals.toml").read_text(encoding="utf-8"))
    quoting = {
        page for page, reasons in literals.items() if any(r.startswith("quoted: tools") for r in reasons.values())
    }
    early = {page for part in ("Before you start", "Maps", "Registration") for page in PARTS[part]}
    reading = {path.stem for path in BOOK.glob("*.ipynb") if "read_measured(" in path.read_text(encoding="utf-8")}
    return early & (reading | quoting)


def test_the_preface_names_the_pages_that_read_their_numbers():
    (promise,) = re.findall(r"\*\*What is computed where\.\*\*(.*?)The part \*Networks\*", INDEX, re.DOTALL)
    assert page_links(promise) == read_or_quoted()
    assert "Five pages" in promise and len(read_or_quoted()) == 5


def test_the_readme_counts_the_surfaces_of_the_kept_benchmark():
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    (count,) = re.findall(r"on the same (\d+) synthetic surfaces", readme)
    kept = json.loads((ROOT / "qclearn/benchmark/results/benchmark.json").read_text(encoding="utf-8"))
    assert int(count) == kept["settings"]["subjects"]


def test_the_errata_are_counted():
    numbers = re.findall(r"^\(erratum-(\d+)\)=$", text_of(BOOK / "errata.md"), re.MULTILINE)
    assert numbers == [str(n + 1) for n in range(len(numbers))]
    words = {12: "twelve", 13: "thirteen"}[len(numbers)]
    assert f"the 'Errata', {words} of them" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"{words.capitalize()} places" in text_of(BOOK / "errata.md")


def figure_families():
    """First word of figures' names -> pages that have such figures."""
    families = {}
    for path in pages(BOOK):
        for word in re.findall(r"^:name: fig-(\w+)", text_of(path), re.MULTILINE):
            families.setdefault(word, set()).add(path.stem)
    return families


# Chapters of several pages, whose figures have one word.
SHARED = {"reg": {"registration", "fit", "baseline"}, "cp": {"cpnet", "cpnetlearned"}}


def test_figures_are_named_after_their_own_page():
    families = figure_families()
    assert len(families) > 15
    assert {word: found for word, found in families.items() if len(found) > 1 and found != SHARED.get(word)} == {}


NOT_KEPT = ["on another device", "FFT library is at hand", "one symbol, one meaning"]
NOT_PRINTED = ["network as printed", "networks as printed", "DBS-Net as printed", "printed network"]  # they are mended


@pytest.mark.parametrize("claim", NOT_KEPT + NOT_PRINTED)
def test_what_the_pages_do_not_keep_is_promised_nowhere(claim):
    found = [path.stem for path in pages(BOOK) if claim.lower() in prose(text_of(path)).lower()]
    assert found == []
