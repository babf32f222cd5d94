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
from .fingers import SMALLEST, find_fingers, finger_message, opened_rows, uniform_matrix
from .surface import Surface, SurfaceError, require_disk, require_surface


def disk_conformal_map(surface: Surface) -> Complex[ndarray, " V"]:
    """The conformal map of a disk-like surface onto the unit disk, boundary exactly on the circle.

    The area centroid goes to 0, the first vertex of `surface.boundary` to 1. The flux form with the
    cotangent matrix, no iteration. Certified: no triangle is flipped; a RepairWarning tells of
    boundary steps and rows changed for that, and of blind tubes, `find_fingers`, in which the map
    is not conformal. SurfaceError if the surface is not a disk, BijectivityError where every map
    of it folds.
    """
    return _conformal_map(surface)[0]


def _conformal_map(surface):
    """`disk_conformal_map` and the vertices (k,) of all fingers."""
    require_disk(surface)
    loop = surface.boundary
    problem = Dirichlet(surface.stiffness, loop)
    corners = surface.vertices[loop]
    rim = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    share = surface.vertex_areas / surface.area
    # The map is centred at the inner vertex nearest the area centroid of the harmonic embedding
    # with its boundary by arc length.
    if not len(problem.free):
        raise SurfaceError("the surface has no interior vertex; refine it")
    arc = np.concatenate([[0.0], np.cumsum(rim[:-1])]) / rim.sum()
    f = problem.solve(np.exp(2j * np.pi * arc))
    centre = problem.free[abs(f[problem.free] - share @ f).argmin()]
    free = FreeBoundary(problem, rim, centre)
    f = mobius(free.f, centring_mobius(free.f, share))

    # The tip of a blind tube is lost in the disk: there, and only there, other weights.
    matrix, fingers = surface.stiffness, []
    one, two = surface.edges.T
    if abs(f[one] - f[two]).min() < SMALLEST:
        fingers = find_fingers(surface, f)
    if fingers:
        share[np.concatenate(fingers)] = 0
        share /= share.sum()
        matrix = opened_rows(surface, fingers, matrix)
        f = mobius(f, centring_mobius(f, share))
        f = Dirichlet(matrix, loop).solve(f[loop])
    f, switched = _centre_and_unfold(surface, matrix, share, f)
    messages = [finger_message(surface, finger) for finger in fingers]
    if len(switched) or free.floored.any():
        messages.append(
            f"conformal map: to keep every triangle positive, boundary steps raised: "
            f"{int(free.floored.sum())}, rows switched to mean-value weights: {len(switched)}"
        )
    for last_resort in (False, True):
        if last_resort:  # positive weights everywhere, and a convex boundary
            matrix = uniform_matrix(surface)
            matrix = opened_rows(surface, fingers, matrix) if fingers else matrix
            f = Dirichlet(matrix, loop).solve(f[loop])
            messages = messages[: len(fingers)]
            messages += ["conformal map: it folded, so Tutte's weights everywhere: not conformal"]
        # The first vertex of the boundary goes to 1, all of it onto the circle.
        f = f / f[loop[0]]
        f[loop] /= abs(f[loop])
        if Disk(f, surface.faces).certificate.bijective:
            break
    else:
        raise BijectivityError(
            "no map to the disk is free of folds in double precision; remesh the surface (its "
            "triangles may be degenerate to rounding)"
        )
    for message in messages:
        warnings.warn(message, RepairWarning, stacklevel=3)
    return f, np.concatenate([np.zeros(0, int), *fingers])


def _centre_and_unfold(surface, matrix, share, f):
    """The Dirichlet solution f of a matrix with its centroid, by each vertex's share, at 0, and
    rows switched until no face is flipped: (f, switched vertices)."""
    lengths = surface.edge_lengths
    picture = Disk(f, surface.faces)
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
    require_surface(surface)
    angles = corner_angles(edge_lengths(z[surface.faces]))
    return np.degrees(angles - corner_angles(surface.edge_lengths))


@dataclass(frozen=True, eq=False)
class ParameterizedSurface:
    """A surface on its disk, the `Disk` of its faces with the boundary on the unit circle.

    smoothing: its features at every scale, a `Smoothing`, or None; messages: what was repaired in
    its map; sphere: what methods on spheres need, a `Sphere`, or None; fingers (k,): vertices of
    blind tubes, where the map is not conformal and nothing is compared.
    """

    surface: Surface
    disk: Disk
    smoothing: object = None
    messages: tuple = ()
    sphere: object = None
    fingers: object = ()

    @cached_property
    def vertex_shares(self):
        """The vertices' shares of the surface's area (V,), 0 at fingers."""
        areas = self.surface.vertex_areas.copy()
        if len(self.fingers):
            areas[self.fingers] = 0
        return areas / areas.sum()

    @cached_property
    def face_shares(self):
        """The faces' shares of the surface's area (F,), 0 at fingers."""
        areas = self.surface.face_areas.copy()
        if len(self.fingers):
            areas[np.isin(self.surface.faces, self.fingers).any(1)] = 0
        return areas / areas.sum()

    def lift(self, points):
        """Points (P, 3) on the surface whose images in the disk are `points` (P,) complex."""
        return self.disk.interpolate(self.surface.vertices, self.disk.locate(points))


def parameterize(surface):
    """The `ParameterizedSurface` of a surface in its disk conformal map."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", RepairWarning)
        z, fingers = _conformal_map(surface)
    messages = tuple(str(warning.message) for warning in caught)
    return ParameterizedSurface(surface, Disk(z, surface.faces), messages=messages, fingers=fingers)


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
