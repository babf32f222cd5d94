"""Measure the factors of `register(uncertainty=True)` where true maps are known, and judge them
where they took no part.

    python -m book.studies.calibrate_uncertainty --people FOLDER

Subjects that calibrate and subjects that judge are disjoint. Pairs of either have all, half, two or
none of their curves fitted, and 6,000 to 20,000 vertices; landmarks alone have factors of their
own. Warped real cortex and the held-out curves of fsaverage5 are told apart: nothing was chosen by
them; so are pairs at the ends of the weights for which there is a radius, and at those of an
individual. FOLDER's people (NAME.npz with curves) are registered onto each other by folds alone,
and their curves judge. Finished cases are kept in the user's cache and not run again.
"""

import argparse
import json
import time
import warnings
from functools import cache, partial
from itertools import permutations
from pathlib import Path

import numpy as np
from platformdirs import user_cache_path
from scipy.spatial import cKDTree
from scipy.stats import spearmanr

import qclearn as qc
from qclearn.benchmark.cortex import fsaverage_side, person, warp_pair
from qclearn.benchmark.pairs import Pair, cohort_pair, mapped_subject
from qclearn.io.provenance import commit
from qclearn.io.safe import write_whole
from qclearn.registration.curves import curve_distance, curves_in_space, curves_of_both
from qclearn.registration.problem import DELTA, ETA, Weights
from qclearn.registration.report import quantile
from qclearn.registration.uncertainty import MOST, calibrated

from .parts import Parts

SIZES = {
    "calibrate": 10 * [6_000] + 6 * [8_000] + 3 * [10_000] + [20_000],
    "judge": 4 * [8_000] + 4 * [10_000] + [6_000, 20_000],
}
FIRST, GENERATION, STEPS = ({"calibrate": 3001, "judge": 4001}, 4, (1, 3))  # seeds; a subject's partners are so far on
CURVES = {"all": slice(None), "half": slice(0, None, 2), "two": slice(0, None, 5), "none": slice(0)}
LEVELS = 0.5, 0.9, 0.95
SHARES = np.arange(1, 20) / 20  # quantiles of distance over radius on a person's curves
SHARE = 0.9  # of the pairs in which the guaranteed factor covers as asked
WARPS = {9.0: "half", 12.0: "all"}  # mm -> curves
USUAL = {"folds": Weights(delta=DELTA, eta=ETA), "landmarks": Weights()}
ENDS = [{name: getattr(USUAL["folds"], name) * most**end} for name, most in MOST.items() for end in (-1, 1)]
FURTHER, MORE = (8, (1, 2, 3))  # subjects of pairs with two curves to which a third is added; partners are so far on
KEPT = Path(qc.__file__).parent / "registration" / "uncertainty.json"


def cases():
    """Each synthetic case: part, kind of fit, numbers of both subjects, curves."""
    for part, sizes in SIZES.items():
        for k, (step, first) in enumerate((step, k) for step in STEPS for k in range(len(sizes))):
            second = (first + step) % len(sizes)
            for kind, settings in (("folds", list(CURVES)), ("landmarks", list(CURVES)[:3])):
                yield part, kind, first, second, settings[k % len(settings)]


def run(pair, kind, setting, timed=False, **weights):
    """A registration's radius at factor 1, true error and shares of the area, as arrays; timed:
    also CPU seconds, without and with the radius."""
    fitted = list(pair.curves)[CURVES[setting]]
    given = weights | ({"features": None} if kind == "landmarks" else {})
    seconds = []
    for sure in (False, True)[not timed :]:
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = qc.register(pair.moving.surface, pair.control.surface, fitted, uncertainty=sure, **given)
        seconds.append(time.process_time() - start)
    radius = found.uncertainty / calibrated()[kind]["factors"]["90"]
    error = np.zeros(0) if pair.truth is None else np.linalg.norm(found.points - pair.truth, axis=1)
    areas = pair.moving.surface.vertex_areas
    arrays = {"radius": radius, "error": error, "areas": areas / areas.sum(), "points": found.points}
    return arrays | ({"seconds": np.array(seconds)} if timed else {})


@cache
def side(seed, size):
    return mapped_subject(seed, size, generation=GENERATION)


def synthetic(seeds, sizes, kind, setting, timed, **weights):
    return run(cohort_pair(*map(side, seeds, sizes)), kind, setting, timed, **weights)


def warped(left, amplitude, setting):
    return run(warp_pair(left, amplitude), "folds", setting)


def factors_of(found, share=SHARE):
    """The factors within which shares LEVELS of the area lie, all pairs counting alike; and those
    that do in a `share` of the pairs, by split-conformal prediction: pairs are exchangeable,
    vertices are not."""
    ratios = [one["error"] / one["radius"] for one in found]
    together, shares = np.concatenate(ratios), np.concatenate([one["areas"] for one in found])
    rank = int(np.ceil((len(found) + 1) * share))
    names = [f"{100 * level:g}" for level in LEVELS]
    whole = [quantile(together, shares / len(found), level) for level in LEVELS]
    own = [sorted(quantile(r, one["areas"], level) for r, one in zip(ratios, found))[rank - 1] for level in LEVELS]
    return dict(zip(names, whole)), dict(zip(names, own))


def judged(one, factors):
    """Coverage at each level and in fifths of the radius, rank, and errors in the surest and least
    sure fifth."""
    radius, error, areas = one["radius"], one["error"], one["areas"]
    inside = error <= factors["90"] * radius
    fifths = np.array_split(np.argsort(radius), 5)
    return {
        "coverage": {name: float(areas @ (error <= k * radius)) for name, k in factors.items()},
        "fifths": [float(np.average(inside[some], weights=areas[some])) for some in fifths],
        "rank": float(spearmanr(radius, error)[0]),
        "error_mm": float(areas @ error),
        "surest_mm": float(error[fifths[0]].mean()),
        "least_sure_mm": float(error[fifths[-1]].mean()),
        "mean_mm": float(factors["90"] * (areas @ radius)),
        "median_mm": float(factors["90"] * np.median(radius)),
        "far": float(areas @ (error > 10)),
        "far_covered": float(areas @ (inside & (error > 10))),
    } | ({"seconds": one["seconds"].tolist()} if "seconds" in one else {})


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=Path, required=True, metavar="FOLDER", help="NAME.npz with curves")
    folder = parser.parse_args().people
    made = commit()  # before the file that it writes makes the tree another
    settings = {
        "commit": made,
        "generation": GENERATION,
        "weights": {kind: vars(weights) for kind, weights in USUAL.items()},
    }
    checkpoint = Parts(user_cache_path("qclearn") / "sure", settings, RuntimeError)
    found, words = {}, {}
    for part, kind, first, second, setting in cases():
        seeds = [FIRST[part] + number for number in (first, second)]
        sizes = [SIZES[part][number] for number in (first, second)]
        name = f"{part}-{kind}-{seeds[0]}-{seeds[1]}-{setting}"
        one = checkpoint.arrays(f"{name}.npz", partial(synthetic, seeds, sizes, kind, setting, part == "judge"))
        found.setdefault((kind, part), []).append(one)
        words.setdefault((kind, part), []).append({"seeds": seeds, "vertices": sizes, "curves": setting})
        print(name, flush=True)
    result = dict(settings)
    for kind in USUAL:
        factors, guaranteed = factors_of(found[kind, "calibrate"])
        pairs = {
            part: [said | judged(one, factors) for said, one in zip(words[kind, part], found[kind, part])]
            for part in SIZES
        }
        same = [one | {"radius": np.ones(len(one["error"]))} for one in found[kind, "calibrate"]]
        result[kind] = {
            "factors": factors,
            "guaranteed": guaranteed,
            "constant_mm": factors_of(same)[0],
            "calibrated_on": f"{len(pairs['calibrate'])} pairs of synthetic cortex, generation {GENERATION}",
            **pairs,
        }
    factors = result["folds"]["factors"]
    keep(result)  # what follows asks for radii at weights that the file before may refuse
    result |= {"warps": on_warps(checkpoint, factors), "curves": on_curves(checkpoint, factors)}
    result |= {"ends": at_ends(checkpoint, factors), "next": {"commit": made, "pairs": on_next(checkpoint)}}
    result["people"] = [
        checkpoint.json(f"people-{a.stem}-{b.stem}.json", partial(on_people, a, b))
        for a, b in permutations(sorted(folder.glob("*.npz")), 2)
    ]
    keep(result)


def keep(result):
    text = json.dumps(result, indent=1) + "\n"
    write_whole(KEPT, lambda place: place.write_text(text, encoding="utf-8"))


def on_warps(checkpoint, factors):
    """`judged` of real cortex warped by so many mm, whose truth is known."""
    left, rows = fsaverage_side("left"), []
    for amplitude, setting in WARPS.items():
        one = checkpoint.arrays(f"warp-{amplitude:g}-{setting}.npz", partial(warped, left, amplitude, setting))
        rows.append({"amplitude_mm": amplitude, "curves": setting} | judged(one, factors))
    return rows


def on_people(*paths):
    """The 90 % radius on the curves of one person's surface that is registered onto another's by
    folds alone: how far the curves end off, mm, how many of their vertices it holds, and the
    quantiles of distance over radius."""
    moving, control = map(person, paths)
    curves = curves_of_both(moving.surface, control.surface)
    found = qc.register(moving.surface, control.surface, [], uncertainty=True)
    lines = curves_in_space(control, [control.disk.z[curve["control"]] for curve in curves])
    numbers = [curve["moving"] for curve in curves]
    off = [cKDTree(line).query(found.points[path])[0] for line, path in zip(lines, numbers)]
    off, radius = np.concatenate(off), found.uncertainty[np.concatenate(numbers)]
    return {
        "pair": [path.stem for path in paths],
        "distance_mm": float(off.mean()),
        "radius_mm": float(radius.mean()),
        "coverage": float((off <= radius).mean()),
        "ratios": np.quantile(off / radius, SHARES).round(4).tolist(),
    }


def at_ends(checkpoint, factors):
    """`judged` of two pairs that judge, at the ends of what each weight may be."""
    rows = []
    for weights in ENDS:
        name = "-".join(f"{key}-{value:g}" for key, value in weights.items())
        for first, setting in enumerate(("all", "half")):
            seeds, sizes = ([FIRST["judge"] + n for n in (first, first + 1)], SIZES["judge"][first : first + 2])
            make = partial(synthetic, seeds, sizes, "folds", setting, False, **weights)
            one = checkpoint.arrays(f"ends-{name}-{setting}.npz", make)
            rows.append({"weights": weights, "seeds": seeds, "curves": setting} | judged(one, factors))
    return rows


def on_curves(checkpoint, factors):
    """Of fsaverage5's curves that took no part, right onto left: distance and mean radius there,
    mm."""
    right, left = (fsaverage_side(side) for side in ("right", "left"))
    curves = curves_of_both(right.surface, left.surface)
    rows = []
    for half in (0, 1):
        fitted, held = curves[half::2], curves[1 - half :: 2]
        one = checkpoint.arrays(f"curves-{half}.npz", partial(run, Pair(right, left, tuple(fitted)), "folds", "all"))
        for curve in held:
            path = curve["moving"]
            off = curve_distance(one["points"][path], left.surface.vertices[curve["control"]])
            there = float(factors["90"] * one["radius"][path].mean())
            rows.append({"name": curve["name"], "distance_mm": float(off), "radius_mm": there})
    return rows


def on_next(checkpoint):
    """What a third curve is worth: the one nearest to where `next` wants a landmark, against a
    random one."""
    rng, rows = np.random.default_rng(0), []
    for first, step in ((first, step) for first in range(FURTHER) for step in MORE):
        numbers = first, (first + step) % FURTHER
        seeds, sizes = [FIRST["judge"] + n for n in numbers], [SIZES["judge"][n] for n in numbers]
        draw = rng.random()  # before a case is kept, so that the others' draws stay
        one = checkpoint.arrays(f"next-{seeds[0]}-{seeds[1]}.npz", partial(with_third, seeds, sizes, draw))
        said = {name: one[name].tolist() for name in ("before_mm", "told_mm", "random_mm", "mean_mm")}
        rows.append({"seeds": seeds, "told": str(one["told"]), "random": str(one["random"])} | said)
    return rows


def with_third(seeds, sizes, draw):
    """True mean errors with two curves, with the third that is told, and with a random other one,
    mm."""
    pair = cohort_pair(*map(side, seeds, sizes))
    curves, fitted = list(pair.curves), list(pair.curves)[CURVES["two"]]
    rest = [curve for curve in curves if all(curve is not one for one in fitted)]
    moving, control = pair.moving.surface, pair.control.surface

    def fit(extra, uncertainty=False):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = qc.register(moving, control, fitted + extra, uncertainty=uncertainty)
        error = np.linalg.norm(found.points - pair.truth, axis=1)
        return found, float(moving.vertex_areas @ error / moving.area)

    found, before = fit([], uncertainty=True)
    there = moving.vertices[found.report["uncertainty"]["next"]["vertex"]]
    far = [np.linalg.norm(moving.vertices[curve["moving"]] - there, axis=1).min() for curve in rest]
    told = rest[int(np.argmin(far))]
    others = [curve for curve in rest if curve is not told]
    chance = others[int(draw * len(others))]
    return {
        "told": np.array(told["name"]),
        "random": np.array(chance["name"]),
        "before_mm": np.array(before),
        "told_mm": np.array(fit([told])[1]),
        "random_mm": np.array(fit([chance])[1]),
        "mean_mm": np.array(found.report["uncertainty"]["mean_mm"]),
    }


if __name__ == "__main__":
    main()
