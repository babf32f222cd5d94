"""Comparisons of runs on the same subjects, over the rows of a measured file."""

import tomllib
from pathlib import Path

import numpy as np

from .verdicts import compared, side

DRAWS, LEVEL = 10_000, 0.95  # of the bootstrap
SHARED = ("disk maps", "landmarks")  # stages that every chain begins with
RIVALS = {"conjugate gradients": "stopped conjugate gradients", "exact solver": "the exact solver"}
SOLVES = ("resampling", "DBS-Net", "conjugate gradients", "exact solver")  # what makes a map of a coefficient


def among_people(rows):
    """The rows of pairs of people: beside them stands an average, FS5."""
    return [row for row in rows if "FS5" not in row["pair"]]


def doubtful_curves():
    """The (brain, curve) whose homology is in doubt, by people_labels.toml."""
    labels = Path(__file__).with_name("people_labels.toml")
    return {(one["brain"], one["curve"]) for one in tomllib.loads(labels.read_text(encoding="utf-8"))["doubtful"]}


def homologous(rows):
    """The rows of people with the held-out curves that are doubtful on neither side, and their mean;
    rows without such a curve are left out."""
    doubtful, left = doubtful_curves(), []
    for row in rows:
        brains = row["pair"].split(",")[0].split(" to ")
        sure = {name: mm for name, mm in row["held_out"].items() if doubtful.isdisjoint((b, name) for b in brains)}
        if sure:
            left.append(row | {"held_out": sure, "held_out_mm": sum(sure.values()) / len(sure)})
    return left


def column(rows, run, key):
    """One figure of one run: dict pair -> number, NaN where there is none."""
    own = {row["pair"]: row.get(key) for row in rows if row["run"] == run}
    return {pair: np.nan if value is None else float(value) for pair, value in own.items()}


def paired_difference(one, other, rng):
    """(mean, low, high) of one - other over the same subjects, low and high of its 95 % bootstrap
    interval; pairs with a NaN are left out, and without any pair all three are NaN."""
    differences = np.asarray(one, float) - np.asarray(other, float)
    differences = differences[np.isfinite(differences)]
    if not len(differences):
        return (np.nan,) * 3
    means = differences[rng.integers(len(differences), size=(DRAWS, len(differences)))].mean(1)
    low, high = np.quantile(means, [(1 - LEVEL) / 2, (1 + LEVEL) / 2]).tolist()
    return float(differences.mean()), low, high


def compare_runs(rows, one, other, key, rng):
    """One run's figure less another's on the same pairs: `paired_difference`, (mean, low, high)."""
    first, second = column(rows, one, key), column(rows, other, key)
    both = [pair for pair in first if pair in second]
    return paired_difference([first[pair] for pair in both], [second[pair] for pair in both], rng)


def front_ratio(rows, front, baseline, size="mean_abs_mu"):
    """The front's error at the baseline's distortion over the baseline's error, dict by pair.

    front: names of runs that trade landmark error for `size`. Straight lines join their certified
    points that none beats in both, constant beyond the last. Pairs with a certified baseline; NaN where
    its size is below the front's. Below 1 the front is ahead.
    """
    certified = [row for row in rows if row.get("certified")]
    ratios = {}
    for row in certified:
        if row["run"] != baseline:
            continue
        own = [other for other in certified if other["pair"] == row["pair"]]
        points = sorted((other[size], other["landmark_error"]) for other in own if other["run"] in front)
        best = []
        for point in points:
            if all(point[1] < other[1] for other in best):
                best.append(point)
        sizes, errors = np.array(best).reshape(-1, 2).T
        inside = len(best) and sizes[0] <= row[size]
        error = row["landmark_error"]
        ratios[row["pair"]] = np.interp(row[size], sizes, errors) / error if inside else np.nan
    return ratios


def compare_fronts(rows, front, baseline, rng, size="mean_abs_mu"):
    """The geometric mean "ratio" of `front_ratio`, with its 95 % interval "low", "high": dict.

    "won" of "pairs": the front is ahead; "state": "ahead", "behind", "level" (the interval holds 1)
    or "unknown".
    """
    ratios = np.array(list(front_ratio(rows, front, baseline, size).values()))
    difference = paired_difference(np.log(ratios), np.zeros(len(ratios)), rng)
    ratio, low, high = np.exp(difference).tolist()
    states = {"below": "ahead", "above": "behind", "level": "level"}
    state = "unknown" if np.isnan(low) else states[side(low, high, of=1)]
    counts = {"won": int((ratios < 1).sum()), "pairs": int(np.isfinite(ratios).sum())}
    return {"ratio": ratio, "low": low, "high": high, **counts, "state": state}


def noted(rows, run, text):
    """How many of a run's maps carry a note that contains `text`."""
    notes = [row.get("notes", ()) for row in rows if row["run"] == run]
    return sum(any(text in note for note in own) for own in notes)


def chain_seconds(rows):
    """Seconds of the rows of sizes.json: "smallest", "middle" or "largest" -> chain -> stage.

    Each chain also has "whole", the sum of its stages; "map", those that it does not share with the
    others; "comes", the map without a certificate and without corrections; "passes", the same
    without resampling; and "solve", the stages that make a map of a coefficient. The harmonic map's
    correction is a part of it.
    """
    sizes = sorted({row["vertices"] for row in rows})
    seconds_by_size = {}
    for name, vertices in zip(("smallest", "middle", "largest"), sizes):
        chains = seconds_by_size[name] = {}
        for row in rows:
            if row["vertices"] == vertices:
                chains.setdefault(row["chain"], {})[row["stage"]] = row["seconds"]
        for stages in chains.values():
            solve = sum(seconds for stage, seconds in stages.items() if stage in SOLVES)
            apart = sum(seconds for stage, seconds in stages.items() if stage not in SHARED)
            checks = stages.get("certificate", 0.0)
            if "resampling" in stages:
                checks += stages.get("correction", 0.0)
            passes = apart - checks - stages.get("resampling", 0.0)
            sums = {"map": apart, "comes": apart - checks, "passes": passes, "solve": solve}
            stages |= {"whole": sum(stages.values()), **sums}
    return seconds_by_size


def saving(chains, part):
    """The verdict, as text, on a saving of 90 % at one size of `chain_seconds`; part: of its sums.

    It holds if the networks' seconds are at most a tenth of those of the harmonic map at both
    weights.
    """
    limits = [chains[f"harmonic {weight}"][part] / 10 for weight in ("0.1", "5")]
    at_smaller, at_larger = (chains["networks"][part] <= limit for limit in limits)
    if at_smaller and at_larger:
        return "holds"
    return "holds at the larger weight alone" if at_larger else "does not hold"


def dbsnet_saves(rows):
    """What DBS-Net saves of the whole pipeline at the largest size of sizes.json: one sentence.

    Its rival is the exact solver, or conjugate gradients stopped at an error no larger: the faster
    one.
    """
    chains = chain_seconds(rows)["largest"]
    network = chains["networks"]["whole"]
    own = {name: chains[name]["whole"] for name in RIVALS}
    rival = min(own, key=own.get)
    share = 1 - network / own[rival]
    words = {"below": f"saves {share:.0%} of", "level": "saves nothing of", "above": f"adds {-share:.0%} to"}
    return (
        f"On {max(row['vertices'] for row in rows):,} vertices the paper's DBS-Net, corrected, "
        f"{words[compared(network, own[rival])]} "
        f"the whole pipeline, by landmarks alone ({network:.1f} s beside {own[rival]:.1f} s with {RIVALS[rival]} "
        "in its place); the paper reports that its networks save over nine tenths of a harmonic map's time."
    )
