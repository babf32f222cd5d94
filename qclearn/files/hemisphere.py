"""A hemisphere as commands take it: whole or cut open, a file or fsaverage5, with what is known of the whole one."""

import re
from dataclasses import dataclass, replace

from ..surfaces.surface import Surface
from .frames import Frame
from .fsaverage import fsaverage5, whole_fsaverage5
from .meshes import frame_of, read_surface

_NAMED = re.compile("fsaverage5:(left|right)")


@dataclass(frozen=True, eq=False)
class Hemisphere:
    """path: as it was given; given: the surface of that name, whole or cut; disk: what is registered, with
    `original_vertices` where they are known; frame: what its file says, with the whole surface's faces if known."""

    path: str
    given: Surface
    disk: Surface
    frame: Frame

    @property
    def cut(self):
        """The same given as the disk."""
        return replace(self, given=self.disk)


def read_hemisphere(path):
    """The `Hemisphere` of a surface's file, or of the name fsaverage5:left or fsaverage5:right."""
    if named := _NAMED.fullmatch(str(path)):
        whole, disk = (make(named[1], "pial") for make in (whole_fsaverage5, fsaverage5))
        return Hemisphere(path, whole, disk, frame_of_whole(Frame(named[1], kind="Pial"), whole))
    surface = read_surface(path)
    return Hemisphere(path, surface, surface, frame_of(path))


def frame_of_whole(frame, surface):
    """The Frame of a disk that is cut out of a whole surface with this one."""
    return replace(frame, count=len(surface.vertices), whole=surface.faces)
