"""Doors: pages take from `qclearn`, from its rooms and from `data_synth`, never from a module inside; each name is
read."""

import ast
import importlib
import json
import re

import pytest
from test_imports import FLOORS, PACKAGES, ROOT, forbidden

PAGES = sorted((ROOT / "book").glob("*.ipynb"))
# Other readers of what is offered: programs and tests.
READERS = [*(ROOT / "tools").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]
DOORS = [*PACKAGES, *(f"qclearn.{room}" for room in FLOORS if room not in ("cli", "__main__"))]
TABLES = {door: getattr(importlib.import_module(door), "TABLE", {}) for door in DOORS}
# Until the page has one tuner: two classes have that name, and the door offers the explorable.
LATER = {("live", "qclearn.pages: explorables"), ("live", "qclearn.pages.widgets: Tuner")}


def cells_of(page):
    """The code of a page: cells, and solutions, which lie in fences of the text."""
    for cell in json.loads(page.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        yield from [text] if cell["cell_type"] == "code" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)


def taken(code):
    """Pairs (module, name) of what code takes of the two packages, by import or as `qc.name`; name None for a module
    that is imported whole."""
    try:
        tree = ast.parse(code)
    except SyntaxError:  # a sketch in a text, which nobody runs
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            pairs = [(node.module or "", alias.name) for alias in node.names]
        elif isinstance(node, ast.Import):
            pairs = [(alias.name, None) for alias in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            pairs = [({"qc": "qclearn"}.get(node.value.id, node.value.id), node.attr)]
        else:
            continue
        yield from (pair for pair in pairs if pair[0].split(".")[0] in PACKAGES)


def trespasses(code):
    """What code takes from a module inside a room, or of a room that does not offer it."""
    for module, name in taken(code):
        if module not in DOORS or (name and name not in importlib.import_module(module).__all__):
            yield f"{module}: {name}"


def test_pages_go_through_doors():
    found = {(page.stem, fault) for page in PAGES for code in cells_of(page) for fault in trespasses(code)}
    assert found == LATER


@pytest.mark.parametrize(
    "code",
    [
        "from qclearn.plane.beltrami import stiffness",
        "from qclearn.plane import stiffness",
        "from qclearn.pages import plot",
        "import qclearn.plane.beltrami",
        "from data_synth.cortex import Mechanics",
        "import qclearn as qc\nqc.plane.beltrami.stiffness(*mesh)",
    ],
)
def test_a_trespass_is_found(code):
    assert list(trespasses(code))


def test_a_door_is_no_trespass():
    code = "import qclearn as qc\nfrom qclearn.plane import Dirichlet\nqc.stiffness(*mesh)"
    assert list(trespasses(code)) == []


def test_every_room_offers_what_somebody_outside_reads():
    codes = [*(code for page in PAGES for code in cells_of(page)), *(path.read_text("utf-8") for path in READERS)]
    read = {pair for code in codes for pair in taken(code)}
    rooms = [door for door in DOORS if door != "qclearn"]
    offered = {(door, name) for door in rooms for names in TABLES[door].values() for name in names}
    assert offered - read == {("qclearn.pages", "Tuner")}


@pytest.mark.parametrize("door", [door for door in DOORS if TABLES[door]])
def test_a_door_opens_on_its_own_rooms_and_no_name_is_hidden_by_a_module(door):
    package = importlib.import_module(door)
    for module, names in TABLES[door].items():
        home = importlib.import_module(f"{door}.{module}")  # Python sets it as an attribute of its package
        assert all(getattr(package, name) is getattr(home, name) for name in names)
        assert forbidden(door, f"{door}.{module}", at_top=False) is None
    assert set(package.__all__) <= set(dir(package))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'qclearn' has no attribute 'nobody'"):
        importlib.import_module("qclearn").nobody  # noqa: B018
