"""What the preface says of the pages is so."""

import re
from pathlib import Path

import yaml
from prose import text_of

from book.builder.core import CORE

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


def test_the_tiles_are_the_core_path_in_its_order():
    (tiles,) = re.findall(r"^:::\{container\} tiles$.*?^:::$", INDEX, re.DOTALL | re.MULTILINE)
    assert tuple(re.findall(r"\]\((\w+)\.ipynb\)", tiles)) == CORE == tuple(re.findall(r"\{minutes\}`(\w+)`", tiles))


def test_the_errata_are_numbered():
    numbers = re.findall(r"^\(erratum-(\d+)\)=$", text_of(BOOK / "linebyline.ipynb"), re.MULTILINE)
    assert numbers == [str(n + 1) for n in range(len(numbers))]
