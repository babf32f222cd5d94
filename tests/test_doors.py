"""Rooms are doors: pages come in through them, what a room offers is used outside, and a mesh of the disk is one value
behind them."""

import ast
import importlib
import re

import nbformat
import pytest
from test_imports import PATHS, ROOT, imports_of, module_of, offenders
from test_rules import functions_of, tree_of

from book.builder.graded import IMPORTS
from book.builder.solutions import solutions_in

ROOMS = sorted(path.parent.name for path in (ROOT / "qclearn").glob("*/__init__.py"))
HOUSES = ("qclearn", "data_synth")
# Who takes a mesh of the disk as two arrays, room by room; all others take one value.
DOORS = {
    "plane.BeltramiDiskSolver.__init__",
    "plane.beltrami_coefficient",
    "plane.check_bijective",
    "plane.check_embedding",
    "plane.hat_gradients",
    "plane.jacobian",
    "plane.locate",
    "plane.signed_areas",
    "plane.solve_beltrami",
    "plane.solve_beltrami_disk",
    "plane.solve_beltrami_disk_log",
    "plane.stiffness",
    "plane.wirtinger",
    "registration.fit_landmarks",
    "registration.transfer",
    "nets.CoefficientNetwork.predict",
    "nets.DiskNetwork.solve",
    "pages.disk_plot",
    "pages.grid_plot",
}
MOST_DOORS = 20
# Who makes a `Disk` of the two arrays, or checks them for it, and does nothing else with them.
MAKERS = {"plane.check_mesh", "nets.disk_of", "nets._disk_of"}
FACES = re.compile(r"(?<!n_)(?:faces|triangles|simplices|connectivity)\b|(?<!n_)(?:faces|triangles)_")
PLANAR = re.compile(r"(?:z|w|f|u|L|points|disk|plane|planar|grid|image|xy|uv|zeta|flat)(?:_\w+)?$")


def offered(place):
    """The names that a package or a room lists."""
    return set(getattr(importlib.import_module(place), "__all__", ()))


# Pages


def code_of(notebook):
    """The code of a page's cells and of the solutions in its text."""
    for cell in notebook.cells:
        if cell.cell_type == "code":
            yield cell.source
        else:
            yield from (code for _, code, _ in solutions_in(cell.source))


def fault_of(name):
    """Why a page may not reach for a dotted name of this project; None if it may."""
    house, *inside = name.split(".")
    if house not in HOUSES or not inside or inside[-1].startswith("__"):
        return None
    room = house == "qclearn" and inside[0] in ROOMS
    place, behind = (f"{house}.{inside[0]}", inside[1:]) if room else (house, inside)
    if behind and behind[0] not in offered(place):
        return f"{name}: {place} does not offer {behind[0]}"
    return None


def aliases_of(trees):
    """Name in a page's code -> the dotted name of this project that it stands for."""
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield (alias.asname, alias.name) if alias.asname else (alias.name.split(".")[0],) * 2
        elif isinstance(node, ast.ImportFrom):
            yield from ((alias.asname or alias.name, f"{node.module}.{alias.name}") for alias in node.names)


def chain(node):
    """The dotted name that a chain of attributes spells, None where it begins with something else than a name."""
    parts = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else None


def imported(trees):
    """All dotted names that import statements name; a star is a name, too."""
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def reached(trees):
    """All dotted names of this project that code reaches for, by import and by attribute."""
    aliases = dict(aliases_of(trees))
    yield from imported(trees)
    for node in (node for tree in trees for node in ast.walk(tree)):
        first, _, rest = (chain(node) or "").partition(".") if isinstance(node, ast.Attribute) else ("", "", "")
        if aliases.get(first, "").split(".")[0] in HOUSES:
            yield f"{aliases[first]}.{rest}"


def wrong_ways(sources):
    """How code comes into the project other than through its doors, in words."""
    trees = [ast.parse(source) for source in sources]
    return sorted({fault for name in reached(trees) if (fault := fault_of(name))})


def notebooks():
    return {path.stem: nbformat.read(path, as_version=4) for path in sorted((ROOT / "book").glob("*.ipynb"))}


def test_pages_come_in_through_the_rooms_alone():
    found = {page: wrong_ways(code_of(notebook)) for page, notebook in notebooks().items()}
    assert found and {page: ways for page, ways in found.items() if ways} == {}


@pytest.mark.parametrize(
    "source, fault",
    [
        ("from qclearn.plane.disk import Disk", "qclearn.plane does not offer disk"),
        ("import qclearn.plane.disk", "qclearn.plane does not offer disk"),
        ("import qclearn.plane.disk as d", "qclearn.plane does not offer disk"),
        ("import qclearn as qc\nqc.plane.disk.Disk", "qclearn.plane does not offer disk"),
        ("from qclearn import plane\nplane.disk.unfold(1)", "qclearn.plane does not offer disk"),
        ("import qclearn.nets\nqclearn.nets.layers", "qclearn.nets does not offer layers"),
        ("from qclearn.nets import no_such_name", "qclearn.nets does not offer no_such_name"),
        ("from qclearn import no_such_name", "qclearn does not offer no_such_name"),
        ("import qclearn as qc\nqc.no_such_name", "qclearn does not offer no_such_name"),
        ("from data_synth.cortex import make_cortex", "data_synth does not offer cortex"),
        ("from qclearn.nets import *", "qclearn.nets does not offer *"),
    ],
)
def test_a_way_round_the_doors_is_found(source, fault):
    assert any(found.endswith(fault) for found in wrong_ways(source.split("\n")))


@pytest.mark.parametrize(
    "source",
    [
        "import numpy.linalg\nnumpy.linalg.norm",
        "import qclearn as qc\nqc.fit_landmarks(1).f.shape\nqc.__file__",
        "from qclearn.nets import load\nload('x').config.size",
        "import qclearn.nets as nets\nnets.train(1).losses",
        "from qclearn import nets",
    ],
)
def test_what_goes_through_a_door_is_allowed(source):
    assert wrong_ways(source.split("\n")) == []


# Rooms


def readers():
    """Pairs (room of the reader, dotted name that it reads) in the library, the generator, the tools, the pages and the
    students' notebooks."""
    tools = sorted((ROOT / "tools").rglob("*.py"))
    for path in (*PATHS, *tools):
        name = module_of(path).split(".")
        room = name[1] if name[0] == "qclearn" and len(name) > 1 else ""
        tree = tree_of(path)
        yield from ((room, name) for name, _ in imports_of(path))
        yield from ((room, name) for name in reached([tree]))
    for sources in (*map(code_of, notebooks().values()), [IMPORTS]):
        yield from (("", name) for name in reached([ast.parse(source) for source in sources]))


def unread(offers, read):
    """room.name of what rooms offer and nobody outside reads; offers: room -> names, read: as `readers` gives it."""
    outside = {
        (parts[1], part)
        for room, name in read
        if (parts := name.split("."))[0] == "qclearn" and len(parts) > 2 and parts[1] != room
        for part in parts[2:]
    }
    return sorted(f"{room}.{name}" for room, names in offers.items() for name in names if (room, name) not in outside)


def to_be_read(room):
    """The names of a room that need a reader of their own: no error, which is for whoever catches it, nothing that
    `qclearn` offers as well, and no method, which METHODS hands on."""
    place = importlib.import_module(f"qclearn.{room}")
    values = {name: getattr(place, name) for name in offered(place.__name__) - offered("qclearn")}
    errors = {name for name, value in values.items() if isinstance(value, type) and issubclass(value, Exception)}
    return set(values) - errors - set(getattr(place, "METHODS", ()))


def test_what_a_room_offers_has_a_reader_outside():
    offers = {room: to_be_read(room) for room in ROOMS}
    assert any(offers.values()) and unread(offers, list(readers())) == []


def test_errors_and_methods_need_no_reader():
    assert "BenchmarkError" not in to_be_read("benchmark") and "benchmark" in to_be_read("benchmark")
    assert "harmonic" not in to_be_read("methods") and "LandmarkSolver" in to_be_read("methods")


@pytest.mark.parametrize(
    "read, left",
    [
        ([("nets", "qclearn.plane.Disk"), ("", "qclearn.plane.disk.unfold")], []),
        ([("nets", "qclearn.plane.Disk"), ("plane", "qclearn.plane.disk.unfold")], ["plane.unfold"]),
        ([("nets", "data_synth.plane.Disk"), ("", "qclearn.nets.unfold")], ["plane.Disk", "plane.unfold"]),
    ],
)
def test_an_offer_that_nobody_takes_is_found(read, left):
    assert unread({"plane": {"Disk", "unfold"}}, read) == left


# A mesh of the disk


def apart(tree):
    """Functions that take a mesh of the plane as two arrays: faces, and points first or beside them."""
    for place, function in functions_of(tree):
        given = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        given = [parameter for parameter in given if parameter.arg not in ("self", "cls")]
        at = next((k for k, parameter in enumerate(given) if FACES.search(parameter.arg)), None)
        near = [] if at is None else [given[k] for k in {0, at - 1, at + 1} if 0 <= k < len(given) and k != at]
        if any(PLANAR.match(parameter.arg) or "Complex" in ast.dump(parameter) for parameter in near):
            yield place


def meshes_apart():
    """room.function of all that take a mesh of the disk apart; a student's answer to an exercise may."""
    ours = [path for path in PATHS if path.is_relative_to(ROOT / "qclearn") and path.parent.name != "tasks"]
    found = offenders(ours, lambda path: list(apart(tree_of(path))))
    return {".".join([*module.split(".")[1:2], place]) for module, places in found.items() for place in places}


def test_only_doors_take_a_mesh_of_the_disk_apart():
    assert sorted(meshes_apart() - DOORS - MAKERS) == []


def test_there_are_few_doors_and_all_of_them_are_there():
    assert len(DOORS) <= MOST_DOORS and sorted((DOORS | MAKERS) - meshes_apart()) == []


@pytest.mark.parametrize(
    "line, places",
    [
        ("def fit(z, faces): ...", ["fit"]),
        ("def fit(ax, w, triangles, values): ...", ["fit"]),
        ("def folded(faces, f): ...", ["folded"]),
        ("def length(points, faces): ...", ["length"]),
        ("def carry(values, z_from, faces_from): ...", ["carry"]),
        ("class A:\n  def __init__(self, z, name, faces): ...", ["A.__init__"]),
        ("def area(here: Complex[ndarray, ' V'], faces): ...", ["area"]),
        ("def fit(z, mu, n_faces): ...", []),
        ("def area(vertices, faces): ...", []),
        ("def fit(disk, mu): ...", []),
    ],
)
def test_a_mesh_apart_is_found(line, places):
    assert list(apart(ast.parse(line))) == places
