"""`qclearn register` and `demo`: a pair of surfaces to a folder with the map, the report and the
figure."""

import json
import time
from dataclasses import dataclass, replace
from functools import cached_property

import click
import numpy as np

import qclearn as qc

from ..io.hemisphere import Hemisphere, read_hemisphere
from ..io.provenance import origin
from ..registration.curves import curves_of_both, on_disks, read_landmarks
from ..registration.problem import BY_DISKS, DELTA, ETA, INDIVIDUAL, Weights
from ..registration.register import Stages
from ..registration.register import register as run_registration
from ..registration.transfer import side_arrays, write_registration
from .given import given_features, given_weights, regions_of
from .output import fail, output_folder
from .sphere import FILES as SPHERES
from .sphere import ControlSphere, sphere_of, write_sphere

MAPS = (
    "points",
    "disk_moving",
    "disk_control",
    "disk_map",
    "mu",
    "faces_moving",
    "faces_control",
)  # that are written
SURE = "uncertainty.shape.gii"


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option(
    "--cortex", metavar="FILE", help="lh.cortex.label of a whole MOVING, which is cut open by it."
)
@click.option("--control-cortex", metavar="FILE", help="The same of a whole CONTROL.")
@click.option(
    "--landmarks",
    help="JSON file of curves; without it, those that both npz surfaces carry, or none.",
)
@click.option(
    "--out",
    required=True,
    help="Folder for registration.npz, report.json, registered.surf.gii, figure.png.",
)
@click.option(
    "--method",
    type=click.Choice(["exact", "network"]),
    default="exact",
    show_default=True,
    help="network: LD-Net, CP-Net, DBS-Net, with the exact method where they fall short.",
)
@click.option(
    "--tolerance",
    type=float,
    help="Refine a network's map above this landmark error (inf: never)  [default: 0.005]",
)
@click.option(
    "--alpha", type=float, default=Weights.alpha, show_default=True, help="Weight of |mu|^2."
)
@click.option(
    "--beta", type=float, default=Weights.beta, show_default=True, help="Weight of |grad mu|^2."
)
@click.option(
    "--gamma",
    type=float,
    default=Weights.gamma,
    show_default=True,
    help="Weight of the landmark mismatch.",
)
@click.option(
    "--delta",
    type=float,
    help=f"Weight of the features' mismatch  [default: {DELTA:g}, or {BY_DISKS:g} with --eta 0]",
)
@click.option(
    "--eta",
    type=float,
    help=f"Weight of areas, mean (log J)^2  [default: {ETA:g} with features, else 0]",
)
@click.option(
    "--individual",
    is_flag=True,
    help="Weights for one person's brain onto a template: --"
    + " --".join(f"{name} {value:g}" for name, value in INDIVIDUAL.items()),
)
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
@click.option(
    "--hold-out",
    multiple=True,
    metavar="NAME",
    help="A curve that is measured and not fitted; repeatable.",
)
@click.option(
    "--annot",
    nargs=2,
    metavar="MOVING CONTROL",
    help="Annotations (.annot, .label.gii), compared by their regions' names; they take no part in the fit.",
)
@click.option(
    "--uncertainty",
    is_flag=True,
    help="Also how far the map may be off at each vertex: uncertainty.shape.gii, in mm.",
)
@click.option("--sliding", is_flag=True, help="Let inner points slide along their target curves.")
@click.option("--mirror", is_flag=True, help="Mirror the moving surface first (right onto left).")
@click.option(
    "--report", is_flag=True, help="Write report.html, too: one page to look at, without a network."
)
@click.option(
    "--sphere", metavar="FILE", help="The control's sphere: also writes what `qclearn sphere` does."
)
@click.option(
    "--accept-suspect",
    is_flag=True,
    help="Fit wrong landmarks, too, and end with exit code 0 where the registration is suspect.",
)
def register(
    moving,
    control,
    landmarks,
    out,
    mirror,
    accept_suspect,
    given,
    annot,
    no_features,
    no_landmarks,
    individual,
    **options,
):
    """Register MOVING to CONTROL by their folds and along landmark curves; writes a certified
    point-to-point map.

    Each is a surface file, or fsaverage5:left or fsaverage5:right. Landmarks and per-vertex files
    belong to the surfaces as given: to a whole one, those of the whole one.

    \b
    Exit codes: 0  registered
                2  refused: one line on stderr says what, where and what to do; nothing is written
                3  written, but suspect: one line on stderr, and "suspect" in report.json, say why

    \b The first five words below are said before the fit, which is then not made: what is written
    is the map that aligns the curves' ends, and "stopped" in report.json says so. --accept-suspect
    fits all the same.

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
    cortex = {
        side: options.pop(name)
        for side, name in (("moving", "cortex"), ("control", "control_cortex"))
    }
    pair = Pair(
        read_hemisphere(moving, cortex["moving"]),
        read_hemisphere(control, cortex["control"]),
        mirror,
    )
    sphere = options.pop("sphere")
    pair = replace(pair, sphere=sphere and sphere_of(pair, sphere))
    features = given_features(pair, given, no_features, options["delta"])
    curves = (
        read_landmarks(landmarks)
        if landmarks
        else []
        if no_landmarks
        else shared_curves(pair, features)
    )
    options["annotations"] = (
        [regions_of(*one) for one in zip(pair.given.values(), annot)] if annot else None
    )
    options |= given_weights(no_features) if individual else {}
    register_into(out, pair, curves, accept_suspect, features=features, **options)


@click.command()
@click.option("--out", default="qclearn-demo", show_default=True, help="Folder to write to.")
@click.option(
    "--report", is_flag=True, help="Write report.html, too: one page to look at, without a network."
)
@click.option(
    "--accept-suspect",
    is_flag=True,
    help="Fit wrong landmarks, too, and end with exit code 0 where the registration is suspect.",
)
def demo(out, accept_suspect, report):
    """Register real cortex: fsaverage5's right hemisphere, mirrored, onto its left one along six
    named sulci.

    Five more take no part and are measured.
    """
    landmarks = qc.demo_landmarks()
    hold_out = [curve["name"] for curve in landmarks["curves"][1::2]]
    moving, control = (read_hemisphere(f"fsaverage5:{side}").cut for side in ("right", "left"))
    pair = Pair(moving, control, mirrored=True)
    register_into(out, pair, landmarks, accept_suspect, hold_out=hold_out, report=report)


@dataclass(frozen=True, eq=False)
class Pair:
    """The two `Hemisphere`s of a call, whether the moving one is mirrored, and the control's sphere
    if it is wanted."""

    moving: Hemisphere
    control: Hemisphere
    mirrored: bool
    sphere: ControlSphere | None = None

    @cached_property
    def disks(self):
        """The moving and the control surface as they are registered."""
        return qc.mirror(self.moving.disk) if self.mirrored else self.moving.disk, self.control.disk

    @property
    def given(self):
        """Side -> `Hemisphere`."""
        return {"moving": self.moving, "control": self.control}

    @property
    def other_hand(self):
        """`mirror:` where the files of both sides say their hemisphere and `mirrored` does not go
        with that, list."""
        one, other = (side.frame.side for side in self.given.values())
        if None in (one, other) or (one != other) == self.mirrored:
            return []
        found = f"{self.moving.path} is a {one} and {self.control.path} a {other} hemisphere by their names or metadata"
        advice = f"{'leave --mirror out' if self.mirrored else 'give --mirror'}, or name the files for what they hold"
        return [f"mirror: {found}; {advice}"]

    @property
    def arrays(self):
        """What registration.npz keeps of the surfaces."""
        moving, control = self.disks
        sides = side_arrays("moving", moving, self.moving.frame) | side_arrays(
            "control", control, self.control.frame
        )
        return sides | {"mirrored": np.array(self.mirrored)}


def register_into(out, pair, curves, accept_suspect, **options):
    """Run the pipeline on a `Pair`, write its files, with option `report` a page too, and print the
    report; exit code 3 if suspect."""
    from ..plot import registration_figure

    command = click.get_current_context().obj
    stages = Stages(2, False)
    paged = options.pop("report")
    read = time.perf_counter() - command.begun
    with output_folder(out, instead=["report.html", SURE, *SPHERES]) as folder:
        result = run_registration(
            *pair.disks,
            on_disks(curves, pair.given),
            progress=True,
            accept_suspect=accept_suspect,
            **options,
        )
        with stages("figure"):
            registration_figure(result, *pair.disks).savefig(folder / "figure.png", dpi=150)
        with stages("write"):
            told = write_maps(folder, result, pair)
            report = told_by(result, pair, curves, command)
        spent = {"read": round(read, 4), **report["seconds"], **stages.seconds}
        del spent["total"]  # of the call alone
        report["seconds"] = {**spent, "total": round(time.perf_counter() - command.begun, 4)}
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n")
        if paged:
            from ..reports import write_pair

            write_pair(folder, folder / "report.html")
    print_report(report, out)
    if told:
        click.echo(f"{'sphere':15s} {told}")
    if report["suspect"]:
        fail("suspect: " + "; ".join(report["suspect"]), 0 if accept_suspect else 3)


def write_maps(folder, result, pair):
    """Write the maps of a `Registration`, and its sphere if the `Pair` has the control's; a line on
    that, or None."""
    arrays = {name: getattr(result, name) for name in MAPS} | pair.arrays
    write_registration(folder / "registration.npz", arrays)
    qc.write_surface(folder / "registered.surf.gii", result.surface, frame=pair.control.frame)
    if result.uncertainty is not None:
        numbering = pair.moving.numbering
        radius = result.sure.astype(np.float32)
        whole = numbering.on_whole(radius, np.nan) if numbering.known else radius
        qc.write_values(folder / SURE, whole, pair.moving.frame.side, names=["radius of 90 %, mm"])
    return pair.sphere and write_sphere(folder, arrays, pair.sphere)


def told_by(result, pair, curves, command):
    """The report of a `Registration` with its origin; what files say of their hands counts before
    what folds say, and vertices are told by their numbers in the surface as given."""
    wrong = pair.other_hand
    words = [
        word for word in result.report["suspect"] if not (wrong and word.startswith("mirror:"))
    ]
    inputs = {side: (one.path, one.given) for side, one in pair.given.items()}
    report = result.report | {"suspect": [*wrong, *words]} | origin(inputs, curves, command)
    if result.uncertainty is not None and pair.moving.given is not pair.moving.disk:
        further = report["uncertainty"]["next"]
        told = further | {"vertex": int(pair.moving.numbering.table[further["vertex"]])}
        report["uncertainty"] = report["uncertainty"] | {"next": told}
    return report


def print_report(report, out):
    """The figures a user asks first, a line each."""

    def line(head, text):
        click.echo(f"{head:15s} {text}")

    if report["curves"]:
        before, after = report["landmark_error_before"], report["landmark_error"]
        disk = f"{after:.2e} in the disk ({before:.2e} after the best Möbius map)"
        line("landmark error", f"{disk}, {report['landmark_error_mm']:.2f} mm")
    elif not report["stopped"]:
        line("landmarks", f"none; registered by {' and '.join(report['features'])} alone")
    if report["held_out_mm"]:
        before, after = np.mean(list(report["held_out_mm"].values()), axis=0)
        line(
            "held out",
            f"{after:.2f} mm, mean of the curves ({before:.2f} after the best Möbius map)",
        )
    if report["dice"]:
        before, after = report["dice"]["before"], report["dice"]["after"]
        line("Dice", f"{after:.3f} of the annotations ({before:.3f} after the best Möbius map)")
    for name, (before, after) in report["r"].items():
        line(f"r({name})", f"{after:.3f} ({before:.3f} after the best Möbius map)")
    mean, deviation, most = (report[f"{word}_abs_mu"] for word in ("mean", "sd", "max"))
    line("|mu|", f"mean {mean:.3f}, SD {deviation:.3f}, maximum {most:.3f}")
    faces = f"{report['flipped']} faces flipped, {report['degenerate']} without area on the control"
    line("bijective", f"{'yes' if report['bijective'] else 'no'}, {faces}")
    if "uncertainty" in report:
        least, _, most = report["uncertainty"]["quantiles_mm"].values()
        line(
            "sure",
            f"within {report['sure']['mean_mm']:.1f} mm on average, 9 in 10 vertices ({least:.1f} "
            f"to {most:.1f})",
        )
    if report["stopped"]:
        line("stopped", report["stopped"])
    line("fallbacks", "; ".join(report["fallbacks"]) or "none")
    line("suspect", "; ".join(word.split(":")[0] for word in report["suspect"]) or "no")
    line("seconds", f"{report['seconds']['total']:.1f}")
    line("written to", out)


def shared_curves(pair, features):
    """Landmarks from the curves that both surfaces carry under the same name, or none, where there
    are features."""
    curves = curves_of_both(pair.moving.disk, pair.control.disk)
    if not curves and features is None:
        raise qc.LandmarkError(
            "the surfaces share no curve names (curve_<name> in their npz files); give --landmarks"
        )
    return {"curves": curves}
