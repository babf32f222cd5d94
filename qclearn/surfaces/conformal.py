"""The conformal map of a disk-like surface onto the unit disk, and `ParameterizedSurface`: a
surface on its disk, as one value."""

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float
from numpy import ndarray

from ..plane.bijectivity import BijectivityError, RepairWarning, repair
from ..plane.disk import Disk
from ..plane.linear import Dirichlet, corner_angles, edge_lengths
from ..plane.mobius import centring_mobius, mobius
from ..plane.solver import FreeBoundary
from .surface import Surface, SurfaceError, require_disk


def disk_conformal_map(surface: Surface) -> Complex[ndarray, " V"]:
    """The conformal map of a disk-like surface onto the unit disk, boundary exactly on the circle.

    The area centroid goes to 0, the first vertex of `surface.boundary` to 1. The flux form with the
    cotangent matrix, no iteration. Certified: no triangle is flipped; a RepairWarning counts
    the boundary steps and rows changed for that. SurfaceError if the surface is not a disk;
    BijectivityError if the repair fails.
    """
    require_disk(surface)
    loop = surface.boundary
    problem = Dirichlet(surface.stiffness, loop)
    corners = surface.vertices[loop]
    rim = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    free = FreeBoundary(problem, rim, _central_vertex(surface, problem, rim))
    f, switched = _centre_and_unfold(surface, free.f)
    f = f / f[loop[0]]
    f[loop] /= abs(f[loop])
    if not Disk(f, surface.faces).certificate.bijective:
        raise BijectivityError(
            "the disk conformal map folds and row switching did not mend it; remesh the surface "
            "(its triangles may be degenerate to rounding)"
        )
    if len(switched) or free.floored.any():
        warnings.warn(
            f"conformal map: {int(free.floored.sum())} boundary steps raised, {len(switched)} rows "
            "switched to mean-value weights to keep every triangle positive",
            RepairWarning,
            stacklevel=2,
        )
    return f


def _central_vertex(surface, problem, rim):
    """The interior vertex nearest the area centroid of the harmonic embedding with boundary by arc
    length."""
    if not len(problem.free):
        raise SurfaceError("the surface has no interior vertex; refine it")
    arc = np.concatenate([[0.0], np.cumsum(rim[:-1])]) / rim.sum()
    f = problem.solve(np.exp(2j * np.pi * arc))
    return problem.free[abs(f[problem.free] - surface.vertex_areas @ f / surface.area).argmin()]


def _centre_and_unfold(surface, f):
    """The map f with its area centroid at 0 and rows switched until no face is flipped: (f,
    switched vertices)."""
    share = surface.vertex_areas / surface.area
    matrix, lengths = surface.stiffness, surface.edge_lengths
    picture = Disk(mobius(f, centring_mobius(f, share)), surface.faces)
    switched = np.zeros(0, int)
    for _ in range(5):
        picture, switched, problem, _ = repair(matrix, picture, lengths, switched)
        f = picture.z
        if problem is None:
            break
        # Centred again: a Möbius map of the boundary values, the interior solved anew.
        for _ in range(50):
            if abs(share @ f) < 1e-14:
                break
            f = problem.solve(mobius(f[surface.boundary], centring_mobius(f, share)))
        picture = picture.at(f)
    return f, switched


def angle_distortion(surface: Surface, z: Complex[ndarray, " V"]) -> Float[ndarray, " F 3"]:
    """Angles in the disk minus angles on the surface, in degrees: column k at `faces[:, k]`."""
    angles = corner_angles(edge_lengths(z[surface.faces]))
    return np.degrees(angles - corner_angles(surface.edge_lengths))


@dataclass(frozen=True, eq=False)
class ParameterizedSurface:
    """A surface on its disk, the `Disk` of its faces with the boundary on the unit circle.

    features: its maps at every scale, a `Smoothing`, or None; messages: what was repaired in its
    map; sphere: what methods on spheres need, a `Sphere`, or None.
    """

    surface: Surface
    disk: Disk
    features: object = None
    messages: tuple = ()
    sphere: object = None

    @cached_property
    def whole(self) -> bool:
        """Whether the boundary runs around the circle once and no face is flipped."""
        rim = self.disk.z[self.surface.boundary]
        return bool(np.angle(np.roll(rim, -1) / rim).min() > 0 and not len(self.disk.flipped))

    def lift(self, points):
        """Points (P, 3) on the surface whose images in the disk are `points` (P,) complex."""
        return self.disk.interpolate(self.surface.vertices, self.disk.locate(points))


def parameterize(surface):
    """The `ParameterizedSurface` of a surface in its disk conformal map."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z = disk_conformal_map(surface)
    messages = tuple(str(warning.message) for warning in caught)
    return ParameterizedSurface(surface, Disk(z, surface.faces), messages=messages)


def apply_mobius(side, parameters):
    """The side after a disk Möbius map (a, theta) of its disk."""
    return replace(side, disk=repair_folds(side.surface, mobius(side.disk.z, *parameters)))


def repair_folds(surface, z):
    """The `Disk` of a surface at z (V,), boundary put back onto the circle, folds repaired. Not
    certified."""
    z = z.copy()
    loop = surface.boundary
    z[loop] /= abs(z[loop])
    disk = Disk(z, surface.faces)
    if disk.certificate.bijective:
        return disk
    return repair(surface.stiffness, disk, surface.edge_lengths)[0]
