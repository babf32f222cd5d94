"""`Side`: a surface on its disk, as one value; laid out once, and laid anew by functions that return another."""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..plane.beltrami import cotangent_stiffness
from ..plane.bijectivity import RepairWarning, repair
from ..plane.disk import Disk
from ..plane.mobius import mobius
from ..plane.triangles import edge_lengths
from .conformal import disk_conformal_map
from .surface import Surface


@dataclass(frozen=True, eq=False)
class Side:
    """A surface on its disk, the `Disk` of its faces with the boundary on the unit circle.

    features: its per-vertex maps at every scale (`Smoothing` in registration/features.py), None where it has none;
    words: what was repaired when it was laid out.
    """

    surface: Surface
    disk: Disk
    features: object = None
    words: tuple = ()

    @cached_property
    def whole(self) -> bool:
        """Whether the boundary runs around the circle once and no face is flipped."""
        rim = self.disk.z[self.surface.boundary]
        return bool(np.angle(np.roll(rim, -1) / rim).min() > 0 and not len(self.disk.flipped))

    def lift(self, points):
        """Points (P, 3) on the surface whose images in the disk are `points` (P,) complex."""
        return self.disk.interpolate(self.surface.vertices, self.disk.locate(points))


def laid_out(surface):
    """The `Side` of a surface in its disk conformal map."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z = disk_conformal_map(surface)
    return Side(surface, Disk(z, surface.faces), words=tuple(str(warning.message) for warning in caught))


def moved(side, parameters):
    """The side after a disk Möbius map (a, theta) of its disk."""
    return replace(side, disk=mended(side.surface, mobius(side.disk.z, *parameters)))


def mended(surface, z):
    """The `Disk` of a surface at z (V,) with its boundary put back onto the circle; where it folds, rows are switched.

    Not certified: ask `Side.whole` or the disk.
    """
    z, loop = z.copy(), surface.boundary
    z[loop] /= abs(z[loop])
    disk = Disk(z, surface.faces)
    if disk.certificate.bijective:
        return disk
    lengths = edge_lengths(surface.vertices[surface.faces])
    return repair(cotangent_stiffness(surface.vertices, surface.faces), disk, lengths)[0]
