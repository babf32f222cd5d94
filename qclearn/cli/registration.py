"""`qclearn register` and `demo`: from two surfaces to a folder with map, report and figure."""

import json
import time
from pathlib import Path

import click
import numpy as np

import qclearn as qc

from ..io.hemisphere import read_hemisphere
from ..io.mapfile import side_arrays, write_registration
from ..io.provenance import origin
from ..io.safe import printable
from ..registration.curves import curves_of_both, on_cut_surfaces, read_landmarks
from ..registration.problem import DELTA, DELTA_BY_DISKS, ETA, Weights
from ..registration.register import register as run_registration
from .given import given_features, merge_option, units_option
from .output import SEAL, fail, output_folder, warn
from .sphere import FILES as SPHERES
from .sphere import sphere_of, write_sphere

# The arrays of a `Registration` that registration.npz holds.
MAPS = ["points", "disk_moving", "disk_control", "disk_map", "mu", "faces_moving", "faces_control"]
UNCERTAINTY = "uncertainty.shape.gii"

accept_suspect_option = click.option(
    "--accept-suspect", is_flag=True, help="Also fit wrong landmarks; exit code 0 if suspect."
)
report_option = click.option("--report", is_flag=True, help="Also write the page report.html.")


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option("--cortex", metavar="FILE", help="lh.cortex.label of a whole MOVING, to cut it open.")
@click.option("--control-cortex", metavar="FILE", help="The same for a whole CONTROL.")
@units_option
@merge_option
@click.option("--landmarks", help="JSON file of curves  [default: those in both npz, or none]")
@click.option("--out", required=True, help="Folder to write to; replaces an earlier result there.")
@click.option(
    "--method",
    type=click.Choice(["exact", "network"]),
    default="exact",
    help="network: LD-Net, CP-Net, DBS-Net, and the exact method where they fall short.",
)
@click.option("--tolerance", type=float, help="Refine networks above this error  [default: 0.005]")
@click.option("--alpha", type=float, default=Weights.alpha, help="Weight of |mu|^2.")
@click.option("--beta", type=float, default=Weights.beta, help="Weight of |grad mu|^2.")
@click.option("--gamma", type=float, default=Weights.gamma, help="Weight of the landmark mismatch.")
@click.option(
    "--delta",
    type=float,
    help=f"Weight of the feature mismatch  [default: {DELTA:g}, or {DELTA_BY_DISKS:g} with --eta 0]",
)
@click.option(
    "--eta", type=float, help=f"Weight of mean (log J)^2  [default: {ETA:g} with features, else 0]"
)
@click.option(
    "--feature",
    "given",
    nargs=2,
    multiple=True,
    metavar="MOVING CONTROL",
    help="Per-vertex files to match, repeatable; CONTROL:2 has weight 2  "
    "[default: depth depth, curvature curvature, potential potential]",
)
@click.option("--no-features", is_flag=True, help="Landmarks alone, the paper's setting.")
@click.option("--no-landmarks", is_flag=True, help="Features alone; curves only to be held out.")
@click.option("--hold-out", multiple=True, metavar="NAME", help="Measure a curve, do not fit it.")
@click.option("--uncertainty", is_flag=True, help=f"Also write {UNCERTAINTY}: the 90 % radius, mm.")
@click.option("--sliding", is_flag=True, help="Let inner points slide along their target curves.")
@click.option("--mirror", is_flag=True, help="Mirror the moving surface first (right onto left).")
@report_option
@click.option("--sphere", metavar="FILE", help="The control's; also do `qclearn sphere`.")
@accept_suspect_option
def register(
    moving, control, cortex, control_cortex, units, merge, landmarks, out, given, no_features,
    no_landmarks, mirror, sphere, **options,
):  # fmt: skip
    """Register MOVING to CONTROL by folds and landmark curves; write a certified map.

    Each of the two is a surface file, or fsaverage5:left or fsaverage5:right. Landmarks and
    per-vertex files have the vertex numbers of the surface as given: whole if it is whole. The
    folder gets registration.npz, report.json, registered.surf.gii and figure.png.

    \b
    Exit codes:
      0  registered
      2  refused: one line on stderr says what, where and what to do; nothing is written
      3  written, but suspect: one line on stderr, and "suspect" in report.json, say why

    The first six reasons below, where they come from curves or folds, are checked before the fit,
    which is then not made: what is written is the map that aligns the curves' ends, or the folds,
    and "stopped" in report.json says so. --accept-suspect fits all the same.

    \b
    A registration is suspect where
      mirror:      curves or folds fit the moving side mirrored or in LPS much better, or the files say left and right
      exchanged:   the curves fit much better with MOVING and CONTROL exchanged
      numbering:   they fit much better as vertex numbers of the whole surface, before `open` cut it
      reversed:    a curve fits much better run from its other end
      swapped:     curves fit much better with each other's names
      place:       one curve of one or two lies elsewhere on the two sides, by folds and axes in space
      walls:       the two medial walls were cut by different rules, and one of the following holds
      error:       the landmarks end over 3 mm from their targets, and most of it was there before
      curve:       one curve ends over 5 mm from its target, and five times as far as the median one
      rows:        the map folded, and was repaired at more than 0.5 % of the vertices
      distortion:  |mu| is over 0.9 on more than 1 % of the surface
      areas:       they change over 32-fold on 5 % of the surface, by one curve alone over 256-fold
      features:    they hardly agree, have opposite signs, or probably lead to the wrong place
      worse:       a held-out curve fits clearly worse than after the best Möbius map
      units:       a surface has the length of a hemisphere in metres or micrometres: give --units
    """
    # What is left in options goes straight to `qclearn.register`, under its names.
    if no_landmarks and landmarks:
        raise qc.LandmarkError("--landmarks and --no-landmarks exclude each other; drop one")
    files = {"moving": (moving, cortex), "control": (control, control_cortex)}
    sides = {side: read_hemisphere(*names, units, merge) for side, names in files.items()}
    sphere = sphere and sphere_of(sides, sphere)
    features = given_features(sides, given, no_features, options["delta"])
    curves = read_landmarks(landmarks) if landmarks else {"curves": []}
    held = set(options["hold_out"])
    if not landmarks and (held or not no_landmarks):
        found = curves_of_both(*(one.cut_surface for one in sides.values()))
        named = {name for one in sides.values() for name in one.cut_surface.curves}
        lone = sorted(named - {curve["name"] for curve in found})
        if no_landmarks and held <= {curve["name"] for curve in found}:
            found = [curve for curve in found if curve["name"] in held]
        curves["curves"] = found
        if not found and features is None:
            raise qc.LandmarkError(
                "the surfaces share no curve names (curve_<name> in their npz files); give --landmarks"
            )
        if lone:
            warn(f"curves on one side alone are left out: {', '.join(lone)}")
    register_into(out, sides, mirror, curves, sphere, features=features, **options)


@click.command()
@click.option("--out", default="qclearn-demo", help="Folder to write to.")
@report_option
@accept_suspect_option
def demo(out, **options):
    """Register real cortex: fsaverage5's mirrored right hemisphere onto its left one.

    Six named sulci are fitted; five more are held out and measured.
    """
    landmarks = qc.demo_landmarks()
    hold_out = [curve["name"] for curve in landmarks["curves"][1::2]]
    names = {"moving": "fsaverage5:right", "control": "fsaverage5:left"}
    sides = {side: read_hemisphere(name).cut for side, name in names.items()}
    register_into(out, sides, True, landmarks, hold_out=hold_out, **options)


def register_into(out, sides, mirrored, curves, sphere=None, *, report, accept_suspect, **options):
    """Register two `Hemisphere`s, dict side -> one, write the files, print the report; exit code 3
    if it is suspect.

    mirrored: whether the moving one is mirrored first; curves: with the numbers of the surfaces as
    given; sphere: the control's, as of `read_sphere`, or None; report: also write the page. options: go
    straight to `qclearn.register`, under its names.
    """
    from ..plot import registration_figure

    words, begun = click.get_current_context().obj
    moving, control = (one.cut_surface for one in sides.values())
    moving = qc.mirror(moving) if mirrored else moving
    seconds = {"read": time.perf_counter() - begun}
    replaced = " (in place of an earlier result)" if Path(out, SEAL).exists() else ""
    with output_folder(out, instead=["report.html", UNCERTAINTY, *SPHERES]) as folder:
        result = run_registration(
            moving,
            control,
            on_cut_surfaces(curves, sides),
            progress=True,
            accept_suspect=accept_suspect,
            **options,
        )
        seconds |= result.report["seconds"]
        del seconds["total"]  # of `run_registration` alone

        start = time.perf_counter()
        registration_figure(result, moving, control).savefig(folder / "figure.png", dpi=150)
        seconds["figure"] = time.perf_counter() - start

        # The maps, with what leads back from the disks to the files of both surfaces.
        start = time.perf_counter()
        arrays = {name: getattr(result, name) for name in MAPS} | {"mirrored": np.array(mirrored)}
        for side, surface in (("moving", moving), ("control", control)):
            arrays |= side_arrays(side, surface, sides[side].frame)
        write_registration(folder / "registration.npz", arrays)
        qc.write_surface(
            folder / "registered.surf.gii", result.surface, frame=sides["control"].frame
        )
        on_sphere = sphere and write_sphere(folder, arrays, sphere)

        # The hemispheres that files name outrank what the folds suggest.
        wrong = wrong_hemisphere(sides, mirrored)
        suspect = [
            reason
            for reason in result.report["suspect"]
            if not (wrong and reason.startswith("mirror:"))
        ]
        inputs = {side: (one.path, one.given) for side, one in sides.items()}
        held = result.report["held_out_mm"]
        given = [
            one | {"hold_out": True} if one["name"] in held else one for one in curves["curves"]
        ]
        contents = result.report | {"suspect": [*wrong, *suspect]} | origin(inputs, given, words)
        if result.uncertainty is not None:
            write_uncertainty(folder, result, contents, sides["moving"])

        seconds["write"] = time.perf_counter() - start
        seconds["total"] = time.perf_counter() - begun
        contents["seconds"] = {stage: round(lasted, 4) for stage, lasted in seconds.items()}
        (folder / SEAL).write_text(json.dumps(contents, indent=2) + "\n")
        if report:
            from ..reports import write_pair

            write_pair(folder, folder / "report.html")
    print_report(contents, out + replaced)
    if on_sphere:
        print(f"{'sphere':15s} {on_sphere}")
    if contents["suspect"]:
        fail("suspect: " + "; ".join(contents["suspect"]), 0 if accept_suspect else 3)


def wrong_hemisphere(sides, mirrored):
    """A list with the message `mirror:` where the files' hemispheres contradict --mirror."""
    one, other = (side.frame.side for side in sides.values())
    if None in (one, other) or (one != other) == mirrored:
        return []
    moving, control = (side.path for side in sides.values())
    return [
        f"mirror: {moving} is a {one} and {control} a {other} hemisphere by their names or "
        f"metadata; {'leave --mirror out' if mirrored else 'give --mirror'}, or name the files for "
        "what they hold"
    ]


def write_uncertainty(folder, result, report, moving):
    """Write the radii of a `Registration`, and give the next landmark the whole surface's number."""
    numbering = moving.numbering
    radius = result.uncertainty.astype(np.float32)
    radius = numbering.on_whole(radius, np.nan) if numbering.known else radius
    qc.write_values(folder / UNCERTAINTY, radius, moving.frame.side, names=["radius of 90 %, mm"])
    if moving.is_whole:
        following = report["uncertainty"]["next"]
        vertex = int(numbering.table[following["vertex"]])
        report["uncertainty"] = report["uncertainty"] | {"next": following | {"vertex": vertex}}


def print_report(report, out):
    """The figures a user asks first, a line each."""

    def line(head, text):
        print(f"{head:15s} {printable(text)}")

    if report["curves"]:
        before, after = report["landmark_error_before"], report["landmark_error"]
        disk = f"{after:.2e} in the disk ({before:.2e} after the best Möbius map)"
        line("landmark error", f"{disk}, {report['landmark_error_mm']:.2f} mm")
    elif not report["stopped"]:
        line("landmarks", f"none; registered by {', '.join(report['features'])} alone")
    if report["held_out_mm"]:
        before, after = np.mean(list(report["held_out_mm"].values()), axis=0)
        aligned = "the fitted curves" if report["curves"] else "the folds"
        text = f"{after:.2f} mm, mean of the curves ({before:.2f} after the Möbius map that aligns {aligned} best)"
        line("held out", text)
        line(
            "",
            ", ".join(f"{name} {after:.2f}" for name, (_, after) in report["held_out_mm"].items()),
        )
    if report["start"].startswith("by spheres"):
        line("start", "by spheres, not at the best Möbius map, which is no yardstick here")
    for name, (before, after) in report["r"].items():
        line(f"r({name})", f"{after:.3f} ({before:.3f} after the best Möbius map)")
    mean, deviation, most = (report[f"{name}_abs_mu"] for name in ("mean", "sd", "max"))
    line("|mu|", f"mean {mean:.3f}, SD {deviation:.3f}, maximum {most:.3f}")
    faces = f"{report['flipped']} faces flipped, {report['degenerate']} without area on the control"
    line("bijective", f"{'yes' if report['bijective'] else 'no'}, {faces}")
    if "uncertainty" in report:
        least, _, most = report["uncertainty"]["quantiles_mm"].values()
        mean_mm = report["uncertainty"]["mean_mm"]
        text = f"within {mean_mm:.1f} mm on average, 9 in 10 vertices ({least:.1f} to {most:.1f})"
        line("uncertainty", text)
    if report["stopped"]:
        line("stopped", report["stopped"])
    if report["units"]:
        line("units", report["units"])
    line("fallbacks", "; ".join(report["fallbacks"]) or "none")
    line("suspect", "; ".join(reason.split(":")[0] for reason in report["suspect"]) or "no")
    line("seconds", f"{report['seconds']['total']:.1f}")
    line("written to", out)
