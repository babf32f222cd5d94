"""Meshes of the unit disk, the square beside it, and where a point lies in a disk mesh."""

import numpy as np
import shapely
from jaxtyping import Complex, Float, Integer
from numpy import ndarray
from scipy import sparse

from .checks import BeltramiError, check_faces, check_mesh, planar_points

INSET = 1e-4  # share of the radius that points moved onto the boundary polygon stay inside it


class SurfaceError(ValueError):
    """A surface, or a file of one, that cannot be used: says what was found, where (indices) and what to do."""


def square_to_disk(w: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Radial map of the square [-1, 1]^2 onto the unit disk, `w max(|cos t|, |sin t|)`, t = arg w; 0 to 0."""
    w = np.asarray(w, complex)
    return w * _radius_ratio(w)


def disk_to_square(z: Complex[ndarray, " *P"]) -> Complex[ndarray, " *P"]:
    """Inverse of `square_to_disk`: `z / max(|cos t|, |sin t|)` (the paper's formula with its absolute values)."""
    z = np.asarray(z, complex)
    return z / _radius_ratio(z)


def _radius_ratio(w):
    size = abs(w)
    largest = np.maximum(abs(w.real), abs(w.imag))
    return np.divide(largest, size, out=np.ones_like(size), where=size > 0)


def square_disk(n: int) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Disk mesh with the topology of an n x n square grid, n even: (z, faces).

    Every cell is split by the diagonal that runs into the square's corner of its quadrant; the other choice puts a
    triangle with three boundary vertices at each corner, which carries no boundary flux.
    """
    if n < 2 or n % 2:
        raise ValueError(f"square_disk needs an even number of cells a side, at least 2; got {n}")
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    a, b, c, d = corner, corner + 1, corner + n + 2, corner + n + 1  # counter-clockwise from the lower left
    row, column = np.divmod(np.arange(n * n), n)
    rising = ((row >= n // 2) == (column >= n // 2))[:, None]
    first = np.where(rising, np.stack([a, b, c], 1), np.stack([a, b, d], 1))
    second = np.where(rising, np.stack([a, c, d], 1), np.stack([b, c, d], 1))
    return square_to_disk((x + 1j * y).ravel()), np.concatenate([first, second])


def polar_disk(nr: int, nt: int, power: float = 1.0) -> tuple[Complex[ndarray, " V"], Integer[ndarray, " F 3"]]:
    """Graded polar disk mesh: vertex 0 at the centre, then nr rings of nt vertices at radius (j / nr)^power.

    Returns (z (1 + nr nt,), faces); all quads are split along the same diagonal, so that the mesh is invariant under
    rotation by 2 pi / nt. Vertex `1 + (nr - 1) nt` lies at 1.
    """
    if nr < 1 or nt < 3:
        raise ValueError(f"polar_disk needs at least 1 ring and 3 angles; got {nr} and {nt}")
    radius = (np.arange(1, nr + 1) / nr) ** power
    spokes = np.exp(2j * np.pi * np.arange(nt) / nt)
    z = np.concatenate([[0], (radius[:, None] * spokes).ravel()])
    k, following = np.arange(nt), (np.arange(nt) + 1) % nt
    faces = [np.stack([np.zeros(nt, int), 1 + k, 1 + following], 1)]
    for j in range(nr - 1):
        inner, outer = 1 + j * nt, 1 + (j + 1) * nt
        faces += [
            np.stack([inner + k, outer + k, outer + following], 1),
            np.stack([inner + k, outer + following, inner + following], 1),
        ]
    return z, np.concatenate(faces)


def boundary_loop(faces):
    """Vertices of the boundary of a triangulated disk, counter-clockwise, from the smallest index: (B,).

    BeltramiError if the faces have no boundary or several, or touch in a vertex.
    """
    faces = check_faces(faces)
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    alone = _alone(faces)
    following = dict(zip(tails[alone].tolist(), heads[alone].tolist()))
    loop = [min(following, default=None)]
    while len(loop) <= len(following) and following.get(loop[-1]) != loop[0]:
        loop.append(following.get(loop[-1]))
    if len(following) != alone.sum() or len(loop) != len(following):
        raise BeltramiError("the faces do not form a disk with one simple boundary loop")
    return np.array(loop)


def _alone(faces):
    """Which of the half-edges (3 F,), 3 f + k from corner k of face f, have no opposite one: those of the boundary."""
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    n = int(faces.max()) + 1
    there, opposite = np.sort(tails * n + heads), heads * n + tails
    return there[np.minimum(np.searchsorted(there, opposite), len(there) - 1)] != opposite


def locate(
    z: Complex[ndarray, " V"], faces: Integer[ndarray, " F 3"], points: Complex[ndarray, " P"]
) -> tuple[Integer[ndarray, " P"], Float[ndarray, " P 3"]]:
    """Where points lie in a disk mesh: (face, barycentric coordinates, non-negative, sum 1).

    A point beyond the boundary polygon (between a chord and its arc, say) is first moved radially onto the polygon;
    one inside the circle stays short of it by up to INSET of its radius, so that triangles there keep an area.
    BeltramiError for a point that is not finite.
    """
    (z, faces), points = check_mesh(z, faces), np.atleast_1d(planar_points(points, "points"))
    unknown = np.flatnonzero(~np.isfinite(points))
    if len(unknown):
        raise BeltramiError(
            f"points {unknown[:5].tolist()} are not finite: they lie nowhere in the mesh; leave them out"
        )
    corners, wanted = _pairs(z[faces]), _pairs(points)
    low, high = wanted.min(0, initial=np.inf), wanted.max(0, initial=-np.inf)
    near = np.flatnonzero(((corners.max(1) >= low) & (corners.min(1) <= high)).all(1))
    tree = shapely.STRtree(shapely.polygons(corners[near]))  # building polygons takes the longest: only where needed
    hit, face = tree.query(shapely.points(wanted), predicate="intersects")
    inside = np.full(len(points), -1)
    inside[hit] = near[face]
    outside = np.flatnonzero(inside < 0)
    if len(outside):
        points = points.copy()
        inside[outside], points[outside] = _project_radially(z, faces, points[outside])
    return inside, _barycentric(z[faces[inside]], points)


def interpolate(values, faces, face, weights):
    """Per-vertex values (V, ...) at places in a mesh, (P, ...), linear in each face; the places as `locate` gives
    them."""
    return np.einsum("pk,pk...->p...", weights, np.asarray(values)[np.asarray(faces)[face]])


def sampling_matrix(z, faces, points):
    """The sparse real matrix (P, V) that evaluates a piecewise linear function of the disk mesh at points (P,)."""
    face, weights = locate(z, faces, points)
    rows = np.repeat(np.arange(len(weights)), 3)
    return sparse.csr_array((weights.ravel(), (rows, np.asarray(faces)[face].ravel())), shape=(len(weights), len(z)))


def _pairs(z):
    return np.stack([z.real, z.imag], axis=-1)


def _barycentric(corners, points):
    a, b, c = corners.T
    area = ((b - a).conj() * (c - a)).imag
    weights = (
        np.stack(
            [
                ((b - points).conj() * (c - points)).imag,
                ((c - points).conj() * (a - points)).imag,
                ((a - points).conj() * (b - points)).imag,
            ],
            axis=1,
        )
        / area[:, None]
    )
    weights = np.maximum(weights, 0)  # rounding, at an edge
    return weights / weights.sum(1, keepdims=True)


def _project_radially(z, faces, points):
    loop = boundary_loop(faces)
    order = np.argsort(np.angle(z[loop]))
    loop = loop[order]
    k = (np.searchsorted(np.angle(z[loop]), np.angle(points), side="right") - 1) % len(loop)
    a, b = z[loop[k]], z[loop[(k + 1) % len(loop)]]
    # The ray s p meets the chord a + t (b - a) where Im(conj(b - a)(s p - a)) = 0.
    s = ((b - a).conj() * a).imag / ((b - a).conj() * points).imag
    radius = abs(points)
    gap = 1 - s * radius  # between the chord and the arc: none at a boundary vertex
    s = s * (1 - INSET * np.clip(np.divide(1 - radius, gap, out=np.zeros_like(gap), where=gap > 0), 0, 1))
    rim = np.flatnonzero(_alone(faces))  # each boundary vertex begins one half-edge of the boundary
    face = np.empty(len(z), int)
    face[faces.ravel()[rim]] = rim // 3
    return face[loop[k]], s * points


def pixel_centres(size):
    """Pixel centres of the image of [-1, 1]^2, complex (size, size): x grows with the column, y with the row."""
    axis = (2 * np.arange(size) + 1) / size - 1
    return axis[None, :] + 1j * axis[:, None]
