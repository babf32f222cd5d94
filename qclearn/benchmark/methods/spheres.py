"""Whole surfaces on spheres, closed where they were cut open, for methods on spheres."""

import subprocess
import sys
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial.transform import Rotation

from ...io.extras import require
from ...io.meshes import read_surface, write_surface
from ...plane.grids import joined
from ...plane.linear import Dirichlet
from ...surfaces.surface import Surface, SurfaceError

# cat-surf is under the GPL: a program in a process of its own, never imported here.
INFLATE = """
import sys
import cat_surf
whole = cat_surf.read_surface(sys.argv[1])
cat_surf.write_surface(sys.argv[2], *cat_surf.surf_to_sphere(*whole, stop_at=5, relax=True))
"""
ROUND = 1.01  # the largest radius by the smallest of what passes for a sphere
THINNER = 0.8  # of a ring of the patch: its number of points by that of the ring around it


class SphereError(SurfaceError):
    """A sphere that is none, or is missing; the message says whose."""


class Sphere:
    """A surface on its sphere: `whole`, the closed `Surface` whose first V vertices are the open
    one's, and `points` (V', 3) of these on the unit sphere, turned to point as the brain does
    (Procrustes by area, from its centroid).

    given: (whole, points) of a subject that has a sphere of its own. Else the opening is closed by
    a patch, and `cat_surf.surf_to_sphere(stop_at=5, relax=True)` inflates it in a process of its
    own. ImportError without the extra `peers`; SphereError for a sphere that is none, or folded.
    """

    def __init__(self, surface, given=None):
        self.surface, self.given = surface, given

    @cached_property
    def whole(self):
        return closed(self.surface) if self.given is None else self.given[0]

    @cached_property
    def points(self):
        return facing(self.whole, inflated(self.whole) if self.given is None else self.given[1])


def closed(surface):
    """The surface with its opening closed by a patch; the open surface's vertices come first.

    The rim lies on the unit circle by its length; rings of ever fewer points fill the disk in
    Delaunay's triangles, and each coordinate is the harmonic function of its values on the rim.
    """
    rim = surface.boundary[::-1]  # around the patch, seen from outside
    edges = np.roll(surface.vertices[rim], -1, axis=0) - surface.vertices[rim]
    steps = np.linalg.norm(edges, axis=1)
    count = len(rim)
    radius = 1.0
    rings = [np.exp(2j * np.pi * np.append(0, np.cumsum(steps[:-1])) / steps.sum())]
    while count > 6:
        radius *= 1 - 2 * np.pi / count * np.sqrt(3) / 2
        count = int(THINNER * count)
        turns = (np.arange(count) + 0.5 * (len(rings) % 2)) / count
        rings.append(max(radius, 0) * np.exp(2j * np.pi * turns))
    patch = joined(np.append(np.concatenate(rings), 0j))
    harmonic = Dirichlet(patch.laplace, np.arange(len(rim)))
    columns = [harmonic.solve(column).real for column in surface.vertices[rim].T]
    places = np.stack(columns, 1)
    numbers = np.concatenate([rim, len(surface.vertices) + np.arange(len(patch.z) - len(rim))])
    vertices = np.concatenate([surface.vertices, places[len(rim) :]])
    return Surface(vertices, np.concatenate([surface.faces, numbers[patch.faces]]))


def inflated(whole):
    """The points (V', 3) of a closed surface on a sphere by cat-surf, in a process of its own."""
    require("peers", "spheres of surfaces that come without one")
    with TemporaryDirectory() as folder:
        paths = [str(Path(folder, name)) for name in ("whole.surf.gii", "sphere.surf.gii")]
        write_surface(paths[0], whole)
        command = [sys.executable, "-P", "-c", INFLATE, *paths]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = done.stderr.strip().rpartition("\n")[2]
            raise SphereError(f"cat_surf ended with {done.returncode}, without a sphere: {last}")
        return read_surface(paths[1]).vertices


def facing(whole, points):
    """Points (V', 3) on a sphere around 0, checked, scaled to radius 1 and turned as the surface."""
    unit = unit_points(points, whole, "the surface's sphere")
    folded = inward(unit[whole.faces])
    if folded:
        raise SphereError(
            f"the surface's sphere is folded: {folded} of its faces look inward; make it again, "
            "unfolded"
        )
    areas = whole.vertex_areas
    out = whole.vertices - np.average(whole.vertices, axis=0, weights=areas)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return Rotation.align_vectors(out, unit, weights=areas)[0].apply(unit)


def unit_points(points, whole, whose):
    """Points (V', 3) at radius 1; SphereError unless they are an outward sphere of `whole`."""
    count = len(whole.vertices)
    if points.shape != (count, 3):
        raise SphereError(f"{whose} has {len(points):,} vertices, where its surface has {count:,}")
    radii = np.linalg.norm(points, axis=1)
    if not radii.max() < ROUND * radii.min():  # nor with NaN
        raise SphereError(
            f"{whose} is none around 0: its vertices lie {radii.min():.4g} to {radii.max():.4g} "
            "from it"
        )
    unit = points / radii[:, None]
    if np.linalg.det(unit[whole.faces]).sum() <= 0:
        raise SphereError(f"{whose} looks inward: its faces are reversed, or it is mirrored")
    return unit


def inward(corners):
    """How many faces look inward, seen from 0, by their corners (F, 3, 3)."""
    return int((np.linalg.det(corners) <= 0).sum())
