"""Where maps take points: into the control's disk, or onto its sphere; one way to ask both."""

from functools import cached_property

import numpy as np

from data_synth.correspondence import locate_on_sphere

from ..plane.linear import interpolate
from ..surfaces.surface import SurfaceError
from .methods.spheres import inward


class OnDisk:
    """The control `ParameterizedSurface` as the aim of maps into its disk. locate: of its `Disk`.

    `locate(f)`: places (face, weights) of points (P,) complex; `at(v, places)`: values (W, ...) of
    the aim's vertices there; `values(v, places)`: the same of the open surface's; `lift(places)`:
    points (P, 3) of the surface.
    """

    def __init__(self, control, locate):
        self.control, self.locate = control, locate

    def at(self, values, places):
        return self.control.disk.interpolate(values, places)

    values = at

    def lift(self, places):
        return self.at(self.control.surface.vertices, places)


class OnSphere:
    """The same for maps onto its sphere, points (P, 3); the control's wall has no values."""

    def __init__(self, control):
        self.sphere = control.sphere

    @cached_property
    def faces(self):
        return self.sphere.whole.faces

    def locate(self, points):
        return locate_on_sphere(
            self.sphere.points, self.faces, points / np.linalg.norm(points, axis=1)[:, None]
        )

    def values(self, values, places):
        wall = len(self.sphere.points) - len(values)
        padding = (0, wall), *[(0, 0)] * (np.ndim(values) - 1)
        return self.at(np.pad(values, padding, constant_values=np.nan), places)

    def lift(self, places):
        return self.at(self.sphere.whole.vertices, places)

    def at(self, values, places):
        return interpolate(values, self.faces, places)


def image_of(control, f, locate):
    """What a map goes into: the disk for f (V,) complex, the sphere for f (V', 3)."""
    return OnDisk(control, locate) if f.ndim == 1 else OnSphere(control)


def carried(pair, f):
    """The moving vertices' images (V, 3), in mm, under a map f (V,) to the disk or (V', 3)."""
    image = image_of(pair.control, f, pair.control.disk.locate)
    return image.lift(image.locate(f[: len(pair.moving.surface.vertices)]))


def reversed_on_sphere(pair, places, f):
    """Number of moving faces that a map (V,) or (V, 3) reverses on the control's sphere.

    None where the control has no sphere and none can be made here.
    """
    faces = pair.moving.surface.faces
    try:
        sphere = pair.control.sphere
        if f.ndim == 1:
            f = pair.control.disk.interpolate(sphere.points[: len(pair.control.disk.z)], places)
    except (ImportError, SurfaceError, AttributeError):
        return None
    return inward(f[faces])
