"""Measure what diagnose.py decides by: good registrations, and ones with mistakes made on purpose.

    python -m book.studies.suspect [--also FILE.npz ...] [--out FILE.json]

Pairs are drawn from the two hemispheres of fsaverage5 (the right one mirrored) with the surfaces of
--also, which carry curves of the same names, and from synthetic subjects, for which whole surfaces
are made up that they were cut from. Four to eleven curves a pair, by their ends or whole, either
method; or one or two, or the folds alone, the other curves held out; or one or two whose partner
on the control is another curve. With one or two, every second case fits folds, too. All are
registered.
Writes qclearn/benchmark/results/suspect.json, every case with its values. A stopped run goes on at
the commit that it began with.
"""

import re
import shutil
import warnings
from functools import partial
from pathlib import Path

import click
import numpy as np
from tqdm import tqdm

import qclearn as qc
from data_synth.cohort import cohort
from qclearn.benchmark.measured import RESULTS, plain, write_measured
from qclearn.io.provenance import commit
from qclearn.plane.disk import Disk
from qclearn.registration import diagnose
from qclearn.registration.curves import check_curves, held_apart
from qclearn.registration.diagnose import (
    align_by_folds,
    compared,
    diagnose_landmarks,
    given_hypothesis,
    order_hypotheses,
    places_apart,
    rotation_contrast,
    surface_hypotheses,
    with_folds,
)
from qclearn.registration.features import FOLDS
from qclearn.registration.start import SurfacePair
from qclearn.surfaces.conformal import ParameterizedSurface, parameterize

from .parts import Parts

VERTICES, CASES = (3000, 20)  # of the synthetic subjects; of each mistake, and ten times as many good ones
FEW, ALONE = (", one or two", ", folds alone")  # ends of kinds: with so few curves, the others held out
PARTNERS = {"wrong partner, one": 1, "wrong partners, two": 2}  # how many curves
# kind of case with a mistake -> the word that it is to be met by
WORDS = {
    "mirrored": "mirror",
    "exchanged": "exchanged",
    "whole numbers": "numbering",
    "all reversed": "reversed",
    "one reversed": "reversed",
    "two swapped": "swapped",
    "mirrored" + ALONE: "mirror",
    "mirrored" + FEW: "mirror",
    "whole numbers" + FEW: "numbering",
    "one reversed" + FEW: "reversed",
} | dict.fromkeys(PARTNERS, "place")
GOOD = {"good": 10 * CASES, "good" + FEW: 4 * CASES, "good" + ALONE: 2 * CASES}
COUNTS = GOOD | dict.fromkeys(WORDS, CASES) | dict.fromkeys(PARTNERS, 2 * CASES)


def is_few(kind):
    """Whether a kind of case has one curve or two."""
    return kind.endswith(FEW) or kind in PARTNERS


def hemisphere(side, surface):
    """A hemisphere of fsaverage5 with its sulci as curves of two vertices, their ends."""
    ends = {curve["name"]: curve[side] for curve in qc.demo_landmarks()["curves"]}
    return qc.Surface(surface.vertices, surface.faces, ends, surface.original_vertices)


def uncut(surface, rng):
    """The surface with the numbers that its vertices might have had in a whole one of 5 % more."""
    count = len(surface.vertices)
    return qc.Surface(
        surface.vertices, surface.faces, surface.curves, np.sort(rng.choice(count + count // 20, count, replace=False))
    )


def draw(rng, groups, kind):
    """A random pair: (names, moving, control, curves as in a landmarks file), of which some are
    held out."""
    group = groups[int(rng.random() < 0.75)]  # synthetic ones are smaller, and there are more of them
    names = rng.choice(sorted(group), 2, replace=False).tolist()
    moving, control = (group[name] for name in names)
    shared = [name for name in control.curves if name in moving.curves]
    few, alone = is_few(kind), kind.endswith(ALONE)
    count = rng.integers(1, 3) if few else 0 if alone else rng.integers(4, min(11, len(shared)) + 1)
    count = PARTNERS.get(kind, count)
    chosen = rng.choice(shared, count, replace=False).tolist()
    whole = bool(rng.random() < 0.5)

    def path(surface, name):
        return (surface.curves[name] if whole else surface.curves[name][[0, -1]]).tolist()

    held = [name for name in shared if (few or alone) and name not in chosen]
    curves = [{"name": name, "moving": path(moving, name), "control": path(control, name)} for name in chosen + held]
    return names, moving, control, [curve | {"hold_out": curve["name"] in held} for curve in curves]


def spoil(kind, rng, moving, control, curves):
    """The pair and its curves (changed in place) with a mistake: (moving, control)."""
    kind = kind.partition(",")[0]
    if kind == "mirrored":
        return qc.mirror(moving), control
    if kind == "exchanged":
        return control, moving
    picked = rng.choice(len(curves), min(2, len(curves)), replace=False) if curves else []
    if kind == "whole numbers":
        sides = [("moving", moving), ("control", control)]
        for side, surface in (sides, sides[:1], sides[1:])[rng.integers(3)]:
            for curve in curves:
                curve[side] = surface.original_vertices[curve[side]].tolist()
    if kind == "two swapped":
        one, other = (curves[k] for k in picked)
        one["moving"], other["moving"] = other["moving"], one["moving"]
    if kind.startswith("wrong partner"):
        names = partners = [curve["name"] for curve in curves]
        shared = [name for name in control.curves if name in moving.curves]
        while any(name == partner for name, partner in zip(names, partners)):
            partners = rng.choice(shared, len(names), replace=False)
        for curve, partner in zip(curves, partners):
            path = control.curves[partner]
            curve["control"] = (path if len(curve["moving"]) > 2 else path[[0, -1]]).tolist()
    for curve in {"all reversed": curves, "one reversed": [curves[k] for k in picked[:1]]}.get(kind, []):
        curve["moving"].reverse()
    return moving, control


def hypotheses(sides):
    """What decides about mistakes: of each kind of hypothesis the one that fits best, dict of dicts."""
    found, given = {}, given_hypothesis(sides)
    for other in [*surface_hypotheses(given, sides), *order_hypotheses(given)]:
        word = other.reason.split(":")[0] or ("reversed" if other.backwards.any() else "swapped")
        found[word] = min(found.get(word, {"better": np.inf}), compared(given, other), key=lambda one: one["better"])
    return found


def folds_say(moving, control, entries, result):
    """What decides with fewer than three curves, the moving side laid upon the control's as it was
    for the fit."""
    z = {"moving": result.disk_moving, "control": result.disk_control}
    here, there = (
        ParameterizedSurface(s, Disk(z[side], s.faces)) for side, s in (("moving", moving), ("control", control))
    )
    laid = align_by_folds(with_folds(SurfacePair(here, there, entries, [])))
    hand = laid.directions.mirrored_r - laid.directions.r
    case = {"hand": hand, "rotation_contrast": rotation_contrast(laid)}
    if entries:
        places, limit = places_apart(laid)
        case |= {"hypotheses": hypotheses(laid), "axes_r": laid.directions.r, "places": places, "place_limit": limit}
        case |= {"place": max(degrees + diagnose.DOUBLING * more for degrees, more in places.values())}
    return case


def outcome(result, moving):
    """What a registration's map shows: its reasons, and what the limits are held against."""
    report = result.report
    words = [word for word in report["fallbacks"] if not word.startswith(("moving: ", "control: "))]
    switched = [int(count) for word in words for count in re.findall(r"(\d+) rows switched", word)]
    case = {
        "suspect": report["suspect"],
        "bijective": report["bijective"],
        "log2_area": report["log2_area"][1],
        "rows": max(switched, default=0) / len(moving.vertices),
        "strong_area": moving.face_areas[abs(result.mu) > diagnose.LIMITS["strong_mu"]].sum() / moving.area,
    }
    if report["curves"]:
        millimetres = [row["landmark_error_mm"] for row in report["curves"]]
        case |= {
            "error_mm": report["landmark_error_mm"],
            "error_share": report["landmark_error"] / report["landmark_error_before"],
            "curve_mm": max(millimetres),
            "curve_ratio": float(max(millimetres) / np.median(millimetres)),
        }
    if report["held_out_mm"]:
        before, after = np.transpose(list(report["held_out_mm"].values()))
        case |= {"held_out_mm": report["held_out_mm"], "worse": float(after.mean() / before.mean() - 1)}
        case |= {"worse_mm": float((after - before).mean()), "worse_curve_mm": float((after - before).max())}
    return case


def measure(kind, number, groups):
    """One case, dict: what was drawn, the words that were said, the values."""
    rng = np.random.default_rng([number, *kind.encode()])
    names, moving, control, curves = draw(rng, groups, kind)
    fitted = [curve for curve in curves if not curve["hold_out"]]
    few, alone = is_few(kind), kind.endswith(ALONE)
    moving, control = spoil(kind, rng, moving, control, fitted)
    method = ("exact", "network")[number % 2] if not (few or alone) else "exact"
    features = FOLDS if alone or (few and number % 2) else None
    case = {
        "kind": kind,
        "number": number,
        "pair": names,
        "curves": [curve["name"] for curve in fitted],
        "whole": len(curves[0]["moving"]) > 2,
        "method": method,
        "features": features is not None,
        "commit": commit(),
    }
    try:
        entries = held_apart(check_curves(curves, moving, control), [])[0]
        if not (few or alone):
            sides = SurfacePair(parameterize(moving), parameterize(control), entries, held=[])
            case |= {"hypotheses": hypotheses(sides), "mistakes": diagnose_landmarks(sides)}
            result = qc.register(moving, control, curves, method=method, features=None, accept_suspect=True)
        else:
            result = qc.register(moving, control, curves, features=features, accept_suspect=True)
            said = [reason for reason in result.report["suspect"] if reason.split(":")[0] in WORDS.values()]
            case |= {"mistakes": said} | folds_say(moving, control, entries, result)
        case |= outcome(result, moving)
    except ValueError as error:
        case |= {"refused": str(error)}
    return plain(case)


@click.command(help=__doc__)
@click.option("--also", multiple=True, help="npz surface with curves named as those of fsaverage5.")
@click.option("--out", default=str(RESULTS / "suspect.json"), show_default=False)
def main(also, out):
    warnings.simplefilter("ignore", qc.RepairWarning)
    rng = np.random.default_rng(0)
    synthetic = {str(cortex.seed): uncut(cortex.surface, rng) for cortex in cohort(12, VERTICES)}
    real = {
        "fsaverage5 right, mirrored": hemisphere("moving", qc.mirror(qc.fsaverage5("right"))),
        "fsaverage5 left": hemisphere("control", qc.fsaverage5("left")),
    }
    real |= {Path(path).stem: uncut(qc.read_surface(path), rng) for path in also}
    # Kinds mixed, so that a run that is stopped has some of each.
    wanted = sorted(
        ((kind, k) for kind, count in COUNTS.items() for k in range(count)), key=lambda c: c[1] / COUNTS[c[0]]
    )
    # A stopped run goes on only at the commit that it began with.
    settings = {"vertices": VERTICES, "also": list(also), "commit": commit()}
    checkpoint = Parts(f"{out}.partial", settings, click.ClickException)
    done = {}
    for kind, number in tqdm(wanted, disable=None):
        done[kind, number] = checkpoint.json(f"{kind} {number}.json", partial(measure, kind, number, (real, synthetic)))
    cases = [done[key] for key in sorted(done)]
    figures = {"commit": commit(), "vertices": VERTICES, "limits": diagnose.LIMITS, "cases": cases}
    write_measured("suspect", out, figures)
    shutil.rmtree(checkpoint.path)


if __name__ == "__main__":
    main()
