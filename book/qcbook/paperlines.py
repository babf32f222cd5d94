"""The paper line by line: what `book/paper.toml` says of each equation, figure and claim, with its
measured verdict."""

import operator
import os
import tomllib
from functools import cache, reduce
from pathlib import Path

import numpy as np

from qclearn.benchmark.measured import read_measured
from qclearn.benchmark.rows import summary

from .cells import table
from .comparisons import chain_seconds, compare_runs
from .verdicts import judge_ratio

KINDS = ("equation", "figure", "table", "contribution", "claim", "erratum")
PROVED = ("def-", "lem-", "prop-", "thm-", "rem-")  # how labels of theorems and their kin begin
PAGES = {  # page -> the words of a link to it
    "benchmark": "The benchmark",
    "certificate": "Proofs and checks",
    "cohort": "A cohort",
    "cpnet": "CP-Net",
    "dbsnet": "DBS-Net",
    "firstregistration": "A first registration",
    "fit": "The fit",
    "fourier": "Fourier compression",
    "lbs": "Linear Beltrami Solver",
    "ldnet": "LD-Net",
    "linebyline": "below",
    "quasiconformal": "Quasi-conformal maps",
    "whennetwork": "When does a network pay?",
}
BOUNDS = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
VERDICTS = {
    *("right", "right, corrected", "wrong as printed", "undecided", "overstated", "made", "made otherwise", "not made"),
    *("holds", "holds here", "does not hold here", "holds for one control", "a misprint", "changes results"),
    *("the saving holds", "the saving does not hold"),
    *("agrees", "agrees in direction only", "turned round", "not settled"),
}


@cache
def cohort():
    """The benchmark's rows on the cohort."""
    return [row for row in read_measured("benchmark")["rows"] if row["set"] == "cohort"]


@cache
def figures_of(file):
    """The figures of a kept file, nested dicts: of "sizes" seconds by chain, of "benchmark" the
    cohort's summary, with the maps of all runs of the paper's networks counted as "paper's
    networks"."""
    if file == "benchmark":
        found = summary(cohort())
        own = [line for run, line in found.items() if run.startswith("paper's networks")]
        return found | {"paper's networks": {key: sum(line[key] for line in own) for key in ("certified", "pairs")}}
    figures = read_measured(file)
    return chain_seconds(figures["rows"]) if file == "sizes" else figures


def kept_figure(name):
    """The number in a kept file under a name like "networks/dbsnet/best/latency_ms" or
    "sizes/largest/networks/map"."""
    file, *keys = name.split("/")
    return reduce(operator.getitem, keys, figures_of(file))


def interval(one, other):
    """(low, high) of the ratio of a figure's means of two runs over resampled subjects, as on the
    benchmark's page."""
    (_, run, key), (_, base, _) = one.split("/"), other.split("/")
    _, low, high = compare_runs(cohort(), run, base, key, np.random.default_rng(0))
    return 1 + low / kept_figure(other), 1 + high / kept_figure(other)


def decided(line):
    """A line of the file with its verdict. Where it names measured figures, `value` is the one, or
    the ratio of two.

    The verdict is then the first of two where the value meets `limit`; with the limit "printed",
    that of `judge_ratio`.
    """
    if "measured" not in line:
        return line
    value = reduce(operator.truediv, map(kept_figure, line["measured"]))
    sign, bound = line["limit"]
    ends = interval(*line["measured"]) if sign == "printed" else ()
    verdict = judge_ratio(bound, value, *ends) if ends else line["verdict"][0 if BOUNDS[sign](value, bound) else 1]
    rule = line["rule"].format(limit=f"{bound:.3g}")
    return line | {"value": value, "interval": ends, "verdict": verdict, "rule": rule}


def paper_lines(path="paper.toml"):
    """The lines of a file like `book/paper.toml`, decided: kind -> list of dicts."""
    lines = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    return {kind: [decided(line) for line in lines[kind]] for kind in KINDS}


def paper_table(lines, folded=""):
    """A Markdown table of lines of one kind, one row per line; `folded` as in `table`."""
    head = ["", "in print", "verdict, and rule", "in the book", "changed, compute, and how to repeat it"]
    rows = [[str(line["number"]), line["printed"], judged(line), placed(line), repeated(line)] for line in lines]
    return table(head, rows, folded)


def judged(line):
    """The verdict, the rule, the number, and what it was read from, with its interval where the rule
    asks."""
    said = f"**{line['verdict'].capitalize()}.**<br>{line['rule']}"
    if "value" not in line:
        return said
    ends = "interval {:.3g} to {:.3g}; ".format(*line["interval"]) if line["interval"] else ""
    names = " over ".join(f"`{name}`" for name in line["measured"])
    return f"{said} Measured {line['value']:.3g} ({ends}{names})."


def placed(line):
    """Where a line is shown, which function does it, which test holds it, and its errata."""
    page, _, label = line["place"].partition("#")
    parts = [link(PAGES[page], page, label)] if page else []
    parts += [f"`{line[key]}`" for key in ("function", "test") if line[key]]
    numbers = [] if line["erratum"] == "none" else line["erratum"].split(", ")
    parts += [link(number, "linebyline", f"erratum-{number[1:]}") for number in numbers]
    return "<br>".join([*parts, *([line["reason"]] if "reason" in line else [])])


def repeated(line):
    """What was changed from print, the compute that went in, and the command that repeats it."""
    return "<br>".join([f"Changed: {line['changed']}.", f"Compute: {spent(line)}.", f"`{line['command']}`"])


def spent(line):
    """The compute of a line, with the minutes of the trainings that it rests on."""
    if not line.get("weights"):
        return line["compute"]
    from qclearn.nets.weights import FOLDER, read_weights

    minutes = [read_weights(FOLDER / f"{name}.safetensors")[0]["seconds"] / 60 for name in line["weights"]]
    return f"{line['compute']}; trained for {sum(minutes):.0f} minutes of one thread"


def link(words, page, label):
    """A link to a label: for the build, which puts addresses in, or as JupyterLab follows it."""
    if os.environ.get("QCLEARN_PAGES") != "static":
        return f"[{words}]({page}.ipynb)"
    return f"{{prf:ref}}`{words} <{label}>`" if label.startswith(PROVED) else f"[{words}](#{label})"
