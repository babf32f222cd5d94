"""`qclearn landmarks`: a landmarks file from labels, points in mm, or fsaverage5's own curves."""

import json
from pathlib import Path

import click
import numpy as np

import qclearn as qc

from ..io.frames import TKR, side_of_name
from ..io.hemisphere import read_hemisphere, require_side
from ..io.safe import NOT_PLAIN, is_plain_name, write_whole
from ..io.values import read_label
from ..registration.curves import (
    SCANNER,
    SIDES,
    check_curves,
    nearest_vertices,
    read_points,
    spaces,
)
from ..registration.landmark_sources import carried, ends_apart, ordered, pair_by_folds, threaded
from ..surfaces.checks import counted
from ..surfaces.units import other_units
from .given import merge_option, units_option
from .output import file_option, say

DOUBT = 0.6  # of the ends' distance when reversed: 0.02 to 0.42 on known curves of two people


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option("--cortex", metavar="FILE", help="lh.cortex.label of a whole MOVING.")
@click.option("--control-cortex", metavar="FILE", help="The same of a whole CONTROL.")
@units_option
@merge_option
@click.option(
    "--label",
    "labels",
    nargs=3,
    multiple=True,
    metavar="NAME MOVING.label CONTROL.label",
    help="A sulcus as FreeSurfer labels, their vertices in any order; repeatable.",
)
@click.option(
    "--points",
    help="A csv file: name, side (moving, control), order (numbers, or begin and end), x, y, z.",
)
@click.option(
    "--space", type=click.Choice([TKR, SCANNER]), help="Of --points  [default: the file's own]"
)
@click.option("--carry", type=click.Choice(["fsaverage5"]), help="Its eleven curves, by folds.")
@click.option(
    "--mirror", is_flag=True, help="As for `register`: MOVING is of the other hemisphere."
)
@file_option("The file to write, for `register --landmarks`.")
def landmarks(
    moving, control, cortex, control_cortex, units, merge, labels, points, space, carry, mirror, out
):
    """Write a landmarks file for MOVING and CONTROL from labels, points or a template.

    Both are given as to `register`, and the file has the vertex numbers of the surfaces as given.
    Two points are the ends of a sulcus, which `register` detects between them. Labels have the
    whole surface's numbers where it is known.
    """
    if not (labels or points or carry):
        raise click.UsageError("landmarks needs --label, --points or --carry")
    if space and not points:
        raise click.UsageError("--space belongs to --points")
    files = (moving, cortex), (control, control_cortex)
    sides = dict(zip(SIDES, (read_hemisphere(*names, units, merge) for names in files)))
    for reason in other_units(**{side: one.cut_surface for side, one in sides.items()}):
        raise qc.SurfaceError(reason)
    for one in sides.values():
        qc.require_disk(one.cut_surface)
        qc.require_outward(one.cut_surface)
    require_hands(sides, mirror)
    curves = []
    lines = []
    curves += from_labels(labels, sides, mirror, lines) if labels else []
    curves += from_points(points, sides, space, lines) if points else []
    fingerprints = {side: one.given.fingerprint for side, one in sides.items()}
    contents = {"surfaces": fingerprints, "curves": curves}
    if carry:
        template_curves, contents["off_fundus_mm"] = from_template(sides, lines)
        curves += template_curves
    for curve in curves:
        if not is_plain_name(curve["name"]):  # `register` would refuse it
            raise qc.LandmarkError(f"the name {curve['name'][:40]!r} {NOT_PLAIN}; rename it")
        curve |= {side: as_given(one, curve[side]) for side, one in sides.items()}
    check_curves(contents, *(one.given for one in sides.values()))
    write_whole(Path(out), lambda place: place.write_text(json.dumps(contents, indent=2) + "\n"))
    for line in (*lines, f"{out}: {counted(curves, 'curve')}"):
        say(line)


def as_given(one, path):
    """Vertices of a `Hemisphere`'s cut surface by their numbers in the surface as given, a list."""
    path = np.asarray(path)
    return (one.numbering.table[path] if one.is_whole else path).tolist()


def require_hands(sides, mirror):
    """LandmarkError where the hemispheres that both files name contradict --mirror."""
    hands = [one.frame.side for one in sides.values()]
    if None not in hands and (hands[0] != hands[1]) != mirror:
        remedy = "leave out --mirror" if mirror else "add --mirror, here and to `register`"
        raise qc.LandmarkError(
            f"the moving surface is a {hands[0]} hemisphere, the control a {hands[1]} one: {remedy}"
        )


def from_labels(labels, sides, mirror, lines):
    """Curves from pairs of labels; the ends nearer to each other after a map by folds are first.

    lines: list of messages to the user, which grows.
    """
    paths = [
        [label_path(name, file, sides[side], lines) for side, file in zip(SIDES, files)]
        for name, *files in labels
    ]
    moving, control = (one.cut_surface for one in sides.values())
    aligned = pair_by_folds(qc.mirror(moving) if mirror else moving, control)
    curves = []
    for (name, *_), (here, there) in zip(labels, paths):
        straight, crossed = ends_apart(aligned, here, there)
        there = there[::-1] if crossed < straight else there
        near, far = sorted((straight, crossed))
        doubt = "; check which end is first" if near > DOUBT * far else ""
        counts = f"{name}: {len(here)} and {len(there)} vertices"
        lines.append(f"{counts}, ends {near:.1f} mm apart ({far:.1f} if reversed){doubt}")
        curves.append({"name": name, "moving": here, "control": there, "detect": False})
    return curves


def label_path(name, file, one, lines):
    """The path of a label's vertices on a `Hemisphere`'s cut surface; LandmarkError names the
    label."""
    require_side(file, side_of_name(file), one.frame.side, one.path)
    try:
        numbers = read_label(file)
        own = own_numbers(one, numbers)
        if lost := len(np.unique(numbers)) - len(np.unique(own)):
            lines.append(f"{name}: {lost} of the {len(numbers)} vertices of {file} are cut away")
        return ordered(one.cut_surface, own)
    except qc.LandmarkError as error:
        raise qc.LandmarkError(f"{file} ({name}): {error}") from None


def own_numbers(one, numbers):
    """Vertices of a `Hemisphere`'s cut surface by their numbers (n,) in the whole one; those cut
    away drop out."""
    table = one.numbering.table
    count = one.numbering.count or (one.numbering.size if table is None else np.inf)
    bad = numbers[(numbers < 0) | (numbers >= count)]
    if len(bad):
        raise qc.LandmarkError(
            f"names vertex {bad[0]}, and the surface has {count}: if it was cut open, give the npz "
            "that `qclearn open` writes, or the whole surface and --cortex; else the label belongs "
            "to another surface"
        )
    return numbers if table is None else np.flatnonzero(np.isin(table, numbers))


def from_points(file, sides, space, lines):
    """Curves from a table of points in mm."""
    table = read_points(file)
    curves = {name: {} for name in table}
    for side, one in sides.items():
        known = spaces(one.frame)
        distances = []
        if space and space not in known:
            raise qc.LandmarkError(
                f"{one.path} does not say how {space} coordinates become its own; give the "
                "FreeSurfer file, or points in the surface's own coordinates without --space"
            )
        for name, both in table.items():
            try:
                vertices, distance = nearest_vertices(one.cut_surface, both[side], space, known)
            except qc.LandmarkError as error:
                raise qc.LandmarkError(f"{file}: {name!r}, {side} side: {error}") from None
            curves[name][side] = threaded(one.cut_surface, vertices)
            distances += distance.tolist()
        mean, most = np.mean(distances), max(distances)
        lines.append(f"{side}: points {mean:.1f} mm from the nearest vertices, at most {most:.1f}")
    return [{"name": name, **paths} for name, paths in curves.items()]


def from_template(sides, lines):
    """fsaverage5's curves on both sides, and their distances from the fundi: name -> side -> mm."""
    sulci = {side: carried(one.cut_surface, one.frame.side) for side, one in sides.items()}
    for side, one in sulci.items():
        lines.append(f"{side}: curves of fsaverage5's {one.hemisphere} hemisphere")
    off = {}
    curves = []
    for name in sulci["moving"].ends:
        off[name] = {side: one.off[name] for side, one in sulci.items()}
        known = {side: mm for side, mm in off[name].items() if mm is not None}
        parts = [f"{side} {mm:.1f} mm from the fundus" for side, mm in known.items()]
        lines.append(f"{name}: {', '.join(parts) or 'as it is'}")
        curves.append({"name": name} | {side: one.ends[name] for side, one in sulci.items()})
    return curves, off
