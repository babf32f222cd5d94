"""`qclearn register` and `demo`: from two surfaces to a folder with map, report and figure."""

import json
import time
from dataclasses import dataclass, replace
from functools import cached_property

import click
import numpy as np

import qclearn as qc

from ..io.hemisphere import Hemisphere, read_hemisphere
from ..io.mapfile import side_arrays, write_registration
from ..io.provenance import origin
from ..io.safe import printable
from ..registration.curves import curves_of_both, on_cut_surfaces, read_landmarks
from ..registration.problem import DELTA, DELTA_BY_DISKS, ETA, Weights
from ..registration.register import Stages
from ..registration.register import register as run_registration
from .given import given_features, merge_option, units_option
from .output import fail, output_folder
from .sphere import FILES as SPHERES
from .sphere import ControlSphere, sphere_of, write_sphere

# The arrays of a `Registration` that registration.npz holds.
MAPS = ["points", "disk_moving", "disk_control", "disk_map", "mu", "faces_moving", "faces_control"]
UNCERTAINTY = "uncertainty.shape.gii"

accept_suspect_option = click.option(
    "--accept-suspect", is_flag=True, help="Also fit wrong landmarks; exit code 0 if suspect."
)
report_option = click.option("--report", is_flag=True, help="Also write the page report.html.")


def refuse_sure(context, parameter, value):
    """Refuse the name that --uncertainty had in version 0.1."""
    if value:
        raise click.UsageError("--sure of version 0.1 is now --uncertainty")


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option("--cortex", metavar="FILE", help="lh.cortex.label of a whole MOVING, to cut it open.")
@click.option("--control-cortex", metavar="FILE", help="The same for a whole CONTROL.")
@units_option
@merge_option
@click.option("--landmarks", help="JSON file of curves  [default: those in both npz, or none]")
@click.option("--out", required=True, help="Folder to write to.")
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
    "[default: depth depth, curvature curvature]",
)
@click.option("--no-features", is_flag=True, help="Landmarks alone, the paper's setting.")
@click.option("--no-landmarks", is_flag=True, help="Features alone.")
@click.option("--hold-out", multiple=True, metavar="NAME", help="Measure a curve, do not fit it.")
@click.option("--uncertainty", is_flag=True, help=f"Also write {UNCERTAINTY}: the 90 % radius, mm.")
@click.option("--sure", is_flag=True, hidden=True, expose_value=False, callback=refuse_sure)
@click.option("--sliding", is_flag=True, help="Let inner points slide along their target curves.")
@click.option("--mirror", is_flag=True, help="Mirror the moving surface first (right onto left).")
@report_option
@click.option("--sphere", metavar="FILE", help="The control's; also do `qclearn sphere`.")
@accept_suspect_option
def register(
    moving, control, cortex, control_cortex, units, merge, landmarks, out, mirror, sphere, **options
):
    """Register MOVING to CONTROL by folds and landmark curves; write a certified map.

    Each of the two is a surface file, or fsaverage5:left or fsaverage5:right. Landmarks and
    per-vertex files have the vertex numbers of the surface as given: whole if it is whole. The
    folder gets registration.npz, report.json, registered.surf.gii and figure.png.

    \b
    Exit codes:
      0  registered
      2  refused: one line on stderr says what, where and what to do; nothing is written
      3  written, but suspect: one line on stderr, and "suspect" in report.json, say why

    The first five reasons below, where they come from curves or folds, are checked before the fit,
    which is then not made: what is written is the map that aligns the curves' ends, and "stopped"
    in report.json says so. --accept-suspect fits all the same.

    \b
    A registration is suspect where
      mirror:      curves or folds fit the mirrored moving surface much better, or the files say left and right
      exchanged:   the curves fit much better with MOVING and CONTROL exchanged
      numbering:   they fit much better as vertex numbers of the whole surface, before `open` cut it
      reversed:    a curve fits much better run from its other end
      swapped:     curves fit much better with each other's names
      error:       the landmarks end over 3 mm from their targets, and most of it was there before
      curve:       one curve ends over 5 mm from its target, and five times as far as the median one
      rows:        the map folded, and was repaired at more than 0.5 % of the vertices
      distortion:  |mu| is over 0.9 on more than 1 % of the surface
      features:    those of the two sides hardly agree, have opposite signs, or lead far from places in space
      worse:       a held-out curve fits clearly worse than after the best Möbius map
      units:       a surface has the length of a hemisphere in metres or micrometres: give --units
    """
    # What is left in options after this goes straight to `qclearn.register`, under its names.
    no_features, no_landmarks = (options.pop(name) for name in ("no_features", "no_landmarks"))
    if no_landmarks and landmarks:
        raise qc.LandmarkError("--landmarks and --no-landmarks exclude each other; drop one")
    files = (moving, cortex), (control, control_cortex)
    hemispheres = [read_hemisphere(*names, units, merge) for names in files]
    pair = Pair(*hemispheres, mirror)
    pair = replace(pair, sphere=sphere and sphere_of(pair, sphere))
    features = given_features(pair, options.pop("given"), no_features, options["delta"])
    curves = [] if no_landmarks else curves_to_fit(pair, features, landmarks)
    register_into(out, pair, curves, features=features, **options)


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
    moving, control = (read_hemisphere(f"fsaverage5:{side}").cut for side in ("right", "left"))
    pair = Pair(moving, control, mirrored=True)
    register_into(out, pair, landmarks, hold_out=hold_out, **options)


@dataclass(frozen=True, eq=False)
class Pair:
    """The two `Hemisphere`s of a call; mirrored: whether the moving one is mirrored first.

    sphere: the control's sphere, None where none is wanted.
    """

    moving: Hemisphere
    control: Hemisphere
    mirrored: bool
    sphere: ControlSphere | None = None

    @cached_property
    def cut_surfaces(self):
        """The moving and the control surface as they are registered."""
        moving = self.moving.cut_surface
        return qc.mirror(moving) if self.mirrored else moving, self.control.cut_surface

    @property
    def given(self):
        """Side -> `Hemisphere`."""
        return {"moving": self.moving, "control": self.control}

    @property
    def wrong_hemisphere(self):
        """A list with the message `mirror:` where the files' hemispheres contradict --mirror."""
        one, other = (side.frame.side for side in self.given.values())
        if None in (one, other) or (one != other) == self.mirrored:
            return []
        return [
            f"mirror: {self.moving.path} is a {one} and {self.control.path} a {other} hemisphere "
            f"by their names or metadata; {'leave --mirror out' if self.mirrored else 'give --mirror'}, "
            "or name the files for what they hold"
        ]

    @property
    def arrays(self):
        """What registration.npz says of the surfaces."""
        sides = side_arrays("moving", self.cut_surfaces[0], self.moving.frame)
        sides |= side_arrays("control", self.cut_surfaces[1], self.control.frame)
        return sides | {"mirrored": np.array(self.mirrored)}


def register_into(out, pair, curves, report, accept_suspect, **options):
    """Register a `Pair`, write the files, print the report; exit code 3 if it is suspect.

    report: also write the page. options: go straight to `qclearn.register`, under its names.
    """
    from ..plot import registration_figure

    command = click.get_current_context().obj
    stages = Stages(2, False)
    read_seconds = time.perf_counter() - command.begun
    with output_folder(out, instead=["report.html", UNCERTAINTY, *SPHERES]) as folder:
        result = run_registration(
            *pair.cut_surfaces,
            on_cut_surfaces(curves, pair.given),
            progress=True,
            accept_suspect=accept_suspect,
            **options,
        )
        with stages("figure"):
            registration_figure(result, *pair.cut_surfaces).savefig(folder / "figure.png", dpi=150)
        with stages("write"):
            sphere_line = write_maps(folder, result, pair)
            contents = full_report(result, pair, curves, command)
        seconds = {"read": round(read_seconds, 4), **contents["seconds"], **stages.seconds}
        del seconds["total"]  # of `run_registration` alone
        total = round(time.perf_counter() - command.begun, 4)
        contents["seconds"] = {**seconds, "total": total}
        (folder / "report.json").write_text(json.dumps(contents, indent=2) + "\n")
        if report:
            from ..reports import write_pair

            write_pair(folder, folder / "report.html")
    print_report(contents, out)
    if sphere_line:
        print(f"{'sphere':15s} {sphere_line}")
    if contents["suspect"]:
        fail("suspect: " + "; ".join(contents["suspect"]), 0 if accept_suspect else 3)


def write_maps(folder, result, pair):
    """Write the maps of a `Registration`; a line on its sphere, or None without one."""
    arrays = {name: getattr(result, name) for name in MAPS} | pair.arrays
    write_registration(folder / "registration.npz", arrays)
    qc.write_surface(folder / "registered.surf.gii", result.surface, frame=pair.control.frame)
    if result.uncertainty is not None:
        numbering = pair.moving.numbering
        radius = result.uncertainty.astype(np.float32)
        whole = numbering.on_whole(radius, np.nan) if numbering.known else radius
        name = "radius of 90 %, mm"
        qc.write_values(folder / UNCERTAINTY, whole, pair.moving.frame.side, names=[name])
    return pair.sphere and write_sphere(folder, arrays, pair.sphere)


def full_report(result, pair, curves, command):
    """The report of a `Registration` with its origin, dict for JSON.

    The hemispheres that files name outrank what the folds suggest. Vertices have the numbers of
    the surface as given.
    """
    wrong = pair.wrong_hemisphere
    reasons = result.report["suspect"]
    reasons = [reason for reason in reasons if not (wrong and reason.startswith("mirror:"))]
    inputs = {side: (one.path, one.given) for side, one in pair.given.items()}
    report = result.report | {"suspect": [*wrong, *reasons]} | origin(inputs, curves, command)
    if result.uncertainty is not None and pair.moving.is_whole:
        following = report["uncertainty"]["next"]
        vertex = int(pair.moving.numbering.table[following["vertex"]])
        report["uncertainty"] = report["uncertainty"] | {"next": following | {"vertex": vertex}}
    return report


def print_report(report, out):
    """The figures a user asks first, a line each."""

    def line(head, text):
        print(f"{head:15s} {printable(text)}")

    if report["curves"]:
        before, after = report["landmark_error_before"], report["landmark_error"]
        disk = f"{after:.2e} in the disk ({before:.2e} after the best Möbius map)"
        line("landmark error", f"{disk}, {report['landmark_error_mm']:.2f} mm")
    elif not report["stopped"]:
        line("landmarks", f"none; registered by {' and '.join(report['features'])} alone")
    if report["held_out_mm"]:
        before, after = np.mean(list(report["held_out_mm"].values()), axis=0)
        text = f"{after:.2f} mm, mean of the curves ({before:.2f} after the best Möbius map)"
        line("held out", text)
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


def curves_to_fit(pair, features, path):
    """The curves of a landmarks file; without one, those that both npz surfaces carry, or none."""
    if path:
        return read_landmarks(path)
    curves = curves_of_both(pair.moving.cut_surface, pair.control.cut_surface)
    if not curves and features is None:
        raise qc.LandmarkError(
            "the surfaces share no curve names (curve_<name> in their npz files); give --landmarks"
        )
    return {"curves": curves}
