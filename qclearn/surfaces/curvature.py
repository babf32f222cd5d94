"""Mean curvature, sulcal depth, and their images on a disk; its radius follows the area."""

from dataclasses import dataclass
from functools import wraps
from weakref import WeakKeyDictionary

import numpy as np
import scipy
from jaxtyping import Complex, Float
from numpy import ndarray
from scipy.sparse import coo_array, diags_array

from ..interrupts import signals_wait
from ..plane.checks import read_only
from ..plane.disk import Disk
from ..plane.grids import pixel_centres
from ..plane.linear import LARGE, heat_flow, middles
from .surface import Surface, SurfaceError, closing_fans, require_surface

# In units of sqrt(area of the convex hull): the radius of the ball that closes the sulci, and the
# side of a voxel.
CLOSING_RADIUS, CLOSING_CELL = 0.05, 1 / 130
POTENTIAL = 13 / 300  # length of the curvature's potential, in units of sqrt(area of the surface)
KNOTS = 65  # of an `AreaRadius`
# Share of the area that is lighter or darker than an image shows, and of the vertices whose
# curvature the potential cuts.
TAIL = 0.02


def _once(function):
    """A function of a surface, cached for each surface as long as the surface is there."""
    values = WeakKeyDictionary()

    @wraps(function)
    def cached(surface):
        require_surface(surface)
        if surface not in values:
            values[surface] = read_only(function(surface))
        return values[surface]

    return cached


@_once
def mean_curvature(surface: Surface) -> Float[ndarray, " V"]:
    """Mean curvature (k1 + k2)/2 of each vertex, 1/length: positive on gyri if the faces look
    outward.

    `H = n . (K x) / (2 A)` with the cotangent stiffness K, the mixed Voronoi area A of Meyer et al.
    (2003) and the vertex normal n of Max (1999). It is exact, 1/r, where the neighbours lie on a
    sphere of radius r and no triangle around is obtuse; else the mean error falls like h^2, but
    single vertices of odd valence may keep theirs (Xu 2004). A boundary vertex takes the mean of
    its neighbours inside, as the rim pulls on it; SurfaceError where no vertex is inside.
    """
    pull = surface.stiffness @ surface.vertices
    # The edges that leave each corner to the next and to the previous one, (F, 3, 3) each, their
    # squared lengths and products.
    faces = surface.faces
    corners = surface.vertices[faces]
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    next_squared, last_squared = np.vecdot(to_next, to_next), np.vecdot(to_last, to_last)
    dot = np.vecdot(to_next, to_last)
    # Mixed areas: Voronoi's, but half of an obtuse triangle's area to its obtuse corner, a quarter
    # to each other one. The edge to the next corner lies opposite the last corner, and the other
    # way round.
    double_area = np.linalg.norm(np.cross(to_next[:, 0], to_last[:, 0]), axis=1)[:, None]
    voronoi = next_squared * np.roll(dot, 1, axis=1) + last_squared * np.roll(dot, -1, axis=1)
    obtuse = np.where(dot < 0, double_area / 4, double_area / 8)
    is_obtuse = (dot < 0).any(axis=1)[:, None]
    areas = np.where(is_obtuse, obtuse, voronoi / (8 * double_area))
    area = np.bincount(faces.ravel(), areas.ravel())
    # Normals: the sum of a x b / (|a|^2 |b|^2) over the corners, exact on any mesh of a sphere.
    parts = np.cross(to_next, to_last) / (next_squared * last_squared)[..., None]
    normal = np.stack([np.bincount(faces.ravel(), parts[..., k].ravel()) for k in range(3)], axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    curvature = np.vecdot(pull, normal) / (2 * area)
    # The boundary takes means over known neighbours, from the inside outward.
    known = np.ones(len(curvature), bool)
    for loop in surface.boundary_loops:
        known[loop] = False
    if not known.any():
        raise SurfaceError(
            "all vertices lie on the boundary, so no curvature can be told; subdivide the surface"
        )
    a, b = surface.edges.T
    places = np.r_[a, b], np.r_[b, a]
    neighbours = coo_array((np.ones(2 * len(a)), places), shape=(len(known),) * 2).tocsr()
    curvature = np.where(known, curvature, 0.0)
    while not known.all():
        count = neighbours @ known.astype(float)
        fresh = ~known & (count > 0)
        curvature[fresh] = (neighbours @ curvature)[fresh] / count[fresh]
        known |= fresh
    return curvature


@_once
def sulcal_depth(surface: Surface) -> Float[ndarray, " V"]:
    """Depth of each vertex below the outer envelope, >= 0 and 0 on gyral crowns, in the surface's
    length.

    The distance to the outside of the filled surface after its morphological closing by a ball of
    radius 0.05 L, L = sqrt(area of the convex hull): the envelope of the local gyrification index
    (Schaer et al. 2008). Openings are capped by fans; the orientation does not matter. On voxels of
    side L/130 and accurate to about one; below half a voxel it is 0. SurfaceError for a flat
    surface.
    """
    vertices = surface.vertices
    try:
        scale = np.sqrt(scipy.spatial.ConvexHull(vertices).area)
    except scipy.spatial.QhullError:
        raise SurfaceError(
            "the surface lies in a plane, so it has no depth; use the surface in space"
        ) from None
    # The voxels; those around the surface are outside, which the depth is measured to.
    cell = CLOSING_CELL * scale
    origin = vertices.min(axis=0) - 1.5 * cell
    shape = np.ceil((vertices.max(axis=0) + 1.5 * cell - origin) / cell).astype(int)
    # Which voxel centres, `origin + cell * index`, lie inside the surface with its openings capped.
    points, fans = closing_fans(surface)
    with signals_wait():  # PyVista imports more when it is used
        import pyvista  # slow to import, and nothing else here needs it

        body = pyvista.PolyData.from_regular_faces(points, np.vstack([surface.faces, fans]))
        grid = pyvista.ImageData(dimensions=shape, spacing=(cell,) * 3, origin=origin)
        mask = body.voxelize_binary_mask(reference_volume=grid)["mask"]
    body = mask.reshape(shape[::-1]).transpose(2, 1, 0) > 0
    # The closing, with room for the ball: the body grown by it, its holes filled, and shrunk by it.
    radius = CLOSING_RADIUS / CLOSING_CELL
    room = int(radius) + 1
    grown = grow(np.pad(body, room), radius)
    outside = scipy.ndimage.label(~grown)[0] == 1  # where the first voxel lies
    closed = ~grow(outside, radius)[(slice(room, -room),) * 3]
    inward = scipy.ndimage.distance_transform_edt(closed)
    depth = scipy.ndimage.map_coordinates(inward, ((vertices - origin) / cell).T, order=1)
    # Half a voxel: the distance is to the nearest centre outside, the envelope lies between two
    # centres.
    return cell * np.maximum(depth - 0.5, 0)


def grow(body, radius):
    """The voxels whose centres lie within `radius`, in voxels and at most 11, of one in `body`.

    By squared distances, one axis after the other; those beyond the radius need not be known, so
    bytes hold them.
    """
    reach = int(radius)
    squared = np.where(body, 0, 255 - reach**2).astype(np.uint8)
    for axis in range(3):
        lines = np.moveaxis(squared, axis, 0)
        nearest = lines.copy(order="K")
        for k in range(1, reach + 1):
            nearest[k:] = np.minimum(nearest[k:], lines[:-k] + k**2)
            nearest[:-k] = np.minimum(nearest[:-k], lines[k:] + k**2)
        squared = np.moveaxis(nearest, 0, axis)
    return squared <= radius**2


@_once
def curvature_potential(surface: Surface) -> Float[ndarray, " V"]:
    """The potential u of mean curvature H: `u - L^2 Laplace(u) = L H`, with natural boundary
    conditions, dimensionless; it tells the great sulci from short ones as deep.

    L is 13 mm on a surface of 9e4 mm^2; H is cut at both ends, as one sharp vertex would outweigh a
    sulcus. Source: Boucher, Whitesides, Evans (2009), Depth potential function for folding pattern
    representation, registration and analysis.
    """
    mass, length = diags_array(surface.vertex_areas), POTENTIAL * np.sqrt(surface.area)
    curvature = mean_curvature(surface)
    curvature = np.clip(curvature, *np.quantile(curvature, [TAIL, 1 - TAIL]))
    return heat_flow(mass, length**2 * surface.stiffness, length * (mass @ curvature), 1)


@dataclass(frozen=True)
class AreaRadius:
    """A monotone change of radius of the unit disk, linear between the knots `disk` <-> `image`,
    both 0 to 1."""

    disk: Float[ndarray, " K"]
    image: Float[ndarray, " K"]

    def to_image(self, z):
        """Image coordinates of points z of the disk, complex; angles stay."""
        return _scale_radius(z, self.disk, self.image)

    def from_image(self, w):
        """Points of the disk at image coordinates w, complex: the inverse of `to_image`."""
        return _scale_radius(w, self.image, self.disk)


def _scale_radius(z, radius, new_radius):
    z = np.asarray(z, complex)
    size = abs(z)
    new_size = np.interp(size, radius, new_radius)
    return z * np.divide(new_size, size, out=np.zeros(z.shape), where=size > 0)


def area_radius(surface, z):
    """The `AreaRadius` with `r_image^2` = share of the surface's area within |z| <= r.

    A conformal map crowds most of a cortex into a small part of its disk (half of the area within r
    < 0.24 on one hemisphere); equal areas of this image carry equal cortical area, ring by ring.
    """
    m = 4 if len(z) <= LARGE else 1  # many faces need no parts
    points, areas = parts_of_faces(surface, z, m)
    size = abs(points)
    order = np.argsort(size)
    share = np.cumsum(areas[order])
    image = np.linspace(0, 1, KNOTS)
    disk = np.interp(image[1:-1] ** 2, share / share[-1], size[order])
    return AreaRadius(np.concatenate([[0.0], disk, [1.0]]), image)


def parts_of_faces(surface, z, m):
    """Centroids in z of the m^2 equal parts of each face, complex (m^2 F,), and their areas on the
    surface."""
    points = z[surface.faces] @ middles(m).T
    return points.ravel(), np.repeat(surface.face_areas / m**2, m**2)


def curvature_image(
    surface: Surface,
    z: Complex[ndarray, " V"],
    size: int = 128,
    values: Float[ndarray, " V"] | None = None,
) -> tuple[Float[ndarray, " size size"], AreaRadius]:
    """Image of a per-vertex map on the disk, NaN outside it, and the `AreaRadius` of its
    coordinates.

    z: a disk map as `disk_conformal_map` gives. Pixel (i, j) shows `radius.from_image(x + iy)`, x =
    (2j + 1)/size - 1, y = (2i + 1)/size - 1, linear in its face. values: in their own unit; without
    them mean curvature as `grey_levels`, 0 (sulci) to 255 (gyri). Source: paper, section 'Landmark
    Detection'; the radius is ours.
    """
    require_surface(surface)
    if values is None:
        values = grey_levels(mean_curvature(surface), surface.vertex_areas)
    radius = area_radius(surface, z)
    disk = Disk(z, surface.faces)
    w = pixel_centres(size)
    inside = abs(w) <= 1
    image = np.full((size, size), np.nan)
    image[inside] = disk.interpolate(values, disk.locate(radius.from_image(w[inside])))
    return image, radius


def grey_levels(values, areas):
    """Values (V,) scaled to [0, 255], the lowest and highest TAIL of the area clipped; a constant
    to 127.5."""
    order = np.argsort(values)
    share = (np.cumsum(areas[order]) - 0.5 * areas[order]) / np.sum(areas)
    low, high = np.interp([TAIL, 1 - TAIL], share, values[order])
    if not high > low:
        return np.full(len(values), 127.5)
    return 255 * np.clip((values - low) / (high - low), 0, 1)
