"""`qclearn template`: from many surfaces to a folder with their template and registrations."""

import json
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np

import qclearn as qc

from ..group.members import TRAITS
from ..io.frames import Frame
from ..io.mapfile import side_arrays, write_registration
from ..io.meshes import frame_of
from ..io.safe import npz_arrays, read_bytes
from ..registration.features import FOLDS
from ..registration.problem import DELTA_BY_DISKS
from .given import units_option
from .output import fail, output_folder, say


@click.command()
@click.argument("subjects", nargs=-1, required=True)
@click.option("--out", required=True, help="Folder to write to.")
@click.option(
    "--mirror", multiple=True, metavar="SUBJECT", help="Mirror one first (right to left)."
)
@units_option
@click.option(
    "--feature",
    "features",
    multiple=True,
    type=click.Choice(FOLDS),
    default=FOLDS,
    help="What is matched; repeatable.",
)
@click.option("--rounds", type=int, default=4, help="At most so many; 0: Möbius maps alone.")
@click.option(
    "--delta", type=float, default=DELTA_BY_DISKS, help="Weight of the features' mismatch."
)
@click.option("--scheduler", help="Address of a dask scheduler, `tcp://HOST:8786`.")
@click.option("--workers", type=int, default=2, help="Processes, without --scheduler.")
def template(subjects, out, mirror, units, **options):
    """Make an unbiased template of SUBJECTS, surface files of disks of one side.

    The folder gets template.npz, report.json and a registration-NN.npz per subject, and rounds/,
    by which a stopped run goes on. Exit code 3 if a subject is left out because its registration
    folds or is suspect: one line on stderr names it.
    """
    unknown = sorted(set(mirror) - set(subjects))
    if unknown:
        raise click.UsageError(f"--mirror {unknown[0]}: not one of the subjects")
    twice = next((path for path in subjects if subjects.count(path) > 1), None)
    if twice is not None:
        raise click.UsageError(f"{twice}: a subject is given twice; give each once")
    members = {path: member_of(path, path in mirror, units) for path in subjects}
    with output_folder(out) as place:
        made = qc.template(members, folder=Path(out) / "rounds", progress=True, **options)
        write_template(place, made, members)
    print_rounds(made.report, out)
    if made.left_out:
        messages = [f"{name}: {reasons[0]}" for name, reasons in made.left_out.items()]
        fail(f"left out: {'; '.join(messages)}", 3)


def member_of(path, mirrored, units):
    """A subject with the TRAITS that its file names."""
    surface, frame = qc.read_surface(path, units), frame_of(path)
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
    """Write a `Template`; `qclearn transfer` reads the registrations."""
    mean = {"vertices": made.surface.vertices, "faces": made.surface.faces, "disk": made.disk}
    means = {f"map_{name}": values for name, values in made.maps.items()}
    np.savez_compressed(folder / "template.npz", **mean, **means)
    files = {
        name: f"registration-{number:02d}.npz"
        for number, name in enumerate(members, 1)
        if name in made.disk_maps
    }
    for name, file in files.items():
        member = members[name]
        disks = {"disk_moving": made.disks[name], "disk_map": made.disk_maps[name]}
        disks["disk_control"] = made.disk
        faces = {"faces_moving": member.surface.faces, "faces_control": mean["faces"]}
        sides = side_arrays("moving", member.surface, member.frame)
        sides |= side_arrays("control", made.surface, Frame())
        mirrored = {"mirrored": np.array(member.mirrored)}
        write_registration(folder / file, disks | faces | sides | mirrored)
    (folder / "report.json").write_text(json.dumps(made.report | {"files": files}, indent=2) + "\n")


def print_rounds(report, out):
    """Print a line per round, and whether the template has converged."""
    say("round  moved, mm  " + "  ".join(f"r({name})  variance" for name in report["features"]))
    for number, row in enumerate(report["rounds"]):
        r = [f"{row['r'].get(name, np.nan):{len(name) + 3}.3f}" for name in report["features"]]
        variance = [f"{row['variance'][name]:8.3g}" for name in report["features"]]
        say(f"{number:5}  {row['moved_mm']:9.2f}  " + "  ".join(map("  ".join, zip(r, variance))))
    say("it stands still" if report["settled"] else "it still moves: give more --rounds")
    say(f"written to {out}")
