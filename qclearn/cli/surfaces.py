"""`qclearn open`, `transfer` and `synth`: surfaces, and values on them."""

import re
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from tqdm import tqdm

import qclearn as qc

from ..io.frames import side_of_name
from ..io.gifti import is_nothing
from ..io.hemisphere import frame_of_whole, opened, require_side
from ..io.mapfile import frame_of_side, numbering_of_side, read_registration
from ..io.meshes import frame_of, read_mesh
from ..io.values import Map, read_map
from ..registration.transfer import transfer as transfer_map
from .given import merge_option, units_option
from .output import file_option, file_to_write, say, warn

AMOUNTS = re.compile(r"(?<![^.])[lr]h\.(area|volume)(?![^.])")  # in a name; not ?h.jacobian_white

hemisphere_option = click.option(
    "--hemisphere", type=click.Choice(["left", "right"]), help="For GIFTI, if no file names it."
)


@click.command("open")
@click.argument("surface")
@click.option(
    "--mask",
    required=True,
    help="A .label, or a map that is not 0 there: the vertices to cut away.",
)
@click.option("--keep", is_flag=True, help="The file says what stays (lh.cortex.label, thickness)")
@click.option("--reverse", is_flag=True, help="Reverse all faces first: the surface is inside out.")
@units_option
@merge_option
@hemisphere_option
@file_option("File; npz and GIFTI store the original numbers, too.")
def open_command(surface, mask, keep, reverse, units, merge, hemisphere, out):
    """Cut a closed hemisphere open at its medial wall, so that it becomes a disk."""
    closed = read_mesh(surface, units, merge)
    closed = closed._replace(faces=closed.faces[:, ::-1]) if reverse else closed
    frame = frame_of(surface)
    hemisphere = agreed(hemisphere, frame.side, surface)
    require_side(mask, frame_of(mask).side, hemisphere, surface)
    mask = qc.read_mask(mask, closed, keep)
    disk, original = opened(surface, closed, mask)
    frame = frame_of_whole(replace(frame, side=hemisphere), closed)
    qc.write_surface(out, disk, original_vertices=original, frame=frame)
    count, rim = len(disk.vertices), len(disk.boundary)
    say(f"{out}: {count} of {len(closed.vertices)} vertices, boundary of {rim}")
    if filled := int(mask[original].sum()):
        holes = "holes away from the opening are filled"
        say(f"{filled} of the mask's {int(mask.sum())} vertices stay: {holes}")
    if lost := int((~mask).sum() - (~mask)[original].sum()):
        reason = "they lie apart from the largest piece, or on its rim alone"
        say(f"{lost} vertices outside the mask go: {reason}")


def agreed(hemisphere, side, name):
    """The value of --hemisphere, or else what the file says; SurfaceError where they differ."""
    if hemisphere and side and hemisphere != side:
        advice = f"leave --hemisphere {hemisphere} out, or correct the name and metadata"
        raise qc.SurfaceError(f"{name}: is of the {side} hemisphere; {advice}")
    return hemisphere or side


@click.command()
@click.argument("registration")
@click.argument("values")
@click.option(
    "--to",
    type=click.Choice(["moving", "control"]),
    required=True,
    help="The surface that gets the values; VALUES belong to the other one.",
)
@click.option("--nearest", is_flag=True, help="The nearest vertex's value; for labels and .annot.")
@click.option(
    "--sum/--mean",
    default=None,
    help="Keep the sum of amounts at vertices, or blend numbers  [default: --sum for ?h.area, ?h.volume]",
)
@hemisphere_option
@click.option(
    "--wall",
    type=click.Choice(["0", "nan", "cut"]),
    default="0",
    help="Value on the medial wall; cut: write the cut-open surface's values alone.",
)
@file_option(".npy, .txt, .gii, .mgh, .annot or a morphometry name.")
def transfer(registration, values, to, nearest, sum, hemisphere, wall, out):
    """Carry the per-vertex file VALUES to the other surface of REGISTRATION, a registration.npz.

    VALUES belong to the whole surface or to the cut-open one. The result is of the whole one if
    the registration knows it, with `cortex.shape.gii` beside it: 1 on the cortex, 0 on the
    medial wall.
    """
    arrays = read_registration(registration)
    z = {"moving": arrays["disk_map"], "control": arrays["disk_control"]}
    numberings = {side: numbering_of_side(arrays, side) for side in z}
    sides = {side: frame_of_side(arrays, side).side for side in z}
    source = "control" if to == "moving" else "moving"
    given = read_map(values)
    require_side(values, given.side, sides[source], f"the {source} surface")
    if given.is_integer and not nearest:
        raise ValueError(
            f"{values}: holds whole numbers, which interpolation would blend into others; add "
            "--nearest to carry them as labels, or save them as floats to interpolate"
        )
    here = numberings[source].on_cut_surface(given.values, values)
    # What FreeSurfer's name calls areas or volumes are amounts, unless they are labels.
    named = not given.is_integer and bool(AMOUNTS.search(Path(values).name))
    sum = named if sum is None else sum
    faces, faces_to = (arrays[f"faces_{side}"] for side in (source, to))
    carried = transfer_map(here, z[source], faces, z[to], nearest, sum, faces_to)
    side = agreed(hemisphere, sides[to], f"the {to} surface")
    labels = given.labels if nearest else None
    carried = Map(carried, side, labels, given.names, given.integer)
    count = write_carried(out, carried, numberings[to], wall)
    on_cortex = f", {len(z[to])} on its cortex" if count > len(z[to]) else ""
    say(f"{out}: {count} values on the {to} surface{on_cortex}")
    if sum:
        kept = f"their sum on the cortex, {np.nansum(here):.6g}, is kept"
        warn(f"{values}: amounts at vertices, carried by area; {kept}; --mean blends the numbers")


def write_carried(out, carried, numbering, wall):
    """Write a `Map` of a disk, for the whole surface if that is known; the number of values."""
    beside = Path(out).with_name("cortex.shape.gii")
    if wall == "nan" and carried.is_integer:
        raise ValueError("--wall nan: labels are whole numbers; leave it out")
    if wall == "nan" and not numbering.known:
        raise ValueError("--wall nan: the whole surface is not known; leave it out")
    if wall == "cut" or not numbering.known:
        qc.write_values(out, *carried)
        return numbering.size
    cortex = numbering.on_whole(np.ones(numbering.size, dtype=np.float32), 0)
    differs = beside.exists() and not np.array_equal(qc.read_values(beside), cortex)
    if differs or Path(out) == beside:
        advice = "choose another folder or name"
        raise qc.SurfaceError(f"{beside}: this surface's cortex would replace it; {advice}")
    labels = carried.labels or {}
    fill = np.nan if wall == "nan" else 0
    if labels and wall != "nan":
        # the key of no region: one that is there, else one that the table does not use
        there = [key for key in (-1, 0) if key in labels and is_nothing(key, labels)]
        free = [key for key in (0, -1, max(labels) + 1) if key not in labels]
        fill = (there + free)[0]
    fill = np.where(carried.integer, fill, 0) if carried.integer else fill
    qc.write_values(out, numbering.on_whole(carried.values, fill), *carried[1:])
    qc.write_values(beside, cortex, carried.side, names=["cortex"])
    return numbering.count


@click.command()
@click.option("--seed", type=int, help="Which individual  [default: 0]")
@click.option("--vertices", type=int, default=10_000, help="Of each hemisphere.")
@click.option(
    "--hemisphere", type=click.Choice(["left", "right"]), help="[default: the name's, or left]"
)
@click.option("--cohort", type=int, help="Instead: the first so many subjects of the cohort.")
@click.option("--generation", type=int, help="Of the generator  [default: other commands' one]")
@click.option("--workers", type=int, default=2, help="Subjects of the cohort at the same time.")
@click.option("--out", help="npz file; with --cohort a folder  [default: the user's cache]")
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
        sizes = cohort, vertices, folder
        subjects = data_synth.cohort(*sizes, workers=workers, generation=generation)
        print(f"{len(subjects)} subjects in {folder}")
        return
    if out is None:
        raise click.UsageError("synth needs --out FILE.npz")
    if Path(out).suffix != ".npz" or Path(out).is_dir():
        advice = "give such an --out"
        raise click.UsageError(f"{out}: synth writes a file whose name ends in .npz; {advice}")
    file_to_write(out)
    seed, hemisphere = seed or 0, agreed(hemisphere, side_of_name(out), out) or "left"
    made = grow_with_bar(data_synth.make_cortex, seed, vertices, hemisphere, generation=generation)
    data_synth.save_cortex(out, made)
    print(f"{out}: seed {seed}, {hemisphere}, generation {generation}")


def grow_with_bar(make_cortex, *arguments, **options):
    """Run make_cortex in a thread, while a progress bar follows its clock."""
    clock = np.zeros(2, dtype=np.int64)
    bar = tqdm(desc="growing", delay=2, disable=None, leave=False)
    with ThreadPoolExecutor(1) as pool, bar:
        job = pool.submit(make_cortex, *arguments, clock=clock, **options)
        while wait([job], timeout=0.2).not_done:
            bar.total = int(clock[1]) or None
            bar.update(int(clock[0]) - bar.n)
        return job.result()
