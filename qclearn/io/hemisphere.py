"""A hemisphere as commands take it: a file or fsaverage5, whole or cut open."""

import contextlib
import re
from dataclasses import dataclass, replace

import numpy as np

from ..surfaces.checks import components
from ..surfaces.opening import open_surface
from ..surfaces.surface import Mesh, Surface, SurfaceError, places_of, require_outward
from .frames import Frame
from .fsaverage import fsaverage5, whole_fsaverage5
from .meshes import frame_of, read_mesh, surface_of
from .safe import naming
from .values import read_mask

NAMED = re.compile("fsaverage5:(left|right)")
# So many vertices of a label of the cortex may lie in other pieces, or in holes that are filled,
# for each that stays.
LOOSE = 1e-3


@dataclass(frozen=True, eq=False)
class Numbering:
    """The vertex numbers of a cut surface in the whole one that it was cut out of.

    size: number of the cut surface's vertices; table (V,): their numbers in the whole one; count:
    of the whole one's vertices. None where it was never cut, or that is unknown.
    """

    size: int
    table: np.ndarray | None = None
    count: int | None = None

    @property
    def known(self):
        """Whether both forms are known."""
        return self.table is not None and self.count is not None and self.table.max() < self.count

    def on_cut_surface(self, values, name):
        """The cut surface's values (V, ...) of those of either form; SurfaceError for another
        length."""
        if len(values) == self.size:
            return values
        if self.known and len(values) == self.count:
            return values[self.table]
        whole = " (the cut-open one, if it was cut)"
        if self.known:
            whole = f", {self.count} before it was cut open"
        message = f"{len(values)} values for {self.size} vertices of the surface they come from"
        advice = "give the file that belongs to this surface"
        count = self.count or self.size
        if values.ndim == 2 and values.shape[1] in (self.size, count):
            advice = "its rows seem to be maps: transpose it"
        elif len(values) == 2 * count:
            advice = "it seems to be of both hemispheres: give this one's half"
        elif count / 2 < len(values) < count:
            advice += " (values of the cortex alone: put them at its vertices in a whole map, "
            advice += "whole[cortex] = values; those of CIFTI: wb_command -cifti-separate)"
        raise SurfaceError(f"{name}: {message}{whole}; {advice}")

    def on_whole(self, values, wall):
        """The whole surface's values of the cut one's (V, ...), with `wall` where it was cut
        away."""
        whole = np.full((self.count, *values.shape[1:]), wall, dtype=values.dtype)
        whole[self.table] = values
        return whole

    def places(self, numbers):
        """The cut surface's vertices with these numbers in the whole one, -1 for those cut away."""
        return places_of(numbers, self.table)


@dataclass(frozen=True, eq=False)
class Hemisphere:
    """path: as it was given; given: the surface of that name, whole or cut; cut_surface: what is
    registered, in space, with `original_vertices` where they are known; frame: what its file says,
    with the whole surface's faces if known."""

    path: str
    given: Surface | Mesh
    cut_surface: Surface
    frame: Frame

    @property
    def numbering(self):
        """The `Numbering` of the cut surface."""
        cut = self.cut_surface
        return Numbering(len(cut.vertices), cut.original_vertices, self.frame.count)

    @property
    def is_whole(self):
        """Whether it was given whole, so that what belongs to it has the whole one's numbers."""
        return self.given is not self.cut_surface

    @property
    def cut(self):
        """The same given as the cut surface."""
        return replace(self, given=self.cut_surface)


def read_hemisphere(path, cortex=None, units="mm", merge=False):
    """The `Hemisphere` of a surface's file, or of the name fsaverage5:left or fsaverage5:right.

    cortex: a file that names the vertices of a whole surface to keep (lh.cortex.label, thickness);
    SurfaceError where it is in pieces or has holes, of a surface that is open, or of the other
    hemisphere. units, merge: as of `read_surface`.
    """
    if named := NAMED.fullmatch(str(path)):
        if cortex is not None:
            message = f"{path} is cut at its own medial wall"
            raise SurfaceError(f"{cortex}: {message}; leave the label out")
        whole, disk = (make(named[1], "pial") for make in (whole_fsaverage5, fsaverage5))
        return Hemisphere(path, whole, disk, frame_of_whole(Frame(named[1], kind="Pial"), whole))
    mesh = read_mesh(path, units, merge)
    frame = frame_of(path)
    unused = mesh.used() is not mesh
    if unused:  # the numbers are this file's, not those of an older whole surface
        mesh = mesh._replace(original_vertices=None)
    if cortex is None:
        disk = surface_of(path, mesh)
        whole = (mesh, disk, frame_of_whole(frame, mesh)) if unused else (disk, disk, frame)
        return Hemisphere(path, *whole)
    with contextlib.suppress(SurfaceError):  # what is cut away may have faults
        mesh = mesh if unused else surface_of(path, mesh)
    if isinstance(mesh, Surface) and mesh.boundary_loops:
        advice = "leave the label out, or give the whole surface"
        raise SurfaceError(f"{cortex}: {path} is open already; {advice}")
    require_side(cortex, frame_of(cortex).side, frame.side, path)
    return Hemisphere(path, mesh, cut_out(path, mesh, cortex), frame_of_whole(frame, mesh))


def opened(path, mesh, mask):
    """`open_surface` of a file's mesh, which must look outward; a SurfaceError names the file."""
    with naming(path):
        disk, table = open_surface(mesh, mask)
        require_outward(disk)
        return disk, table


def cut_out(path, mesh, cortex):
    """The disk that a file names in a whole surface; SurfaceError unless it is in one piece."""
    wall = read_mask(cortex, mesh, keep=True)
    disk, table = opened(path, mesh, wall)
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, piece = components(len(wall), sides[~wall[sides].any(axis=1)])
    left = ~wall & (np.bincount(mesh.faces.ravel(), minlength=len(wall)) > 0)
    apart = left.sum() - np.bincount(piece[left]).max()
    filled = wall[table].sum()
    if apart > LOOSE * len(table):
        message = f"is in pieces: {apart} of its {left.sum()} vertices lie apart"
        raise SurfaceError(f"{cortex}: {message}; repair the label")
    if filled > LOOSE * len(table):
        raise SurfaceError(
            f"{cortex}: has holes of {filled} vertices beside the medial wall; repair the label, "
            "or cut with `qclearn open`, which fills them"
        )
    return disk


def frame_of_whole(frame, surface):
    """The Frame of a disk that is cut out of a whole surface with this one."""
    return replace(frame, count=len(surface.vertices), whole=surface.faces)


def require_side(path, side, other, owner):
    """SurfaceError where a file and the surface that it is for are of different hemispheres."""
    if side and other and side != other:
        advice = f"give the {other} one's, or correct its name and metadata"
        message = f"is of the {side} hemisphere, {owner} of the {other} one"
        raise SurfaceError(f"{path}: {message}; {advice}")
