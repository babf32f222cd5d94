"""The page of one registration."""

import shlex

import numpy as np

from .finished import read_finished
from .markup import asset, escape, flip, items, number, page, require_html, table, write_text
from .views import Look, Shown, both_sides, grey

DIFFERENCE = Look("difference, after − control", "RdBu_r", -3, 3, "SD")
MU = Look("shape |μ|", "viridis", 0, 0.8, "0: angles kept, 1: flat")
AREA = Look("area log2 J", "PuOr_r", -2, 2, "−1: half of its area, 1: twice")
PICTURES = {
    "before": "The moving surface's curvature on the inflated control before registration",
    "after": "The moving surface's curvature on the inflated control after registration",
    "control": "The control's own curvature on its inflated surface",
}


def write_pair(folder, out):
    """Write the page of a registration's `folder` to `out`, one HTML file that asks the network for nothing.

    ReportError where the folder is not a whole one of `qclearn register`, or `out` is no name of a page.
    """
    out, one = require_html(out), read_finished(folder)
    write_text(out, pair_page(one))


def pair_page(one):
    """The page of a `Finished` registration, as text."""
    maps, shown = one.maps(), Shown(one.control.surface)
    (moving, control), report = one.names(), one.report
    pictures = {name: both_sides(shown, getattr(maps, name), words) for name, words in PICTURES.items()}
    scene = [(grey(f"curvature, {name}"), getattr(maps, name)) for name in ("after", "before", "control")]
    scene += [(DIFFERENCE, maps.after - maps.control), (MU, maps.mu), (AREA, maps.log2_area)]
    suspect = bool(report["suspect"])
    return page(
        "pair.html",
        f"{moving} → {control}: registration",
        shown.scene(scene),
        moving=escape(moving),
        control=escape(control),
        state="bad" if suspect else "good",
        verdict="Suspect: look before you use it" if suspect else "Nothing suspicious was found",
        words=verdict_words(one),
        figures=figures(one),
        views=flip("pair", pictures),
        scene=asset("viewer.html"),
        tables=result_tables(one) + curve_tables(report),
        done=done(report),
        command=escape(shlex.join(map(str, report["command"]))),
    )


def verdict_words(one):
    """What the verdict rests on: the reasons in full, or what was looked for and what that leaves open."""
    report, (before, after) = one.report, one.held_out()
    if report["suspect"]:
        return items(report["suspect"])
    told = (
        "None of the tests for mistakes fired: wrong hand, exchanged surfaces, another numbering, reversed or swapped "
        "curves, landmarks that stay far off, many repairs, strong distortion, folds that hardly agree, curves "
        f"that end farther off than before. The map is one-to-one: {report['flipped']} triangles are flipped."
    )
    if not report["curves"]:
        told += " No curve was fitted, so those on curves had nothing to look at."
    if after == after:
        open_ = (
            f"Curves that took no part ended {number(after)} mm from their counterparts, {number(before)} mm before."
        )
    else:
        open_ = "That does not prove that each fold lies on its counterpart: no curve was held out to measure it."
    return f"<p>{told}</p><p>{open_}</p>"


def figures(one):
    """The four figures that are asked for first."""
    r, held, report = one.r(), one.held_out(), one.report
    told = {
        "correlation of the folds' curvature": f"{number(r[0])} → {number(r[1])}",
        "held-out curves, mean distance": f"{number(held[0])} → {number(held[1])} mm"
        if held[1] == held[1]
        else "none held out",
        "flipped triangles": report["flipped"],
        "|log2 area ratio|, 95 % of the area below": number(report["log2_area"][1]),
    }
    return "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in told.items())


def result_tables(one):
    """Correlations, distortion and certificate."""
    report, moving = one.report, one.moving.surface
    r = {"curvature (not fitted)": one.r()} | report["r"] if "curvature" not in report["r"] else report["r"]
    rows = [(name, number(before, 3), number(after, 3)) for name, (before, after) in r.items()]
    mean, deviation, most = (number(report[f"{word}_abs_mu"], 3) for word in ("mean", "sd", "max"))
    stretched = [
        ("shape |μ|, of the triangles", f"{mean} (SD {deviation})", number(one.high_mu(), 3), most),
        ("shape |log2 of the ratio of stretches|, of the area", *map(number, report["log2_shape"]), "–"),
        ("size |log2 of the ratio of areas|, of the area", *map(number, report["log2_area"]), "–"),
    ]
    sound = [
        ("one-to-one (certified)", "yes" if report["bijective"] else "no"),
        ("flipped triangles", f"{report['flipped']} of {len(moving.faces)}"),
        ("triangles without area on the control", report["degenerate"]),
        ("repairs and fallbacks", "; ".join(report["fallbacks"]) or "none"),
    ]
    return (
        sure_table(report.get("sure"))
        + table(("feature", "before (best Möbius map)", "after"), rows, "Correlation of the folds, at 4 mm")
        + table(("distortion", "mean", "95 % below", "greatest"), stretched, "How much the moving surface is stretched")
        + table(("certificate", ""), sound, "Whether the map is sound")
    )


def sure_table(sure):
    """Within how many mm nine in ten vertices lie, where it was asked for, and what that does not see."""
    if not sure:
        return ""
    least, middle, most = (number(value, 1) for value in sure["quantiles_mm"].values())
    rows = [
        ("mean over the area", f"{number(sure['mean_mm'], 1)} mm"),
        ("10, 50 and 90 % of the area below", f"{least}, {middle}, {most} mm"),
        ("calibrated on", sure["calibrated_on"]),
        ("does not see", sure["blind_to"]),
        (
            "one more landmark helps most at",
            f"vertex {sure['next']['vertex']}: mean {number(sure['next']['mean_mm'], 1)} mm",
        ),
    ]
    return table(("radius", ""), rows, "How sure the map is: within this radius lie nine in ten vertices")


def curve_tables(report):
    """Held-out and fitted curves in mm, or the words that there are none."""
    held = [(name, number(before), number(after)) for name, (before, after) in report["held_out_mm"].items()]
    fitted = [(row["name"], number(row["landmark_error_mm"])) for row in report["curves"]]
    if len(held) > 1:
        held.append(("mean", *(number(value) for value in np.mean(list(report["held_out_mm"].values()), axis=0))))
    if len(fitted) > 1:
        fitted.append(("mean", number(report.get("landmark_error_mm"))))
    return table(
        ("curve", "before, mm", "after, mm"),
        held or [("none", "–", "–")],
        "Curves held out: distance from their counterparts",
    ) + table(("curve", "mm"), fitted or [("none: folds alone", "–")], "Curves fitted: distance from their targets")


def done(report):
    """Inputs with their hashes, weights and time."""
    keys = {"path": "file", "vertices": "vertices", "sha256": "SHA-256 of vertices and faces"}
    inputs = [(name, *(report["inputs"][side][key] for side in ("moving", "control"))) for key, name in keys.items()]
    weights = [(f"{name}, {text}", f"{report[name]:g}") for name, text in (
        ("alpha", "of |μ|²"), ("beta", "of its gradient"), ("gamma", "of the landmarks"), ("delta", "of the features")
    )]  # fmt: skip
    shares = [(f"share of {name}", f"{100 * share:.0f} %") for name, share in report["features"].items()]
    seconds = [(name.replace("_", " "), f"{value:.1f}") for name, value in report["seconds"].items()]
    versions = [(name, value) for name, value in report["versions"].items()]
    return (
        table(("", "moving", "control"), inputs, "Inputs")
        + '<div class="tables">'
        + table(("weight", ""), weights + shares, f"Settings, method {report['method']}")
        + table(("stage", "seconds"), seconds, "Time")
        + table(("program", "version"), versions, "Versions")
        + "</div>"
    )
