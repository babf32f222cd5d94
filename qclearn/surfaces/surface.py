"""`Surface`, a triangle mesh in space: checked once, immutable afterwards, with its topology, areas
and cotangent matrix. Then what a method needs of it: a disk, outward faces, its mirror image."""

import hashlib
from collections.abc import Mapping
from functools import cached_property
from os import PathLike
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Integer
from numpy import ndarray
from scipy.sparse import csc_array, csr_array
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from ..plane.checks import SurfaceError, check_faces, read_only, some
from ..plane.disk import closed_loops
from ..plane.linear import around_vertices, cotangent_stiffness, edge_lengths
from .checks import check_shapes, check_topology, curve_path, merged_numbers, origins, vertex_array


class Surface:
    """An oriented, connected, manifold triangle mesh in space, open or closed; raises SurfaceError
    if it is not one.

    vertices: in any length unit; faces: orientation as given (outward = positive `volume`);
    curves: name -> vertex path; edges: sorted; edge_faces: the faces beside each edge, -1 beyond
    the boundary; original_vertices: the numbers in the whole surface that this was cut out of, or
    None. float64 and int64, read-only: what was checked stays true.
    """

    vertices: Float[ndarray, " V 3"]
    faces: Integer[ndarray, " F 3"]
    edges: Integer[ndarray, " E 2"]
    edge_faces: Integer[ndarray, " E 2"]
    curves: dict[str, Integer[ndarray, " _"]]
    original_vertices: Integer[ndarray, " V"] | None

    def __init__(
        self,
        vertices: Float[ndarray, " V 3"],
        faces: Integer[ndarray, " F 3"],
        curves: Mapping[str, Integer[ndarray, " _"]] | None = None,
        original_vertices: Integer[ndarray, " V"] | None = None,
    ):
        self.vertices = vertex_array(vertices)
        self.faces = read_only(check_faces(faces, len(self.vertices), SurfaceError))
        check_shapes(self.vertices, self.faces)
        self.edges, self.edge_faces, self._rim = check_topology(self.vertices, self.faces)
        self.curves = {
            name: curve_path(name, path, len(self.vertices))
            for name, path in (curves or {}).items()
        }
        self.original_vertices = origins(original_vertices, len(self.vertices))

    def __repr__(self):
        curves = f", curves {', '.join(self.curves)}" if self.curves else ""
        return f"Surface({len(self.vertices)} vertices, {len(self.faces)} faces{curves})"

    @cached_property
    def boundary_loops(self) -> list[Integer[ndarray, " _"]]:
        """The boundary's loops by their smallest vertices, where they start; the surface is left,
        seen from outside."""
        return closed_loops(self._rim)

    @cached_property
    def boundary(self) -> Integer[ndarray, " B"]:
        """The boundary loop, from its smallest vertex index; SurfaceError unless there is exactly
        one."""
        loops = self.boundary_loops
        if len(loops) == 1:
            return loops[0]
        if not loops:
            raise SurfaceError(
                "the surface is closed (no boundary), where a disk is needed; cut it open along "
                "the medial wall: open_surface(surface, mask), `qclearn open SURFACE --mask FILE "
                "--out FILE`, or `qclearn register` with --cortex FILE (--control-cortex FILE for "
                "the control)"
            )
        loops = sorted(loops, key=len, reverse=True)
        listed = some([f"{len(loop)} vertices from vertex {loop[0]}" for loop in loops])
        raise SurfaceError(
            f"the surface has {len(loops)} boundary loops, where a disk has one: {listed}. Fill "
            "the inner holes with faces, or cut a new opening that takes them in: "
            "open_surface(surface, mask)"
        )

    @cached_property
    def fingerprint(self) -> dict:
        """`{"vertices": V, "sha256": hex}`, by which landmarks files and reports know the surface.

        The hash of vertices (V, 3) as little-endian float32, as most formats store them, and faces
        (F, 3) as little-endian int64: the same in all formats that keep the order of the vertices.
        """
        with np.errstate(over="ignore"):  # beyond float32 all are infinite
            vertices = self.vertices.astype("<f4") + np.float32(0)  # + 0: one zero, not two
        digest = hashlib.sha256(vertices.tobytes())
        digest.update(self.faces.astype("<i8").tobytes())
        return {"vertices": len(self.vertices), "sha256": digest.hexdigest()}

    @property
    def euler_characteristic(self) -> int:
        """V - E + F: 2 for a sphere, 1 for a disk, less by 1 for each further hole and by 2 for
        each handle."""
        return len(self.vertices) - len(self.edges) + len(self.faces)

    @cached_property
    def face_areas(self) -> Float[ndarray, " F"]:
        """Areas of the faces, in squared units of the vertices."""
        a, b, c = (self.vertices[corner] for corner in self.faces.T)
        return read_only(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    @cached_property
    def vertex_areas(self) -> Float[ndarray, " V"]:
        """One third of the areas of the faces around each vertex."""
        return read_only(around_vertices(self.face_areas, self.faces) / 3)

    @cached_property
    def stiffness(self) -> Float[csc_array, " V V"]:
        """`cotangent_stiffness` of the surface, positive semi-definite; made once."""
        return cotangent_stiffness(self.vertices, self.faces)

    @cached_property
    def edge_lengths(self) -> Float[ndarray, " F 3"]:
        """Length of the edge opposite each corner of each face."""
        return read_only(edge_lengths(self.vertices[self.faces]))

    def __reduce__(self):
        """Pickles and copies are made anew of these arrays, read-only like the first."""
        return Surface, (self.vertices, self.faces, self.curves, self.original_vertices)

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.face_areas.sum())

    @cached_property
    def volume(self) -> float:
        """Signed enclosed volume, the `closing_fans` on its boundary; positive = the faces look
        outward."""
        points, fans = closing_fans(self)
        corners = points[np.vstack([self.faces, fans])] - self.vertices.mean(axis=0)
        return float(np.linalg.det(corners).sum() / 6)


class Mesh(NamedTuple):
    """A mesh without `Surface`'s rules: of a file some of which will be cut away, or a registered
    one, where a face that lands on one edge of the control has no area."""

    vertices: ndarray
    faces: ndarray
    curves: Mapping = MappingProxyType({})
    original_vertices: ndarray | None = None

    @classmethod
    def of(cls, vertices, faces, curves=MappingProxyType({}), original_vertices=None):
        """The mesh of arrays; SurfaceError where shapes, kinds of numbers or corners are wrong."""
        vertices = vertex_array(vertices, finite=False)
        curves = {name: curve_path(name, path, len(vertices)) for name, path in curves.items()}
        faces = read_only(check_faces(faces, len(vertices), SurfaceError))
        return cls(vertices, faces, curves, original_vertices)

    fingerprint = property(Surface.fingerprint.func)

    def renumbered(self, numbers):
        """The mesh whose faces and curves have the numbers (V,) for those of its vertices."""
        paths = {name: numbers[path] for name, path in self.curves.items()}
        curves = {name: path[np.diff(path, prepend=-2) != 0] for name, path in paths.items()}
        return self._replace(faces=numbers[self.faces], curves=curves)

    def merged(self):
        """The mesh that names of points doubled along a seam the lowest alone."""
        return self.renumbered(merged_numbers(self.vertices, self.faces))

    def used(self):
        """The mesh of those vertices that are in faces, with their numbers here."""
        used = np.bincount(self.faces.ravel(), minlength=len(self.vertices)) > 0
        if used.all():
            return self
        numbers = origins(self.original_vertices, len(used))
        numbers = np.flatnonzero(used) if numbers is None else numbers[used]
        mesh = self.renumbered(np.where(used, used.cumsum() - 1, -1))
        return mesh._replace(vertices=self.vertices[used], original_vertices=numbers)


def require_surface(surface, *others):
    """SurfaceError unless it is a `Surface`, or of other classes: a path, or arrays, for example."""
    if not isinstance(surface, (Surface, *others)):
        is_path = isinstance(surface, (str, bytes, PathLike))
        given = repr(surface) if is_path else f"an object of the type {type(surface).__name__}"
        raise SurfaceError(
            f"a surface is needed, not {given:.200}; give read_surface(path) for a file, or "
            "Surface(vertices, faces) for arrays"
        )


def places_of(numbers, table):
    """Where numbers (n, ...) stand in a table (V,) of different ones, -1 for those it lacks."""
    places = np.full(max(table.max(), numbers.max()) + 1, -1)
    places[table] = np.arange(len(table))
    return places[numbers]


def closing_fans(surface):
    """The triangles (R, 3) that close a surface, oriented as it is: from each edge of the boundary
    to the mean of its loop; and the vertices (V + L, 3) with these means, one a loop, last."""
    points, fans = [surface.vertices], [np.zeros((0, 3), np.int64)]
    for k, loop in enumerate(surface.boundary_loops):
        points.append(surface.vertices[loop].mean(axis=0)[None])
        centre = np.full(len(loop), len(surface.vertices) + k)
        fans.append(np.stack([np.roll(loop, -1), loop, centre], axis=1))
    return np.concatenate(points), np.concatenate(fans)


def require_disk(surface: Surface) -> None:
    """SurfaceError unless the surface is a topological disk: one boundary loop and Euler
    characteristic 1."""
    require_surface(surface)
    _ = surface.boundary  # one loop
    if surface.euler_characteristic != 1:
        handles = (1 - surface.euler_characteristic) // 2
        raise SurfaceError(
            f"the surface has {handles} handle{'s' * (handles > 1)} (Euler characteristic "
            f"{surface.euler_characteristic}, a disk has 1); loops through them cross the edges "
            f"{some(_handle_edges(surface))}. Repair the topology where the surface was made "
            "(FreeSurfer: mris_fix_topology) or cut the handles out with open_surface(surface, "
            "mask)"
        )


def require_outward(surface: Surface) -> None:
    """SurfaceError unless the faces look outward: positive `volume`, beyond rounding."""
    require_surface(surface)
    if abs(surface.volume) <= 1e-12 * surface.area**1.5:
        raise SurfaceError(
            "the surface encloses no volume (it lies in a plane), so its orientation cannot be "
            "told; use the surface in space (pial, white or midthickness) instead of a flat patch"
        )
    if surface.volume < 0:
        raise SurfaceError(
            f"the surface looks inward (signed volume {surface.volume:.6g}). Reverse all faces: "
            "Surface(vertices, faces[:, ::-1], curves), or `qclearn open --reverse`"
        )


def mirror(surface: Surface) -> Surface:
    """The surface with x negated and every face reversed: outward stays outward, indices stay."""
    require_surface(surface)
    vertices = surface.vertices * [-1.0, 1.0, 1.0]
    return Surface(vertices, surface.faces[:, ::-1], surface.curves, surface.original_vertices)


def _handle_edges(surface):
    """Edges (2 x handles, 2) that each close one of the shortest loops from vertex 0 through a
    handle.

    Those in neither a shortest-path tree nor a tree of faces across the longest loops (Erickson and
    Whittlesey 2005).
    """
    n_vertices = len(surface.vertices)
    n_cells = len(surface.faces) + 1
    one, two = surface.edges.T
    graph = csr_array((np.ones(len(one)), (one, two)), shape=(n_vertices, n_vertices))
    depth, parent = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
    crossing = np.flatnonzero((parent[one] != two) & (parent[two] != one))
    crossing = crossing[np.argsort(-(depth[one] + depth[two])[crossing], kind="stable")]
    # The two cells of each edge; -1, the outside, is the last cell.
    low, high = np.sort(surface.edge_faces[crossing] % n_cells, axis=1).T
    first = np.unique(low * n_cells + high, return_index=True)[1]
    dual = csr_array((first + 1.0, (low[first], high[first])), shape=(n_cells, n_cells))
    cotree = minimum_spanning_tree(dual).data.astype(np.int64) - 1
    return surface.edges[np.sort(np.delete(crossing, cotree))]
