"""`qclearn register` and `demo`: a pair of surfaces to a folder with the map, the report and the figure."""

import json
from pathlib import Path

import click
import numpy as np
from click.core import ParameterSource

import qclearn as qc

from ..files.meshes import Frame, frame_of
from ..files.provenance import origin
from ..files.values import read_regions
from ..registration.features import FOLDS, Feature, FeatureError
from ..registration.landmarkfile import read_landmarks
from ..registration.landmarks import curves_of_both
from ..registration.mapfile import write_registration
from ..registration.problem import DELTA, Weights
from ..registration.register import register as run_registration
from .output import fail, output_folder

MAPS = ("points", "disk_moving", "disk_control", "disk_map", "mu", "faces_moving", "faces_control")  # that are written


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option("--landmarks", help="JSON file of curves; without it, the curves that both npz surfaces carry.")
@click.option("--out", required=True, help="Folder for registration.npz, report.json, registered.surf.gii, figure.png.")
@click.option(
    "--method",
    type=click.Choice(["exact", "network"]),
    default="exact",
    show_default=True,
    help="network: LD-Net, CP-Net, DBS-Net, with the exact method where they fall short.",
)
@click.option(
    "--tolerance", type=float, help="Refine a network's map above this landmark error (inf: never)  [default: 0.005]"
)
@click.option("--alpha", type=float, default=Weights.alpha, show_default=True, help="Weight of |mu|^2.")
@click.option("--beta", type=float, default=Weights.beta, show_default=True, help="Weight of |grad mu|^2.")
@click.option("--gamma", type=float, default=Weights.gamma, show_default=True, help="Weight of the landmark mismatch.")
@click.option("--delta", type=float, default=DELTA, show_default=True, help="Weight of the features' mismatch.")
@click.option(
    "--feature",
    "given",
    nargs=2,
    multiple=True,
    metavar="MOVING CONTROL[:WEIGHT]",
    help="Per-vertex files, one a side, that shall lie on each other (lh.sulc, thickness, ...); repeatable. "
    "depth depth, curvature curvature: computed  [default: these two]",
)
@click.option("--no-features", is_flag=True, help="Landmarks alone, the paper's setting.")
@click.option("--no-landmarks", is_flag=True, help="Features alone.")
@click.option("--hold-out", multiple=True, metavar="NAME", help="A curve that is measured and not fitted; repeatable.")
@click.option(
    "--annot",
    nargs=2,
    metavar="MOVING CONTROL",
    help="Annotations (.annot, .label.gii), compared by their regions' names; they take no part in the fit.",
)
@click.option("--sliding", is_flag=True, help="Let inner points slide along their target curves.")
@click.option("--mirror", is_flag=True, help="Mirror the moving surface first (right onto left).")
@click.option("--accept-suspect", is_flag=True, help="End with exit code 0 where the registration is suspect.")
def register(
    moving, control, landmarks, out, mirror, accept_suspect, given, annot, no_features, no_landmarks, **options
):
    """Register MOVING to CONTROL along landmark curves; writes a certified point-to-point map.

    \b
    Exit codes: 0  registered
                2  refused: one line on stderr says what, where and what to do; nothing is written
                3  written, but suspect: one line on stderr, and "suspect" in report.json, say why

    \b
    A registration is suspect where
      mirror:      the curves, or with fewer than three the folds, fit the mirrored moving surface much better, or the
                   files' names or metadata say that one is a left and the other a right: --mirror was forgotten
      exchanged:   the curves fit much better with MOVING and CONTROL exchanged
      numbering:   they fit much better as vertex numbers of the whole surface, before `open` cut it
      reversed:    a curve fits much better run from its other end
      swapped:     curves fit much better with each other's names
      error:       the landmarks end over 3 mm from their targets, and most of it was there before
      curve:       one curve ends over 5 mm from its target, and five times as far as the median one
      rows:        the map folded, and was repaired at more than 0.5 % of the vertices
      distortion:  |mu| is over 0.9 on more than 1 % of the surface
      features:    those of the two sides hardly agree after the best Möbius map, or have opposite signs
      worse:       a held-out curve or the annotations fit clearly worse than after the best Möbius map
    """
    if no_landmarks and landmarks:
        raise qc.LandmarkError("--landmarks and --no-landmarks exclude each other; drop one")
    features = given_features(given, no_features)
    inputs = {side: (path, qc.read_surface(path)) for side, path in (("moving", moving), ("control", control))}
    surfaces = [surface for _, surface in inputs.values()]
    curves = read_landmarks(landmarks) if landmarks else [] if no_landmarks else shared_curves(*surfaces)
    surfaces[0] = qc.mirror(surfaces[0]) if mirror else surfaces[0]
    options["annotations"] = [read_regions(path) for path in annot] if annot else None
    wrong = other_hand(moving, control, mirror)
    register_into(out, surfaces, curves, inputs, accept_suspect, wrong, features=features, **options)


@click.command()
@click.option("--out", default="qclearn-demo", show_default=True, help="Folder to write to.")
@click.option("--accept-suspect", is_flag=True, help="End with exit code 0 where the registration is suspect.")
def demo(out, accept_suspect):
    """Register real cortex: fsaverage5's right hemisphere, mirrored, onto its left one along six named sulci.

    Five more take no part and are measured.
    """
    right, left, landmarks = qc.fsaverage5("right"), qc.fsaverage5("left"), qc.demo_landmarks()
    hold_out = [curve["name"] for curve in landmarks["curves"][1::2]]
    inputs = {"moving": ("fsaverage5 right", right), "control": ("fsaverage5 left", left)}
    register_into(out, (qc.mirror(right), left), landmarks, inputs, accept_suspect, hold_out=hold_out)


def given_features(files, none):
    """Features of the options --feature and --no-features; by default the folds."""
    delta = click.get_current_context().get_parameter_source("delta") is ParameterSource.COMMANDLINE
    for option, used in (("--feature", files), ("--delta", delta)):
        if used and none:
            raise FeatureError(f"{option} and --no-features exclude each other; drop one")
    return None if none else [given_feature(*pair) for pair in files] or FOLDS


def given_feature(moving, control):
    """A `Feature` from two files, or a name of FOLDS given twice, with the weight behind the colon."""
    path, colon, weight = control.rpartition(":")
    try:
        control, weight = (path, float(weight)) if colon else (control, 1.0)
    except ValueError:  # a colon in the path
        weight = 1.0
    if moving == control and moving in FOLDS:
        return moving, weight
    return Feature(Path(moving).name, qc.read_values(moving), qc.read_values(control)), weight


def other_hand(moving, control, mirror):
    """`mirror:` where the files of both sides say their hemisphere and --mirror does not go with that, list."""
    sides = [frame_of(path).side for path in (moving, control)]
    if None in sides or (sides[0] != sides[1]) == mirror:
        return []
    found = f"{moving} is a {sides[0]} and {control} a {sides[1]} hemisphere by their names or metadata"
    return [
        f"mirror: {found}; {'leave --mirror out' if mirror else 'give --mirror'}, or name the files for what they hold"
    ]


def register_into(out, surfaces, curves, inputs, accept_suspect, wrong=(), **options):
    """Run the pipeline, write its four files, print the report; exit code 3 if suspect. surfaces: moving and control;
    inputs: as of `origin`; wrong: the reason of `other_hand`, in the place of what the fit says of that."""
    from ..pages.plot import registration_figure

    with output_folder(out) as folder:
        result = run_registration(*surfaces, curves, progress=True, **options)
        registration_figure(result, *surfaces).savefig(folder / "figure.png", dpi=150)
        write_registration(folder / "registration.npz", {name: getattr(result, name) for name in MAPS})
        words = [word for word in result.report["suspect"] if not (wrong and word.startswith("mirror:"))]
        report = result.report | {"suspect": [*wrong, *words]} | origin(inputs, curves, click.get_current_context().obj)
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n")
        path = inputs["control"][0]  # its coordinates are the registered surface's; the demo's control is no file
        frame = frame_of(path) if Path(path).is_file() else Frame("left")
        qc.write_surface(folder / "registered.surf.gii", result.surface, frame=frame)
    print_report(report, out)
    if report["suspect"]:
        fail("suspect: " + "; ".join(report["suspect"]), 0 if accept_suspect else 3)


def print_report(report, out):
    """The figures a user asks first, a line each."""

    def line(head, text):
        click.echo(f"{head:15s} {text}")

    if report["curves"]:
        before, after = report["landmark_error_before"], report["landmark_error"]
        disk = f"{after:.2e} in the disk ({before:.2e} after the best Möbius map)"
        line("landmark error", f"{disk}, {report['landmark_error_mm']:.2f} mm")
    if report["held_out_mm"]:
        before, after = np.mean(list(report["held_out_mm"].values()), axis=0)
        line("held out", f"{after:.2f} mm, mean of the curves ({before:.2f} after the best Möbius map)")
    if report["dice"]:
        before, after = report["dice"]["before"], report["dice"]["after"]
        line("Dice", f"{after:.3f} of the annotations ({before:.3f} after the best Möbius map)")
    for name, (before, after) in report["r"].items():
        line(f"r({name})", f"{after:.3f} ({before:.3f} after the best Möbius map)")
    mean, deviation, most = (report[f"{word}_abs_mu"] for word in ("mean", "sd", "max"))
    line("|mu|", f"mean {mean:.3f}, SD {deviation:.3f}, maximum {most:.3f}")
    faces = f"{report['flipped']} faces flipped, {report['degenerate']} without area on the control"
    line("bijective", f"{'yes' if report['bijective'] else 'no'}, {faces}")
    line("fallbacks", "; ".join(report["fallbacks"]) or "none")
    line("suspect", "; ".join(word.split(":")[0] for word in report["suspect"]) or "no")
    line("seconds", f"{report['seconds']['total']:.1f}")
    line("written to", out)


def shared_curves(moving, control):
    """Landmarks from the curves that both surfaces carry under the same name."""
    curves = curves_of_both(moving, control)
    if not curves:
        raise qc.LandmarkError("the surfaces share no curve names (curve_<name> in their npz files); give --landmarks")
    return {"curves": curves}
