"""`qclearn template`: many surfaces to a folder with what they have in common and all their
registrations."""

import json
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np

import qclearn as qc

from ..group.members import TRAITS
from ..io.frames import Frame
from ..io.meshes import frame_of
from ..io.safe import npz_arrays, read_bytes
from ..registration.features import FOLDS
from ..registration.problem import BY_DISKS
from ..registration.transfer import side_arrays, write_registration
from .output import fail, output_folder, say


@click.command()
@click.argument("subjects", nargs=-1, required=True)
@click.option(
    "--out",
    required=True,
    help="Folder for template.npz, report.json and a registration-NN.npz a subject.",
)
@click.option(
    "--mirror",
    multiple=True,
    metavar="SUBJECT",
    help="One of them to mirror first (right onto left).",
)
@click.option(
    "--feature",
    "features",
    multiple=True,
    type=click.Choice(FOLDS),
    default=FOLDS,
    show_default=True,
)
@click.option(
    "--rounds",
    type=int,
    default=4,
    show_default=True,
    help="At most so many; 0: Möbius maps alone.",
)
@click.option(
    "--delta",
    type=float,
    default=BY_DISKS,
    show_default=True,
    help="Weight of the features' mismatch.",
)
@click.option(
    "--folder",
    help="Where finished registrations are kept, to go on with  [default: rounds in --out].",
)
@click.option(
    "--scheduler",
    help="Address of a dask scheduler, tcp://HOST:8786 (default: processes of this machine).",
)
@click.option(
    "--workers", type=int, default=2, show_default=True, help="Processes, without --scheduler."
)
def template(subjects, out, mirror, folder, **options):
    """Make an unbiased template of SUBJECTS (surface files of disks of one side), all registered to
    it.

    Exit code 3 where a subject takes no part, as its registration folds or is suspect: one line on
    stderr says who.
    """
    unknown = sorted(set(mirror) - set(subjects))
    if unknown:
        raise click.UsageError(f"--mirror {unknown[0]}: not one of the subjects")
    if len(set(subjects)) < len(subjects):
        raise click.UsageError("a subject is given twice")
    members = {path: member_of(path, path in mirror) for path in subjects}
    made = qc.template(members, folder=folder or Path(out) / "rounds", progress=True, **options)
    with output_folder(out) as place:
        write_template(place, made, members)
    tell(made.report, out)
    if made.left_out:
        fail(
            "left out: "
            + "; ".join(f"{name}: {reasons[0]}" for name, reasons in made.left_out.items()),
            3,
        )


def member_of(path, mirrored):
    """A subject with the TRAITS that its file says."""
    surface, frame = qc.read_surface(path), frame_of(path)
    known = {"hemisphere": frame.side}
    if Path(path).suffix == ".npz":
        arrays = npz_arrays(read_bytes(Path(path)), lambda name: name in TRAITS)
        known |= {name: array.item() for name, array in arrays.items()}
    if mirrored:
        surface = qc.mirror(surface)
        known["hemisphere"] = {"left": "right", "right": "left"}.get(known["hemisphere"])
    known = {name: value for name, value in known.items() if value is not None}
    return SimpleNamespace(surface=surface, frame=frame, mirrored=mirrored, **known)


def write_template(folder, made, members):
    """template.npz, report.json, and a registration-NN.npz a subject, which `qclearn transfer`
    reads."""
    mean = {"vertices": made.surface.vertices, "faces": made.surface.faces, "disk": made.disk}
    means = {f"map_{name}": values for name, values in made.maps.items()}
    np.savez_compressed(folder / "template.npz", **mean, **means)
    files = {
        name: f"registration-{number:02d}.npz"
        for number, name in enumerate(members, 1)
        if name in made.disk_maps
    }
    for name, file in files.items():
        maps = {
            "disk_moving": made.disks[name],
            "disk_map": made.disk_maps[name],
            "disk_control": made.disk,
        }
        faces = {"faces_moving": members[name].surface.faces, "faces_control": mean["faces"]}
        sides = side_arrays("moving", members[name].surface, members[name].frame)
        sides |= side_arrays("control", made.surface, Frame()) | {
            "mirrored": np.array(members[name].mirrored)
        }
        write_registration(folder / file, maps | faces | sides)
    (folder / "report.json").write_text(json.dumps(made.report | {"files": files}, indent=2) + "\n")


def tell(report, out):
    """Print a line of each round, and whether the template stands still."""
    say("round  moved, mm  " + "  ".join(f"r({name})  variance" for name in report["features"]))
    for number, row in enumerate(report["rounds"]):
        r = [f"{row['r'].get(name, np.nan):{len(name) + 3}.3f}" for name in report["features"]]
        variance = [f"{row['variance'][name]:8.3g}" for name in report["features"]]
        say(f"{number:5}  {row['moved_mm']:9.2f}  " + "  ".join(map("  ".join, zip(r, variance))))
    say("it stands still" if report["settled"] else "it still moves: give more --rounds")
    say(f"written to {out}")
