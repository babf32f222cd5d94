"""`qclearn open`, `transfer` and `synth`: surfaces, and values on them."""

import os
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from tqdm import tqdm

import qclearn as qc

from ..io.hemisphere import frame_of_whole, require_side
from ..io.meshes import frame_of
from ..io.values import Map, read_map
from ..registration.transfer import frame_of_side, numbering_of_side, read_registration
from ..registration.transfer import transfer as transfer_map
from .output import say


@click.command("open")
@click.argument("surface")
@click.option(
    "--mask",
    help="Per-vertex file (.npy, .txt, .gii, .mgh, morphometry): non-zero vertices are cut away.",
)
@click.option("--label", help="FreeSurfer .label file: its vertices are cut away.")
@click.option(
    "--keep",
    is_flag=True,
    help="The file names what to keep (lh.cortex.label, thickness), not what to cut.",
)
@click.option(
    "--reverse", is_flag=True, help="Reverse every face first (for a surface that is inside out)."
)
@click.option(
    "--hemisphere",
    type=click.Choice(["left", "right"]),
    help="For GIFTI output, if no name says it.",
)
@click.option(
    "--out", required=True, help="File to write; an npz also keeps the original vertex numbers."
)
def open_command(surface, mask, label, keep, reverse, hemisphere, out):
    """Cut a closed hemisphere open at its medial wall, so that it becomes a disk."""
    if (mask is None) == (label is None):
        raise click.UsageError("open needs one of --mask FILE and --label FILE")
    closed = qc.read_surface(surface)
    closed = (
        qc.Surface(closed.vertices, closed.faces[:, ::-1], closed.curves) if reverse else closed
    )
    qc.require_outward(closed)
    frame = frame_of(surface)
    require_side(mask or label, frame_of(mask or label).side, hemisphere or frame.side, surface)
    mask = qc.read_mask(mask or label, closed, keep)
    opened, original = qc.open_surface(closed, mask)
    frame = frame_of_whole(replace(frame, side=hemisphere or frame.side), closed)
    qc.write_surface(out, opened, original_vertices=original, frame=frame)
    say(
        f"{out}: {len(opened.vertices)} of {len(closed.vertices)} vertices, boundary of "
        f"{len(opened.boundary)}"
    )
    if filled := int(mask[original].sum()):
        say(
            f"{filled} of the mask's {int(mask.sum())} vertices stay: holes away from the opening "
            "are filled"
        )
    if lost := int((~mask).sum() - (~mask)[original].sum()):
        say(
            f"{lost} vertices outside the mask go: they lie apart from the largest piece, or on "
            "its rim alone"
        )


@click.command()
@click.argument("registration")
@click.argument("values")
@click.option(
    "--to",
    type=click.Choice(["moving", "control"]),
    required=True,
    help="Where the values are carried.",
)
@click.option(
    "--nearest",
    is_flag=True,
    help="Nearest corner's value, not interpolated; labels and .annot need it.",
)
@click.option(
    "--hemisphere",
    type=click.Choice(["left", "right"]),
    help="For GIFTI output, where nothing says it.",
)
@click.option(
    "--wall",
    type=click.Choice(["0", "nan", "cut"]),
    default="0",
    show_default=True,
    help="What stands on the medial wall of a whole surface; cut: the cut-open surface's values alone.",
)
@click.option(
    "--out",
    required=True,
    help="File to write: .npy, .txt, .gii, .mgh, .annot or a FreeSurfer morphometry name.",
)
def transfer(registration, values, to, nearest, hemisphere, wall, out):
    """Carry a per-vertex map (VALUES) over to the other surface of a REGISTRATION
    (registration.npz).

    VALUES may be of the whole surface or of the cut-open one. What comes out is of the whole one
    where the registration knows it, with `cortex.shape.gii` beside it: 1 on the cortex, 0 on the
    medial wall.
    """
    arrays = read_registration(registration)
    z = {"moving": arrays["disk_map"], "control": arrays["disk_control"]}
    numberings = {side: numbering_of_side(arrays, side) for side in z}
    sides = {side: frame_of_side(arrays, side).side for side in z}
    source = "control" if to == "moving" else "moving"
    given = read_map(values)
    require_side(values, given.side, sides[source], f"the {source} surface")
    if given.values.dtype.kind in "biu" and not nearest:
        raise ValueError(
            f"{values}: holds whole numbers, which interpolation would blend into others; add "
            "--nearest to carry "
            "them as labels, or save them with a decimal point (as floats) to interpolate"
        )
    here = numberings[source].on_disk(given.values, values)
    carried = transfer_map(here, z[source], arrays[f"faces_{source}"], z[to], nearest)
    carried = Map(carried, hemisphere or sides[to], given.labels if nearest else None, given.names)
    count = write_carried(out, carried, numberings[to], wall)
    say(
        f"{out}: {count} values on the {to} surface"
        + f", {len(z[to])} on its cortex" * (count > len(z[to]))
    )


def write_carried(out, carried, numbering, wall):
    """Write a `Map` of a disk, in the whole surface's form where it is known, with the cortex
    beside it: how many."""
    beside, labels = Path(out).with_name("cortex.shape.gii"), carried.values.dtype.kind in "biu"
    if wall == "nan" and (labels or not numbering.known):
        reason = (
            "labels are whole numbers"
            if labels
            else "the registration does not know the whole surface"
        )
        raise ValueError(f"--wall nan: {reason}; leave it out")
    if wall == "cut" or not numbering.known:
        qc.write_values(out, *carried)
        return numbering.size
    cortex = numbering.on_whole(np.ones(numbering.size, dtype=np.float32), 0)
    require_same(out, beside, cortex)
    fill = np.nan if wall == "nan" else -1 if -1 in (carried.labels or {}) else 0
    qc.write_values(out, numbering.on_whole(carried.values, fill), *carried[1:])
    qc.write_values(beside, cortex, carried.side, names=["cortex"])
    return numbering.count


def require_same(out, beside, cortex):
    """SurfaceError where the cortex cannot be written beside a file without replacing something
    else."""
    if Path(out) == beside or (
        beside.exists() and not np.array_equal(qc.read_values(beside), cortex)
    ):
        raise qc.SurfaceError(
            f"{beside}: would be replaced by the cortex of this surface; choose another folder or "
            "name"
        )


@click.command()
@click.option("--seed", type=int, help="Which individual (default 0).")
@click.option("--vertices", type=int, default=10_000, show_default=True)
@click.option(
    "--hemisphere", type=click.Choice(["left", "right"]), help="Which side (default left)."
)
@click.option(
    "--cohort", type=int, help="Instead of one: make the first K subjects of the fixed cohort."
)
@click.option(
    "--generation",
    type=int,
    help="Of the generator's constants (default: that of the other commands).",
)
@click.option(
    "--workers",
    type=int,
    default=2,
    show_default=True,
    help="Subjects of the cohort made at the same time.",
)
@click.option(
    "--out", help="File to write (.npz); with --cohort the folder (default: the user's cache)."
)
def synth(seed, vertices, hemisphere, cohort, generation, workers, out):
    """Grow a synthetic hemisphere with named sulci, or a cohort of them."""
    import data_synth  # here: compiles the growth kernel
    from data_synth.cohort import GENERATION, default_folder

    generation = GENERATION if generation is None else generation
    if cohort is not None:
        if seed is not None or hemisphere is not None:
            raise click.UsageError(
                "a cohort has its own seeds and left hemispheres: drop --seed and --hemisphere"
            )
        folder = Path(out) if out else default_folder()
        subjects = data_synth.cohort(
            cohort, vertices, folder, workers=workers, generation=generation
        )
        click.echo(f"{len(subjects)} subjects in {folder}")
        return
    if out is None:
        raise click.UsageError("synth needs --out FILE.npz")
    if Path(out).suffix != ".npz" or Path(out).is_dir():
        raise click.UsageError(
            f"{out}: synth writes a file whose name ends in .npz; give such an --out"
        )
    if not os.access(Path(out).absolute().parent, os.W_OK):
        raise OSError(
            f"{out}: its folder does not exist or cannot be written to; make it, or give another "
            "--out"
        )
    seed, hemisphere = seed or 0, hemisphere or "left"
    made = grow_with_bar(data_synth.make_cortex, seed, vertices, hemisphere, generation=generation)
    data_synth.save_cortex(out, made)
    click.echo(f"{out}: seed {seed}, {hemisphere}, generation {generation}")


def grow_with_bar(make_cortex, *arguments, **options):
    """Run make_cortex in a thread, while a progress bar follows its clock."""
    clock = np.zeros(2, dtype=np.int64)
    with ThreadPoolExecutor(1) as pool, tqdm(desc="growing", delay=2, leave=False) as bar:
        job = pool.submit(make_cortex, *arguments, clock=clock, **options)
        while wait([job], timeout=0.2).not_done:
            bar.total = int(clock[1]) or None
            bar.update(int(clock[0]) - bar.n)
        return job.result()
