"""The paper line by line: every line of book/paper.toml leads to a function, a test, a place and a kept number."""

import ast
import json
import re
import subprocess
import sys
from functools import cache, reduce
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest
from prose import typed_results

from book.builder import references
from book.builder.references import markdown_of
from qcbook import chain_seconds, paper_lines, paper_table, paperlines, saving
from qclearn.cli import main

ROOT = Path(__file__).resolve().parents[2]
LINES = paper_lines(ROOT / "book" / "paper.toml")
FIELDS = ("printed", "place", "function", "test", "erratum", "verdict", "rule", "changed", "compute", "command")
COUNTS = {"equation": 31, "figure": 13, "table": 1, "contribution": 5, "erratum": 12}
# A word of each numbered equation, in the order of print: two that were exchanged are found by it.
WORDS = """Beltrami|expansion|given map|Jacobian|four real|pairs of real|divergence form|affine|two edges|pairs of (6)
edges of its image|sums over the corners|the weights $A_i$|sums over its triangles|first coordinate|second coordinate
Fourier transform of each|inverse|LD-Net's loss|circle to the square|products|own row|neighbour
absolute values|one over each angle
$\\eta$|activation|mean over the faces of $|squared gradient|distance of the landmarks|three terms"""
WORDS = re.split(r"[|\n]", WORDS)
CHAINS = "harmonic 0.1", "harmonic 5"
STAGES = {
    chain: ["disk maps", "landmarks", "CP-Net", "resampling", solver, "certificate", "correction"]
    for chain, solver in (("networks", "DBS-Net"), ("conjugate gradients", "conjugate gradients"))
}
STAGES["exact solver"] = ["disk maps", "landmarks", "CP-Net", "exact solver"]
STAGES |= {chain: ["disk maps", "landmarks", "harmonic map", "correction", "certificate"] for chain in CHAINS}


def named(kind, line):
    return f"{kind} {line.get('number')}"


def counted_wrong(lines):
    """Kinds whose numbers do not run from 1 without a gap, and equations that are not the one of their number."""
    for kind, own in lines.items():
        numbers = [line["number"] for line in own]
        if numbers != list(range(1, COUNTS.get(kind, len(own)) + 1)):
            yield f"{kind}: numbers {[b for a, b in pairwise([0, *numbers]) if b != a + 1][:3]} are out of order"
    for line in lines["equation"]:
        if WORDS[line["number"] - 1].lower() not in line["printed"].lower():
            yield f"{named('equation', line)}: is not the one with '{WORDS[line['number'] - 1]}'"


def empty(kind, line):
    for field in FIELDS:
        if not line.get(field) and not line.get("reason"):
            yield f"{named(kind, line)}: {field} is empty, and no reason"
    if line["verdict"] not in paperlines.VERDICTS:
        yield f"{named(kind, line)}: '{line['verdict']}' is no verdict"


def resolved(name):
    """What a dotted name leads to, or AttributeError."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        return reduce(getattr, parts[count:], found)
    raise AttributeError(name)


def unknown_function(kind, line):
    try:
        assert callable(resolved(line["function"]))
    except (AttributeError, AssertionError):
        yield f"{named(kind, line)}: no function {line['function']}"


@cache
def functions_of(file):
    """name -> source of the test functions of a file, with their decorators; "" -> what marks them all."""
    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    found = {node.name: ast.unparse(node) for node in body if isinstance(node, ast.FunctionDef)}
    assigned = [ast.unparse(node) for node in body if isinstance(node, ast.Assign)]
    return found | {"": "".join(text for text in assigned if text.startswith("pytestmark"))}


def skipped_test(kind, line):
    file, _, name = line["test"].partition("::")
    functions = functions_of(file) if (ROOT / file).is_file() else {}
    if name not in functions:
        yield f"{named(kind, line)}: no test {line['test']}"
    elif re.search(r"\bskip|importorskip|xfail", functions[name] + functions[""]):
        yield f"{named(kind, line)}: the test {line['test']} may be skipped"


@cache
def places():
    """label -> page, of the whole book."""
    return {label: page for page in references.chapters() for label, _ in references.labels(page)}


text_of_page = cache(markdown_of)


@cache
def text_at(page, label):
    """What stands at a label of a page: from the label before it to the next but one."""
    marks = references.labels(page)
    k = [name for name, _ in marks].index(label)
    return text_of_page(page)[marks[k - 1][1] if k else 0 : marks[min(k + 2, len(marks) - 1)][1] + 400]


def lost_place(kind, line):
    page, _, label = line["place"].partition("#")
    if places().get(label) != page:
        yield f"{named(kind, line)}: the page '{page}' has no place '{label}'"
    elif " ".join(line.get("at", "").split()) not in " ".join(text_at(page, label).split()):
        yield f"{named(kind, line)}: '{line['at']}' does not stand at {line['place']}"
    for number in line["erratum"].split(", ") if line["erratum"] != "none" else ():
        if f"erratum-{number[1:]}" not in places():
            yield f"{named(kind, line)}: no erratum {number}"


def typed_number(kind, line):
    """A result that is typed where a kept file has to be named."""
    limit = r"(at (least|most)|below|above|the printed) [\d.]+" if "measured" in line else "^$"
    for field in ("rule", "changed", "compute"):
        if found := typed_results(re.sub(limit, "", line[field]), {})[0]:
            yield f"{named(kind, line)}: {field} has a typed number, {found[0].strip()!r}"
    if "measured" not in line and ("value" in line or "limit" in line):
        yield f"{named(kind, line)}: a value, and no kept file"


CHECKS = (empty, unknown_function, skipped_test, lost_place, typed_number)


def faults(lines):
    """What is wrong with the lines, in words that name each."""
    yield from counted_wrong(lines)
    for kind, own in lines.items():
        for line in own:
            for check in CHECKS:
                yield from check(kind, line)


def test_every_line_leads_somewhere():
    assert list(faults(LINES)) == []


def test_there_are_as_many_lines_as_the_paper_has():
    assert all(len(LINES[kind]) == count for kind, count in COUNTS.items()) and len(LINES["claim"]) >= 20


def test_every_test_is_collected(request):
    """By the session that runs this, or by one of its own for files that it leaves out."""
    asked = {line["test"] for own in LINES.values() for line in own}
    found = {item.nodeid.split("[")[0] for item in request.session.items}
    seen = {node.split("::")[0] for node in found}
    if left := sorted({node.split("::")[0] for node in asked} - seen):
        command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider", *left]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        found |= {line.split("[")[0] for line in done.stdout.splitlines()}
    assert asked - found == set()


COMMANDS = sorted({line["command"] for own in LINES.values() for line in own})


@pytest.mark.parametrize("command", [line for line in COMMANDS if "pytest" not in line and "build_book" not in line])
def test_a_command_has_options_that_its_program_knows(command, monkeypatch):
    name, *options = command.removeprefix("python -m ").split()
    if name == "qclearn":
        main([*options, "--help"])
    else:
        monkeypatch.setattr(sys, "argv", [name, *options])
        import_module(name).read_options()


# Measured lines

MEASURED = [(kind, line) for kind, own in LINES.items() for line in own if "measured" in line]


@cache
def kept(file):
    return json.loads((ROOT / "qclearn" / "benchmark" / "results" / f"{file}.json").read_text(encoding="utf-8"))


def by_hand(name):
    """The figure under a name, read from the kept file's own rows."""
    file, *keys = name.split("/")
    figures = kept(file)
    if file == "benchmark":
        run, key = keys
        named = str.startswith if run == "paper's networks" else str.__eq__
        own = [row for row in figures["rows"] if row["set"] == "cohort" and named(row["run"], run)]
        counts = {"pairs": len(own), "certified": sum(bool(row["certified"]) for row in own)}
        return counts[key] if key in counts else sum(row[key] for row in own) / len(own)
    if file == "sizes":
        sizes = sorted({row["vertices"] for row in figures["rows"]})
        vertices = dict(zip(("smallest", "middle", "largest"), sizes))[keys[0]]
        solve = {"resampling", "DBS-Net", "conjugate gradients", "exact solver"}
        comes = {"harmonic map", "correction"} if keys[1] in CHAINS else {"CP-Net", *solve}
        apart = set(STAGES[keys[1]]) - {"disk maps", "landmarks"}
        sums = {"comes": comes, "passes": comes - {"resampling"}, "map": apart, "solve": solve}
        stages = (sums | {"whole": STAGES[keys[1]]})[keys[2]]
        own = [row for row in figures["rows"] if (row["vertices"], row["chain"]) == (vertices, keys[1])]
        return sum(row["seconds"] for row in own if row["stage"] in stages)
    return reduce(lambda found, key: found[key], keys, figures)


@pytest.mark.parametrize("kind, line", MEASURED, ids=[named(*entry).replace(" ", "-") for entry in MEASURED])
def test_a_number_is_that_of_its_kept_file(kind, line):
    first, *other = map(by_hand, line["measured"])
    assert line["value"] == pytest.approx(first / other[0] if other else first, rel=1e-9)
    shown = paper_table([line]).data
    assert f"| **{line['verdict'].capitalize()}.**<br>" in shown and f"Measured {line['value']:.3g} (" in shown
    assert " over ".join(f"`{name}`" for name in line["measured"]) in shown
    if line["limit"][0] == "printed":
        low, high = line["interval"]
        assert low < line["value"] < high and f"interval {low:.3g} to {high:.3g}" in shown


def test_a_ratio_that_turns_turns_the_verdict(monkeypatch):
    line = {"measured": ["a/x", "a/y"], "limit": ["<=", 1.25], "verdict": ["holds", "fails"], "rule": "at most {limit}"}
    for ratio, verdict in ((0.91, "holds"), (1.29, "fails")):
        monkeypatch.setattr(paperlines, "figures_of", lambda file, ratio=ratio: {"x": ratio, "y": 1.0})
        assert paperlines.decided(line)["verdict"] == verdict
    assert paperlines.decided(line)["rule"] == "at most 1.25"


def test_the_sweep_holds_every_stage_of_every_chain_at_every_size():
    rows = kept("sizes")["rows"]
    sizes = sorted({row["vertices"] for row in rows})
    assert len(sizes) == 3 and sizes[0] > 9_000 and 140_000 < sizes[-1] < 170_000
    found = {(row["vertices"], row["chain"], row["stage"]) for row in rows}
    assert found == {(size, chain, stage) for size in sizes for chain in STAGES for stage in STAGES[chain]}
    assert len(found) == len(rows)


def test_what_is_left_of_the_saving_is_said_as_the_sweep_says_it():
    rows = kept("sizes")["rows"]
    largest, count = chain_seconds(rows)["largest"], max(row["vertices"] for row in rows)
    passes, comes, checked, whole = (saving(largest, part) for part in ("passes", "comes", "map", "whole"))
    words = (
        f"At {count:,} vertices the saving of the networks' passes alone {passes}, and that of their map as it comes, "
        f"resampled to the mesh, {comes}. For that map, certified and corrected, it {checked}, "
        f"and for the whole chain it {whole}."
    )
    assert words in " ".join(markdown_of("linebyline").split()), f"the sweep says so: {words}"


def test_conjugate_gradients_are_counted_as_the_network_in_whose_place_they_stand():
    rows = [
        {"vertices": 9, "chain": chain, "stage": stage, "seconds": 2.0**k}
        for chain, own in STAGES.items()
        for k, stage in enumerate(own)
    ]
    sums = {"passes": 20, "comes": 28, "solve": 24, "map": 124, "whole": 127}  # of 1, 2, 4 ... 64 s
    chains = chain_seconds(rows)["smallest"]
    for chain in ("networks", "conjugate gradients"):
        assert sums.items() <= chains[chain].items()


@pytest.mark.parametrize(
    "networks, words", [(0.9, "holds"), (1.1, "holds at the larger weight alone"), (3.1, "does not hold")]
)
def test_seconds_decide_what_is_left_of_the_saving(networks, words):
    seconds = {"networks": networks, "harmonic 0.1": 10.0, "harmonic 5": 30.0}
    assert saving({chain: {"map": value} for chain, value in seconds.items()}, "map") == words


def test_links_are_those_that_the_site_and_a_notebook_follow(monkeypatch):
    monkeypatch.setenv("QCLEARN_PAGES", "static")
    assert paperlines.link("lbs", "lbs", "eq-lbs-hats") == "[lbs](#eq-lbs-hats)"
    assert paperlines.link("lbs", "lbs", "lem-eqn5") == "{prf:ref}`lbs <lem-eqn5>`"
    monkeypatch.setenv("QCLEARN_PAGES", "")
    assert paperlines.link("lbs", "lbs", "lem-eqn5") == "[lbs](lbs.ipynb)"
