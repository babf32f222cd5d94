"""Rules of the house that a program can check: few parameters, what belongs together as one value, short modules, and a
budget of lines."""

import ast
import importlib

import pytest
from test_imports import PACKAGES, PATHS, ROOT, offenders

MOST_PARAMETERS, MOST_LINES = 7, 300
# A public door is what a package lists, a network's three calls, and a command.
LISTED = ["qclearn", "qclearn.benchmark", "qclearn.methods", "qclearn.nets", "qclearn.pages", "data_synth"]
CALLS = {"detect", "predict", "solve"}
# What goes together as one value: the weights of the loss, and a disk mesh with landmarks and targets.
APART = [{"alpha", "beta", "gamma"}, {"z", "faces", "p", "q"}, {"z", "faces", "moving", "target"}]
DOORS = {name for package in LISTED for name in importlib.import_module(package).__all__}
# The most lines that a room may have. Who raises a number says why in the commit; a new room brings one of its own.
BUDGET = {
    "qclearn/plane": 1910,
    "qclearn/surfaces": 1032,
    "qclearn/files": 1939,
    "qclearn/registration": 3995,
    "qclearn/group": 646,
    "qclearn/nets": 2986,
    "qclearn/methods": 885,
    "qclearn/benchmark": 1578,
    "qclearn/pages": 2550,
    "qclearn/cli, and what stands beside the rooms": 1321,
    "data_synth": 2456,
    "tools": 5341,
    "qclearn/exercises": 3551,
    "browser": 6564,
    "qclearn/reports": 1094,
}


def functions_of(tree, place=""):
    """Pairs (dotted place, definition) of all functions, those in classes and in functions too."""
    for node in ast.iter_child_nodes(tree):
        named = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
        inner = f"{place}.{node.name}".lstrip(".") if named else place
        if named and not isinstance(node, ast.ClassDef):
            yield inner, node
        yield from functions_of(node, inner)


def parameters(function):
    """Names of all parameters but self, cls and torch's ctx; stars stand for one each."""
    given = function.args
    every = [*given.posonlyargs, *given.args, given.vararg, *given.kwonlyargs, given.kwarg]
    return [
        parameter.arg for parameter in every if parameter is not None and parameter.arg not in ("self", "cls", "ctx")
    ]


def is_door(place, function):
    """Whether a function may take what others hand on as one value; numba's kernels know arrays alone."""
    decorators = {
        node.attr for line in function.decorator_list for node in ast.walk(line) if isinstance(node, ast.Attribute)
    }
    kernel = any(isinstance(line, ast.Name) and line.id == "compiled" for line in function.decorator_list)
    return kernel or place in DOORS or "command" in decorators or ("." in place and function.name in CALLS)


def faults(tree):
    """What the functions of a module take too much of, in words."""
    for place, function in functions_of(tree):
        names = parameters(function)
        if is_door(place, function):
            continue
        if len(names) > MOST_PARAMETERS:
            yield f"{place}, line {function.lineno}: {len(names)} parameters, at most {MOST_PARAMETERS}"
        for together in APART:
            if together <= set(names):
                yield f"{place}, line {function.lineno}: {', '.join(sorted(together))} apart; hand on one value"


def borrowed(tree):
    """Names with an underscore that a module takes from another one."""
    names = [alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names]
    return [name for name in names if name.startswith("_") and not name.startswith("__")]


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def lines_of(path):
    return len(path.read_text(encoding="utf-8").splitlines())


def test_what_belongs_together_is_one_value_and_parameters_are_few():
    assert offenders(PATHS, lambda path: list(faults(tree_of(path)))) == {}


def test_a_module_is_short():
    assert offenders(PATHS, lambda path: lines_of(path) > MOST_LINES and lines_of(path)) == {}


def test_a_name_with_an_underscore_stays_in_its_file():
    assert offenders(PATHS, lambda path: borrowed(tree_of(path))) == {}


def test_a_borrowed_name_is_found():
    assert borrowed(ast.parse("from .fit import __doc__, _step, fit")) == ["_step"]


@pytest.mark.parametrize(
    "line, fault",
    [
        ("def loss(mu, alpha, beta, gamma): ...", "loss, line 1: alpha, beta, gamma apart; hand on one value"),
        ("def fit(z, faces, p, q): ...", "fit, line 1: faces, p, q, z apart; hand on one value"),
        ("def fit(z, *, faces, moving, target): ...", "fit, line 1: faces, moving, target, z apart; hand on one value"),
        ("def many(a, b, c, d, e, f, g, *h): ...", "many, line 1: 8 parameters, at most 7"),
        (
            "class A:\n  def step(self, alpha, beta, gamma): ...",
            "A.step, line 2: alpha, beta, gamma apart; hand on one value",
        ),
        (
            "def fit_landmarks():\n  def fit_landmarks(a, b, c, d, e, f, g, h): ...",
            "fit_landmarks.fit_landmarks, line 2: 8 p",
        ),
        ("def predict(alpha, beta, gamma): ...", "predict, line 1: alpha, beta, gamma apart; hand on one value"),
    ],
)
def test_the_rule_names_who_breaks_it(line, fault):
    (found,) = faults(ast.parse(line))
    assert found.startswith(fault)


@pytest.mark.parametrize(
    "line",
    [
        "def fit_landmarks(z, faces, moving, target, alpha, beta, gamma): ...",
        "class A:\n  def predict(self, z, faces, moving, target, alpha, beta, gamma): ...",
        "@cli.command('open')\ndef open_command(a, b, c, d, e, f, g, h): ...",
        "class A:\n  def step(self, a, b, c, d, e, f, g): ...",
        "def fit(problem, weights): ...",
        "@compiled\ndef grow(a, b, c, d, e, f, g, h): ...",
    ],
)
def test_the_rule_allows_public_doors_and_single_values(line):
    assert list(faults(ast.parse(line))) == []


def room_in_budget(path):
    """The name of the room that a file's lines count in."""
    parts = path.relative_to(ROOT).parts
    if parts[0] == "book":
        return "browser"
    if parts[0] != "qclearn":
        return parts[0]
    beside = len(parts) == 2 or parts[1] == "cli"
    return "qclearn/cli, and what stands beside the rooms" if beside else f"qclearn/{parts[1]}"


def totals():
    """Lines by room: of the packages, the tools, and the modules that run in a browser."""
    found = {}
    live = ROOT / "book" / "_assets" / "live"
    looks = [path for kind in ("js", "css", "html") for path in (ROOT / "qclearn").rglob(f"reports/*.{kind}")]
    for path in (*PATHS, *(ROOT / "tools").rglob("*.py"), *live.glob("*.js"), *live.glob("*.ts"), *looks):
        found[room_in_budget(path)] = found.get(room_in_budget(path), 0) + lines_of(path)
    return found


def overruns(found, budget):
    """What stands against a budget, in words: rooms with too many lines, without a number, or that are gone."""
    for room, lines in found.items():
        if room not in budget:
            yield f"{room}: {lines} lines, and no number in BUDGET"
        elif lines > budget[room]:
            yield f"{room}: {lines} lines, at most {budget[room]}"
    yield from (f"{room}: a number in BUDGET, and no lines" for room in budget if room not in found)


def test_no_room_has_more_lines_than_its_budget():
    assert list(overruns(totals(), BUDGET)) == []


@pytest.mark.parametrize(
    "found, fault",
    [
        ({"plane": 11, "nets": 5}, "plane: 11 lines, at most 10"),
        ({"plane": 10, "nets": 5, "exercises": 1}, "exercises: 1 lines, and no number in BUDGET"),
        ({"plane": 10}, "nets: a number in BUDGET, and no lines"),
    ],
)
def test_an_overrun_is_named_with_both_numbers(found, fault):
    assert list(overruns(found, {"plane": 10, "nets": 5})) == [fault]


def test_every_package_counts():
    assert {room.split("/")[0] for room in totals()} == {*PACKAGES, "tools", "browser"}
