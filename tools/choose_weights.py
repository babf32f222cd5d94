"""Measure which weights of the fit bring a map nearest to the truth.

    python tools/choose_weights.py --out qclearn/benchmark/kept/weights.json

Synthetic subjects of other seeds than those of the benchmark and of the training sets, onto the benchmark's control:
mean distance of their vertices near sulci from where they truly belong. Either side of fsaverage5 onto the other: mean
distance of the curves that took no part; these problems are the benchmark's, too. One figure judges, the geometric mean
of the two in mm, among settings whose landmarks end at most ALLOWED from their targets; a default within CLOSE of the
best stays. The page 'Registration' reads the file.
"""

import argparse
import json
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from data_synth.generations import GENERATION
from qclearn.benchmark.cortex import HALVES, fsaverage_side, heldout_pair
from qclearn.benchmark.measured import write_measured
from qclearn.benchmark.pairs import CONTROL, cohort_pair, mapped_subject, prepare
from qclearn.benchmark.trial import map_figures
from qclearn.files.provenance import provenance
from qclearn.methods.folds import with_folds
from qclearn.registration.checked import bijective_fit
from qclearn.registration.problem import Weights

SEEDS = range(3001, 3007)
ALLOWED = 1.0, 2.0  # mm of landmark error: mean over all problems, and over the worst one's landmarks
CLOSE = 0.03  # by which a default's figure may be above the best's
KEPT = (
    "correspondence_sulci_mm",
    "correspondence_mm",
    "held_out_mm",
    "worst_held_out_mm",
    "landmark_error_mm",
    "r_depth",
    "log2_area",
    "mean_abs_mu",
    "flipped",
)
# (beta, gamma, delta) at alpha = 1, which sets the unit of the others, and whether inner points slide.
FOLDED = (
    *((1e-2, gamma, 0.3, False) for gamma in (1e2, 1e3, 1e4, 1e5)),
    (1e-3, 3e2, 0.3, False),
    (1e-2, 1e3, 1.0, False),
    (1e-1, 1e4, 1.0, False),
    (1e-2, 1e3, 0.3, True),
)
ALONE = (
    *((1e-2, gamma, 0.0, False) for gamma in (1e2, 1e3, 1e4, 1e5)),
    (1.0, 1e4, 0.0, False),
    (1e-1, 5e3, 0.0, False),
    (1e-5, 64.0, 0.0, False),
    (1e-2, 1e3, 0.0, True),
)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options, made = parser.parse_args(), provenance()
    settings = FOLDED + ALONE
    with threadpool_limits(1):
        rows = [row for name, pair in pairs() for row in measured(name, pair, settings)]
    table = [line(setting, [row for row in rows if row["setting"] == setting]) for setting in settings]
    for features in (True, False):
        show([entry for entry in table if (entry["delta"] > 0) == features])
    if options.out:
        subjects = {"seeds": list(SEEDS), "control": CONTROL, "generation": GENERATION}
        rules = {"allowed_mm": ALLOWED, "close": CLOSE}
        write_measured("weights", options.out, {"table": table, **subjects, **rules, "provenance": made})


def pairs():
    """(name, Pair) of each problem in turn."""
    for part in HALVES:
        for side, other in (("right", "left"), ("left", "right")):
            yield f"{side} to {other}, {part}", heldout_pair(fsaverage_side(side), fsaverage_side(other), part)
    control = mapped_subject(CONTROL, 10_000)
    for seed in SEEDS:
        yield f"{seed} to {CONTROL}", cohort_pair(mapped_subject(seed, 10_000), control)


def measured(name, pair, settings):
    """A row for each setting on one pair, whose landmarks and features are prepared once."""
    prepared = prepare(pair)
    features = with_folds(prepared.problem).features
    for setting in settings:
        beta, gamma, delta, sliding = setting
        start = time.process_time()
        problem, weights = replace(prepared.problem, sliding=sliding), Weights(1.0, beta, gamma, delta)
        fit = bijective_fit(problem, weights, features=features if delta else None)
        seconds = time.process_time() - start
        figures = map_figures(pair, prepared, fit.f, pair.control.disk.lookup, False)
        row = {"setting": setting, "problem": name, "seconds": seconds, "fallbacks": fit.fallbacks}
        row |= {key: figures[key] for key in KEPT}
        print(json.dumps(row), flush=True)
        yield row


def line(setting, rows):
    """One setting's figures: means over its problems; the worst landmark error; each problem's judged figures."""
    beta, gamma, delta, sliding = setting
    means = {key: mean([row[key] for row in rows]) for key in (*KEPT, "seconds")}
    errors = {row["problem"]: row["landmark_error_mm"] for row in rows}
    judged = {row["problem"]: row["held_out_mm"] or row["correspondence_sulci_mm"] for row in rows}
    return {
        **asdict(Weights(1.0, beta, gamma, delta)),
        "sliding": sliding,
        **means,
        "worst_landmark_error_mm": max(errors.values()),
        "allowed": means["landmark_error_mm"] <= ALLOWED[0] and max(errors.values()) <= ALLOWED[1],
        "figure_mm": float(np.sqrt(means["correspondence_sulci_mm"] * means["held_out_mm"])),
        "each_mm": judged,
        "fallbacks": sum(bool(row["fallbacks"]) for row in rows),
    }


def mean(values):
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else np.nan


def show(table):
    """Print the settings, the best first, and those whose landmarks end too far off last."""
    names = "figure_mm", *KEPT[:5], "worst_landmark_error_mm", *KEPT[5:], "seconds", "fallbacks"
    print("beta gamma delta sliding allowed", *names)
    for row in sorted(table, key=lambda row: (not row["allowed"], row["figure_mm"])):
        setting = f"{row['beta']:g} {row['gamma']:g} {row['delta']:g} {row['sliding']!s:5} {row['allowed']!s:5}"
        print(f"{setting:34}", *(f"{row[name]:.3g}" for name in names))


if __name__ == "__main__":
    main()
