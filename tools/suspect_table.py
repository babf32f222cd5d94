"""Measure what suspect.py decides by: good registrations, and ones with each of six mistakes made on purpose.

    python tools/suspect_table.py [--good 200] [--wrong 20] [--seeds 1001-1012] [--vertices 3000] [--also FILE.npz ...]

Pairs are drawn from the two hemispheres of fsaverage5 (the right one mirrored) with the surfaces of --also, which carry
curves of the same names, and from synthetic subjects, for which whole surfaces are made up that they were cut from. Four
to eleven curves a pair, by their ends or whole, either method. Writes qclearn/kept/suspect.json, every case with its
values, and prints how often the right word was said and the range of each value. Finished cases are kept and not run again.
"""

import json
import warnings
from pathlib import Path

import click
import numpy as np
from tqdm import tqdm

import qclearn as qc
from data_synth.cohort import hemispheres
from qclearn import suspect
from qclearn.files import write_whole
from qclearn.landmarkfile import check_curves
from qclearn.pages import kept
from qclearn.provenance import commit

WORDS = {"mirrored": "mirror", "exchanged": "exchanged", "whole numbers": "numbering", "all reversed": "reversed",
         "one reversed": "reversed", "two swapped": "swapped"}
HOLDS = {"error_mm": "over", "error_share": "over", "curve_mm": "over", "curve_ratio": "over", "rows": "over",
         "strong_area": "over", "better": "below", "plausible": "below"}


def hemisphere(side, surface):
    """A hemisphere of fsaverage5 with its sulci as curves of two vertices, their ends."""
    ends = {curve["name"]: curve[side] for curve in qc.demo_landmarks()["curves"]}
    return qc.Surface(surface.vertices, surface.faces, ends, surface.original_vertices)


def uncut(surface, rng):
    """The surface with the numbers that its vertices might have had in a whole one of 5 % more."""
    count = len(surface.vertices)
    return qc.Surface(surface.vertices, surface.faces, surface.curves,
                      np.sort(rng.choice(count + count // 20, count, replace=False)))


def draw(rng, groups):
    """A random pair: (names, moving, control, curves as in a landmarks file)."""
    group = groups[int(rng.random() < 0.75)]  # synthetic ones are smaller, and there are more of them
    names = rng.choice(sorted(group), 2, replace=False).tolist()
    moving, control = (group[name] for name in names)
    shared = [name for name in control.curves if name in moving.curves]
    chosen = rng.choice(shared, rng.integers(4, min(11, len(shared)) + 1), replace=False).tolist()
    whole = bool(rng.random() < 0.5)

    def path(surface, name):
        return (surface.curves[name] if whole else surface.curves[name][[0, -1]]).tolist()

    return names, moving, control, [{"name": name, "moving": path(moving, name), "control": path(control, name)} for name in chosen]


def spoil(kind, rng, moving, control, curves):
    """The pair and its curves (changed in place) with a mistake: (moving, control)."""
    one, other = rng.choice(len(curves), 2, replace=False)
    if kind == "mirrored":
        return qc.mirror(moving), control
    if kind == "exchanged":
        return control, moving
    if kind == "whole numbers":
        for side, surface in ([("moving", moving), ("control", control)], [("moving", moving)], [("control", control)])[rng.integers(3)]:
            for curve in curves:
                curve[side] = surface.original_vertices[curve[side]].tolist()
    if kind == "two swapped":
        curves[one]["moving"], curves[other]["moving"] = curves[other]["moving"], curves[one]["moving"]
    for curve in {"all reversed": curves, "one reversed": curves[one:one + 1]}.get(kind, []):
        curve["moving"].reverse()
    return moving, control


def values(result, moving, control, curves):
    """What the thresholds are held against, of one registration: for readings the least misfit by their words."""
    report, entries = result.report, check_curves(curves, moving, control)
    worst, median = (float(f([row["landmark_error_mm"] for row in report["curves"]])) for f in (np.max, np.median))
    given = suspect.Reading(suspect.ends(entries, "moving", result.disk_moving),
                            suspect.ends(entries, "control", result.disk_control), np.arange(len(entries)),
                            np.zeros(len(entries), bool))
    others = [*suspect.of_surfaces(given, moving, control, result.disk_moving, result.disk_control, entries),
              *suspect.of_order(given)]
    readings = {}
    for other in others:
        word = other.reason.split(":")[0] or ("reversed" if other.backwards.any() else "swapped")
        readings[word] = min(readings.get(word, (np.inf, np.inf)), suspect.compared(given, other))
    return {"error_mm": report["landmark_error_mm"],
            "error_share": report["landmark_error"] / report["landmark_error_before"], "curve_mm": worst,
            "curve_ratio": worst / median, "strong_area": suspect.strong_share(moving, result.mu),
            "rows": suspect.rows_switched([word for word in report["fallbacks"] if not word.startswith(("moving: ", "control: "))])
            / len(moving.vertices),
            "better": {word: float(pair[0]) for word, pair in readings.items()},
            "plausible": {word: float(pair[1]) for word, pair in readings.items()}}


def measure(kind, number, groups):
    """One case, dict: what was drawn, the words that were said, the values."""
    rng = np.random.default_rng([number, *kind.encode()])
    names, moving, control, curves = draw(rng, groups)
    moving, control = spoil(kind, rng, moving, control, curves)
    method = ("exact", "network")[number % 2]
    case = {"kind": kind, "number": number, "pair": names, "curves": [curve["name"] for curve in curves],
            "whole": len(curves[0]["moving"]) > 2, "method": method}
    try:
        result = qc.register(moving, control, curves, method=method)
    except ValueError as error:
        return case | {"refused": str(error)}
    return case | {"suspect": result.report["suspect"], "bijective": result.report["bijective"],
                   **values(result, moving, control, curves)}


def recognised(case):
    """Whether a wrong case was met by its word: as a reason, or in the message it was refused with."""
    word = WORDS[case["kind"]] + ":"
    return word in case.get("refused", "") or any(reason.startswith(word) for reason in case.get("suspect", []))


def spread(found):
    return f"{min(found):.3g} to {max(found):.3g}" if found else "-"


def table(cases):
    """Lines: how often each mistake was recognised, and the range of each value in good cases and in each wrong kind."""
    good = [case for case in cases if case["kind"] == "good"]
    yield f"{len(good)} good: {sum(bool(case.get('suspect')) for case in good)} called suspect, {sum('refused' in case for case in good)} refused"
    for kind in WORDS:
        own = [case for case in cases if case["kind"] == kind]
        wrong = [case for case in own if "refused" in case]
        yield (f"{kind:14} {len(own):3} cases, {sum(map(recognised, own)):3} by the right word ({len(wrong)} of them refused), "
               f"{sum(bool('refused' in case or case['suspect']) for case in own):3} by any")
    for name, limit in suspect.LIMITS.items():
        if name not in HOLDS:
            continue
        yield f"{name} (limit: {HOLDS[name]} {limit:.3g})"
        for kind in ("good", *WORDS):
            found = [case[name] for case in cases if case["kind"] == kind and name in case]
            if found and isinstance(found[0], dict):
                words = [WORDS[kind]] if kind in WORDS else sorted({word for pair in found for word in pair})
                yield f"    {kind:14} " + ", ".join(f"{word} {spread([pair[word] for pair in found if word in pair])}" for word in words)
            else:
                yield f"    {kind:14} {spread(found)}"


@click.command(help=__doc__)
@click.option("--good", default=200, show_default=True)
@click.option("--wrong", default=20, show_default=True, help="Cases of each mistake.")
@click.option("--seeds", default="1001-1012", show_default=True, help="Of the synthetic subjects.")
@click.option("--vertices", default=3000, show_default=True, help="Of the synthetic subjects.")
@click.option("--data", help="Folder where synthetic subjects are kept (default: the user's cache).")
@click.option("--also", multiple=True, help="npz surface with curves named as those of fsaverage5.")
@click.option("--out", default=str(kept("suspect.json")), show_default=False)
def main(good, wrong, seeds, vertices, data, also, out):
    warnings.simplefilter("ignore", qc.RepairWarning)
    first, last = map(int, seeds.split("-"))
    rng = np.random.default_rng(0)
    synthetic = {str(seed): uncut(cortex.surface, rng) for seed, cortex in
                 zip(range(first, last + 1), hemispheres(range(first, last + 1), vertices, data))}
    real = {"fsaverage5 right, mirrored": hemisphere("moving", qc.mirror(qc.fsaverage5("right"))),
            "fsaverage5 left": hemisphere("control", qc.fsaverage5("left"))}
    real |= {Path(path).stem: uncut(qc.read_surface(path), rng) for path in also}
    wanted = [("good", k) for k in range(good)] + [(kind, k) for k in range(wrong) for kind in WORDS]
    done = json.loads(Path(out).read_text())["cases"] if Path(out).is_file() else []
    done = {(case["kind"], case["number"]): case for case in done}
    for kind, number in tqdm(sorted(set(wanted) - set(done), key=lambda task: task[1])):
        done[kind, number] = measure(kind, number, (real, synthetic))
        rows = ",\n  ".join(json.dumps(done[key]) for key in sorted(done))
        text = f'{{"commit": "{commit()}", "vertices": {vertices}, "limits": {json.dumps(suspect.LIMITS)},\n "cases": [\n  {rows}]}}\n'
        write_whole(Path(out), lambda place, text=text: place.write_text(text, encoding="utf-8"))
    print("\n".join(table(list(done.values()))))


if __name__ == "__main__":
    main()
