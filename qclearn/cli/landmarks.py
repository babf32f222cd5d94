"""`qclearn landmarks`: a landmarks file from FreeSurfer labels, points in mm, or fsaverage5's own curves."""

import json
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np

import qclearn as qc

from ..files.meshes import Frame, frame_of
from ..files.safe import write_whole
from ..files.values import read_label
from ..registration.landmarkfile import SIDES, check_curves
from ..registration.points import SPACES, nearest_vertices, read_points, shifts
from ..registration.tracing import carried, ends_apart, laid_by_folds, ordered, threaded
from .output import say


class Given(NamedTuple):
    """A surface of the call, with what its file says of itself."""

    path: str
    surface: qc.Surface
    frame: Frame


@click.command()
@click.argument("moving")
@click.argument("control")
@click.option("--label", "labels", nargs=3, multiple=True, metavar="NAME MOVING.label CONTROL.label",
              help="A sulcus as FreeSurfer labels, vertices in any order; repeatable.")  # fmt: skip
@click.option("--points", help="A csv file: name, side (moving, control), order (numbers, or begin and end), x, y, z.")
@click.option("--space", type=click.Choice(SPACES), help="The coordinates of --points  [default: the surface file's].")
@click.option("--carry", type=click.Choice(["fsaverage5"]), help="Its eleven curves, found by folds on both surfaces.")
@click.option("--mirror", is_flag=True, help="As for `register`: the moving surface is of the other hemisphere.")
@click.option("--out", required=True, help="The landmarks file to write, for `register --landmarks`.")
def landmarks(moving, control, labels, points, space, carry, mirror, out):
    """Write a landmarks file for MOVING and CONTROL from what people have.

    Two points are the ends of a sulcus, which `register` finds between them. Labels are numbered as the whole surface
    where the surface is an npz that `open` wrote.
    """
    if not (labels or points or carry):
        raise click.UsageError("landmarks needs --label, --points or --carry")
    if space and not points:
        raise click.UsageError("--space belongs to --points")
    sides = {side: given(path) for side, path in (("moving", moving), ("control", control))}
    require_hands(sides, mirror)
    contents = {"surfaces": {side: one.surface.fingerprint for side, one in sides.items()}, "curves": []}
    told = []
    contents["curves"] += from_labels(labels, sides, mirror, told) if labels else []
    contents["curves"] += from_points(points, sides, space, told) if points else []
    if carry:
        curves, contents["off_fundus_mm"] = from_template(sides, told)
        contents["curves"] += curves
    check_curves(contents, *(one.surface for one in sides.values()))
    write_whole(Path(out), lambda place: place.write_text(json.dumps(contents, indent=2) + "\n"))
    for line in (*told, f"{out}: {len(contents['curves'])} curves"):
        say(line)


def given(path):
    surface = qc.read_surface(path)
    qc.require_disk(surface)
    qc.require_outward(surface)
    return Given(path, surface, frame_of(path))


def require_hands(sides, mirror):
    """LandmarkError where both files say their hemisphere and --mirror does not go with that."""
    hands = [one.frame.side for one in sides.values()]
    if None not in hands and (hands[0] != hands[1]) != mirror:
        remedy = "leave out --mirror" if mirror else "add --mirror, here and to `register`"
        raise qc.LandmarkError(f"the moving surface is a {hands[0]} hemisphere, the control a {hands[1]} one: {remedy}")


def from_labels(labels, sides, mirror, told):
    """Curves from pairs of labels; which end is first is decided by where the folds lay them. told: lines to say."""
    paths = [[label_path(name, file, sides[side]) for side, file in zip(SIDES, files)] for name, *files in labels]
    moving, control = (one.surface for one in sides.values())
    laid = laid_by_folds(qc.mirror(moving) if mirror else moving, control)
    curves = []
    for (name, *_), (here, there) in zip(labels, paths):
        straight, crossed = ends_apart(laid, here, there)
        there = there[::-1] if crossed < straight else there
        near, far = sorted((straight, crossed))
        doubt = "; check which end is first" if near > 0.6 * far else ""
        told.append(
            f"{name}: {len(here)} and {len(there)} vertices, ends {near:.1f} mm apart ({far:.1f} if reversed){doubt}"
        )
        curves.append({"name": name, "moving": here.tolist(), "control": there.tolist(), "detect": False})
    return curves


def label_path(name, file, one):
    """The path of a label's vertices on a surface; LandmarkError that names the label."""
    try:
        side = frame_of(file).side
        if None not in (side, one.frame.side) and side != one.frame.side:
            raise qc.LandmarkError(f"of the {side} hemisphere by its name, and {one.path} is a {one.frame.side} one")
        return ordered(one.surface, own_numbers(one.surface, read_label(file)))
    except qc.LandmarkError as error:
        raise qc.LandmarkError(f"{file} ({name}): {error}") from None


def own_numbers(surface, numbers):
    """Vertices of a surface that have these numbers (n,) in the whole one, if it was cut; those cut away drop out."""
    whole = surface.original_vertices
    if whole is not None:
        return np.flatnonzero(np.isin(whole, numbers))
    bad = numbers[(numbers < 0) | (numbers >= len(surface.vertices))]
    if len(bad):
        raise qc.LandmarkError(
            f"names vertex {bad[0]}, and the surface has {len(surface.vertices)}: if it was cut open, give the npz "
            "that `qclearn open` writes, which knows the whole one's numbers"
        )
    return numbers


def from_points(file, sides, space, told):
    """Curves from a table of points in mm."""
    table = read_points(file)
    found = {name: {} for name in table}
    for side, one in sides.items():
        known = shifts(one.frame)
        if space and space not in known:
            raise qc.LandmarkError(
                f"{one.path} does not say how {space} coordinates are to be shifted into its own; give the FreeSurfer "
                "file, or points in the surface's own coordinates without --space"
            )
        shift, distances = known.get(space, np.zeros(3)), []
        for name, both in table.items():
            try:
                vertices, distance = nearest_vertices(one.surface, both[side], shift, known)
            except qc.LandmarkError as error:
                raise qc.LandmarkError(f"{file}: {name!r}, {side} side: {error}") from None
            found[name][side] = threaded(one.surface, vertices).tolist()
            distances += distance.tolist()
        told.append(
            f"{side}: points {np.mean(distances):.1f} mm from the nearest vertices, at most {max(distances):.1f}"
        )
    return [{"name": name, **paths} for name, paths in found.items()]


def from_template(sides, told):
    """fsaverage5's curves on both sides, and each one's distance from the nearest fundus: name -> side -> mm."""
    carry = {side: carried(one.surface, one.frame.side) for side, one in sides.items()}
    for side, one in carry.items():
        told.append(f"{side}: curves of fsaverage5's {one.hemisphere} hemisphere")
    off = {name: {side: one.off[name] for side, one in carry.items()} for name in carry["moving"].ends}
    for name, distances in off.items():
        there = [f"{side} {far:.1f} mm from the fundus" for side, far in distances.items() if far is not None]
        told.append(f"{name}: {', '.join(there) or 'as it is'}")
    curves = [{"name": name, **{side: list(one.ends[name]) for side, one in carry.items()}} for name in off]
    return curves, off
