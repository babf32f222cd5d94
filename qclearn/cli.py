"""The command line: `qclearn register`, `open`, `transfer`, `demo`, ...

One line on stderr and exit code 2 for bad input; exit code 3 for a registration that is written, but suspect.
"""

import json
import os
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import click
import numpy as np
from tqdm import tqdm

import qclearn as qc

from .files.meshes import Frame, frame_of
from .files.provenance import origin
from .files.safe import full_disk, is_full, own_prefix, printable, sweep
from .files.values import read_labels
from .registration.landmarkfile import read_landmarks
from .registration.landmarks import curves_of_both
from .registration.mapfile import read_registration, write_registration
from .registration.register import register as run_registration
from .registration.transfer import transfer as transfer_map

# SurfaceError, LandmarkError, BeltramiError and BijectivityError are ValueErrors; ImportError: torch may be missing
USER_ERRORS = (ValueError, OSError, ImportError)


def main(arguments=None):
    """Entry point: runs a command; bad input becomes one line on stderr and exit code 2."""
    try:
        command = ["qclearn", *(sys.argv[1:] if arguments is None else arguments)]
        cli.main(arguments, prog_name="qclearn", standalone_mode=False, obj=command)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.Abort:
        fail("interrupted", 130)
    except click.ClickException as error:
        fail(f"{error.format_message()} (qclearn --help lists the commands)")
    except MemoryError:
        fail("there is not enough memory for this; close other programs, use a machine with more, or coarser surfaces")
    except USER_ERRORS as error:
        fail(str(error))


def fail(message, code=2):
    """Print one line on stderr and leave."""
    print("qclearn: " + printable(message), file=sys.stderr)
    sys.exit(code)


def say(line):
    """Print one line on stdout, with names and paths in it made harmless to the terminal."""
    click.echo(printable(line))


@click.group(no_args_is_help=False)
@click.version_option(version("qclearn"))
def cli():
    """Quasi-conformal registration of cortical surfaces."""


@contextmanager
def output_folder(path):
    """A temporary folder whose files move to `path` together once the block has ended without an error."""
    path = Path(path)
    there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
    try:
        sweep(there)
        temporary = tempfile.TemporaryDirectory(dir=there, prefix=own_prefix())
    except OSError as error:
        if is_full(error):
            raise OSError(f"{path}: {full_disk(there, 0)}") from None
        raise OSError(f"{path}: not a folder that can be written to ({error.strerror}); give another --out") from None
    with temporary as folder:
        try:
            yield Path(folder)
            path.mkdir(parents=True, exist_ok=True)
            for file in Path(folder).iterdir():
                os.replace(file, path / file.name)
        except OSError as error:
            if not is_full(error):
                raise
            written = sum(file.stat().st_size for file in Path(folder).iterdir())
            raise OSError(f"{path}: {full_disk(there, written)}") from None


@cli.command()
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
    "--tolerance",
    type=float,
    help="Landmark error in the disk above which a network's map is refined by "
    "Gauss-Newton steps (inf: never)  [default: 0.005]",
)
@click.option("--alpha", type=float, default=1.0, show_default=True, help="Weight of |mu|^2.")
@click.option("--beta", type=float, default=1e-2, show_default=True, help="Weight of |grad mu|^2.")
@click.option("--gamma", type=float, default=1e5, show_default=True, help="Weight of the landmark mismatch.")
@click.option("--sliding", is_flag=True, help="Let inner points slide along their target curves.")
@click.option("--mirror", is_flag=True, help="Mirror the moving surface first (right onto left).")
@click.option("--accept-suspect", is_flag=True, help="End with exit code 0 where the registration is suspect.")
def register(moving, control, landmarks, out, mirror, accept_suspect, **options):
    """Register MOVING to CONTROL along landmark curves; writes a certified point-to-point map.

    \b
    Exit codes: 0  registered
                2  refused: one line on stderr says what, where and what to do; nothing is written
                3  written, but suspect: one line on stderr, and "suspect" in report.json, say why

    \b
    A registration is suspect where
      mirror:      the curves fit the mirrored moving surface much better: --mirror was forgotten
      exchanged:   they fit much better with MOVING and CONTROL exchanged
      numbering:   they fit much better as vertex numbers of the whole surface, before `open` cut it
      reversed:    a curve fits much better run from its other end
      swapped:     curves fit much better with each other's names
      error:       the landmarks end over 3 mm from their targets, and most of it was there before
      curve:       one curve ends over 5 mm from its target, and five times as far as the median one
      rows:        the map folded, and was repaired at more than 0.5 % of the vertices
      distortion:  |mu| is over 0.9 on more than 1 % of the surface
    """
    inputs = {side: (path, qc.read_surface(path)) for side, path in (("moving", moving), ("control", control))}
    surfaces = [surface for _, surface in inputs.values()]
    curves = read_landmarks(landmarks) if landmarks else shared_curves(*surfaces)
    surfaces[0] = qc.mirror(surfaces[0]) if mirror else surfaces[0]
    register_into(out, *surfaces, curves, inputs, accept_suspect, **options)


@cli.command()
@click.option("--out", default="qclearn-demo", show_default=True, help="Folder to write to.")
@click.option("--accept-suspect", is_flag=True, help="End with exit code 0 where the registration is suspect.")
def demo(out, accept_suspect):
    """Register real cortex: fsaverage5's right hemisphere, mirrored, onto its left one along named sulci."""
    right, left = qc.fsaverage5("right"), qc.fsaverage5("left")
    inputs = {"moving": ("fsaverage5 right", right), "control": ("fsaverage5 left", left)}
    register_into(out, qc.mirror(right), left, qc.demo_landmarks(), inputs, accept_suspect)


def register_into(out, moving, control, curves, inputs, accept_suspect, **options):
    """Run the pipeline, write its four files together, print the report; exit code 3 where the result is suspect.

    inputs: side -> (path, surface as read), for the report.
    """
    from .pages.plot import registration_figure

    with output_folder(out) as folder:
        result = run_registration(moving, control, curves, progress=True, **options)
        figure = registration_figure(result, moving, control)
        figure.savefig(folder / "figure.png", dpi=150)
        write_registration(
            folder / "registration.npz",
            {
                name: getattr(result, name)
                for name in ("points", "disk_moving", "disk_control", "disk_map", "mu", "faces_moving", "faces_control")
            },
        )
        report = result.report | origin(inputs, curves, click.get_current_context().obj)
        (folder / "report.json").write_text(json.dumps(report, indent=2) + "\n")
        qc.write_surface(folder / "registered.surf.gii", result.surface, frame=frame_of_control(inputs["control"]))
    print_report(report, out)
    if report["suspect"]:
        fail("suspect: " + "; ".join(report["suspect"]), 0 if accept_suspect else 3)


def frame_of_control(given):
    """The hemisphere and coordinate system of the control's file, in which the registered surface lies."""
    path, _ = given
    return frame_of(path) if Path(path).is_file() else Frame("left")  # the demo's control


def print_report(report, out):
    """The figures a user asks first, as a few lines."""
    click.echo(
        f"landmark error  {report['landmark_error']:.2e} in the disk "
        f"({report['landmark_error_before']:.2e} after the best Möbius map), {report['landmark_error_mm']:.2f} mm"
    )
    click.echo(
        f"|mu|            mean {report['mean_abs_mu']:.3f}, SD {report['sd_abs_mu']:.3f}, "
        f"maximum {report['max_abs_mu']:.3f}"
    )
    click.echo(
        f"bijective       {'yes' if report['bijective'] else 'no'}, {report['flipped']} faces flipped, "
        f"{report['degenerate']} without area on the control"
    )
    click.echo(f"fallbacks       {'; '.join(report['fallbacks']) or 'none'}")
    click.echo(f"suspect         {'; '.join(word.split(':')[0] for word in report['suspect']) or 'no'}")
    click.echo(f"seconds         {report['seconds']['total']:.1f}")
    click.echo(f"written to      {out}")


def shared_curves(moving, control):
    """Landmarks from the curves that both surfaces carry under the same name."""
    curves = curves_of_both(moving, control)
    if not curves:
        raise qc.LandmarkError("the surfaces share no curve names (curve_<name> in their npz files); give --landmarks")
    return {"curves": curves}


@cli.command("open")
@click.argument("surface")
@click.option("--mask", help="Per-vertex file (.npy, .txt, .gii, .mgh, morphometry): non-zero vertices are cut away.")
@click.option("--label", help="FreeSurfer .label file: its vertices are cut away.")
@click.option("--keep", is_flag=True, help="The file names what to keep (lh.cortex.label, thickness), not what to cut.")
@click.option("--reverse", is_flag=True, help="Reverse every face first (for a surface that is inside out).")
@click.option(
    "--hemisphere", type=click.Choice(["left", "right"]), help="For GIFTI output, where the names do not say it."
)
@click.option("--out", required=True, help="File to write; an npz also keeps the original vertex numbers.")
def open_command(surface, mask, label, keep, reverse, hemisphere, out):
    """Cut a closed hemisphere open at its medial wall, so that it becomes a disk."""
    if (mask is None) == (label is None):
        raise click.UsageError("open needs one of --mask FILE and --label FILE")
    closed = qc.read_surface(surface)
    closed = qc.Surface(closed.vertices, closed.faces[:, ::-1], closed.curves) if reverse else closed
    qc.require_outward(closed)
    mask = qc.read_mask(mask or label, closed, keep)
    opened, original = qc.open_surface(closed, mask)
    frame = frame_of(surface)
    qc.write_surface(out, opened, original_vertices=original, frame=replace(frame, side=hemisphere or frame.side))
    say(f"{out}: {len(opened.vertices)} of {len(closed.vertices)} vertices, boundary of {len(opened.boundary)}")
    if filled := int(mask[original].sum()):
        say(f"{filled} of the mask's {int(mask.sum())} vertices stay: holes away from the opening are filled")


@cli.command()
@click.argument("registration")
@click.argument("values")
@click.option("--to", type=click.Choice(["moving", "control"]), required=True, help="Where the values are carried.")
@click.option(
    "--nearest",
    is_flag=True,
    help="Take the nearest corner's value instead of interpolating; whole numbers (labels, an .annot) need it.",
)
@click.option("--hemisphere", type=click.Choice(["left", "right"]), help="For GIFTI output whose name does not say it.")
@click.option("--out", required=True, help="File to write: .npy, .txt, .gii, .mgh or a FreeSurfer morphometry name.")
def transfer(registration, values, to, nearest, hemisphere, out):
    """Carry a per-vertex map (VALUES) over to the other surface of a REGISTRATION (registration.npz)."""
    maps = read_registration(registration)
    disks = {
        "moving": (maps["disk_map"], maps["faces_moving"]),
        "control": (maps["disk_control"], maps["faces_control"]),
    }
    (z_from, faces_from), (z_to, _) = (disks["control"], disks["moving"])[:: 1 if to == "moving" else -1]
    given = qc.read_values(values)
    if given.dtype.kind in "biu" and not nearest:
        raise ValueError(
            f"{values}: holds whole numbers, which interpolation would blend into others; add --nearest to carry "
            "them as labels, or save them with a decimal point (as floats) to interpolate"
        )
    carried = transfer_map(given, z_from, faces_from, z_to, nearest)
    qc.write_values(out, carried, side=hemisphere, labels=read_labels(values) if nearest else None)
    say(f"{out}: {len(z_to)} values on the {to} surface")


@cli.command()
@click.option("--seed", type=int, help="Which individual (default 0).")
@click.option("--vertices", type=int, default=10_000, show_default=True)
@click.option("--hemisphere", type=click.Choice(["left", "right"]), help="Which side (default left).")
@click.option("--cohort", type=int, help="Instead of one: make the first K subjects of the fixed cohort.")
@click.option("--workers", type=int, default=2, show_default=True, help="Subjects of the cohort made at the same time.")
@click.option("--out", help="File to write (.npz); with --cohort the folder (default: the user's cache).")
def synth(seed, vertices, hemisphere, cohort, workers, out):
    """Grow a synthetic hemisphere with named sulci, or a cohort of them."""
    import data_synth  # here: compiles the growth kernel
    from data_synth.cohort import default_folder

    if cohort is not None:
        if seed is not None or hemisphere is not None:
            raise click.UsageError("a cohort has its own seeds and left hemispheres: drop --seed and --hemisphere")
        folder = Path(out) if out else default_folder()
        subjects = data_synth.cohort(cohort, vertices, folder, workers=workers)
        click.echo(f"{len(subjects)} subjects in {folder}")
        return
    if out is None:
        raise click.UsageError("synth needs --out FILE.npz")
    if Path(out).suffix != ".npz" or Path(out).is_dir():
        raise click.UsageError(f"{out}: synth writes a file whose name ends in .npz; give such an --out")
    if not os.access(Path(out).absolute().parent, os.W_OK):
        raise OSError(f"{out}: its folder does not exist or cannot be written to; make it, or give another --out")
    seed, hemisphere = seed or 0, hemisphere or "left"
    data_synth.save_cortex(out, grow_with_bar(data_synth.make_cortex, seed, vertices, hemisphere))
    click.echo(f"{out}: seed {seed}, {hemisphere}")


@cli.command()
@click.argument("network", type=click.Choice(["ldnet", "cpnet", "dbsnet"]))
@click.option("--preset", type=click.Choice(["best", "paper"]), default="best", show_default=True)
@click.option("--gamma", type=float, help="The paper's CP-Net alone: the weight it is trained for (1e4, 1e5 or 2e5).")
@click.option("--out", required=True, help="Folder of the run; one that was interrupted goes on from its checkpoint.")
@click.option("--data", help="Folder where training sets are kept (default: the user's cache).")
@click.option("--steps", type=int, help="Fewer or more steps than the recipe.")
@click.option("--seed", type=int, help="Another seed than the recipe's.")
@click.option("--quick", is_flag=True, help="A tiny training set, to see that all works.")
@click.option("--threads", type=int, help="Threads of torch (default: all cores).")
def train(network, preset, gamma, out, data, steps, seed, quick, threads):
    """Train a network by the recipe of its shipped weights; writes log, checkpoint and weights. `torchrun` runs it on
    several processes or machines: torchrun --nproc-per-node 2 -m qclearn train dbsnet --out run."""
    from .nets.run import run_training

    path, row = run_training(network, preset, gamma, Path(out), data, steps, seed, quick, threads)
    if path:
        click.echo(
            f"{path}: validation loss {row['validation_loss']:.4g} after {row['step']:.0f} steps, "
            f"{row['seconds']:.0f} s"
        )


@cli.command()
@click.option("--out", required=True, help="JSON file to write; a run that was stopped goes on from FILE.partial.")
@click.option("--subjects", type=int, default=24, show_default=True, help="How many of the synthetic cohort's 24.")
@click.option("--vertices", type=int, default=10_000, show_default=True)
@click.option(
    "--set",
    "sets",
    multiple=True,
    default=["cohort"],
    show_default=True,
    help="cohort, pairs, displacement or fsaverage5; may be repeated.",
)
@click.option(
    "--method",
    "methods",
    multiple=True,
    help="One method in place of all (harmonic, harmonic:weight=2,landmarks=path); may be repeated.",
)
@click.option("--fronts", is_flag=True, help="Also fits along a front of weights, to compare at equal distortion.")
@click.option("--scheduler", help="Address of a dask scheduler, tcp://HOST:8786 (default: processes of this machine).")
@click.option("--workers", type=int, default=2, show_default=True, help="Processes, without --scheduler.")
@click.option("--data", help="Folder where synthetic subjects are kept (default: the user's cache).")
def benchmark(out, subjects, vertices, sets, methods, fronts, scheduler, workers, data):
    """Run registration methods on the same problems and write all figures to one file."""
    from .benchmark.results import summary
    from .benchmark.run import benchmark as run_benchmark
    from .benchmark.run import run_of

    runs = [run_of(text) for text in methods] or None
    results = run_benchmark(
        out, subjects, vertices, sets, runs, scheduler=scheduler, workers=workers, folder=data, fronts=fronts
    )
    click.echo(f"{'run':38} done  certified  landmark error  mean |mu|  near sulci, mm  seconds")
    for name in sets:
        click.echo(f"{name}:")
        for run, line in summary([row for row in results["rows"] if row["set"] == name]).items():
            figures = (line["landmark_error"], line["mean_abs_mu"], line["correspondence_sulci_mm"], line["seconds"])
            cells = [" " * 9 if value is None else f"{value:9.2g}" for value in figures]
            click.echo(
                f"{run:38} {line['pairs'] - line['failed']:2}/{line['pairs']:<2}  {line['certified']:5}      "
                + "  ".join(cells)
            )
    for name, reason in results["provenance"]["left_out"].items():
        click.echo(f"left out: {name}: {reason}")


def grow_with_bar(make_cortex, *arguments):
    """make_cortex in a thread of its own, while a progress bar follows its clock."""
    clock = np.zeros(2, dtype=np.int64)
    with ThreadPoolExecutor(1) as pool, tqdm(desc="growing", delay=2, leave=False) as bar:
        job = pool.submit(make_cortex, *arguments, clock=clock)
        while wait([job], timeout=0.2).not_done:
            bar.total = int(clock[1]) or None
            bar.update(int(clock[0]) - bar.n)
        return job.result()
