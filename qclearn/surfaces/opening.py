"""Cutting a closed hemisphere open along a mask (the medial wall), so that a disk is left."""

from types import SimpleNamespace

import numpy as np
from jaxtyping import Bool, Integer
from numpy import ndarray

from ..plane.checks import unmasked
from .checks import LARGEST, check_shapes, check_topology, components, vertex_array
from .surface import Mesh, Surface, SurfaceError, places_of, require_disk, require_surface


def open_surface(
    surface: Surface | tuple, mask: Bool[ndarray, " V"]
) -> tuple[Surface, Integer[ndarray, " W"]]:
    """The disk left when the vertices of mask (True = cut) are cut away, and its vertices' indices
    in the input.

    Of the faces without a cut corner the piece of largest area stays. Its largest gap (the input's
    own boundary, if there is one) becomes the opening; the others are filled with their own
    vertices. Where the opening touches itself in a vertex the largest fan stays, and where an inner
    edge joins two vertices of the rim the larger side. Vertices keep places and order; the indices
    are also the disk's `original_vertices`. SurfaceError for a mask of wrong shape, or that cuts
    all, nothing or a curve, or more than half filled, and where no disk with an inner vertex is
    left.

    surface: also a tuple (vertices, faces), whose largest part cut away may have any faults.
    """
    if isinstance(surface, (tuple, list)):
        surface = Mesh.of(*surface)
    require_surface(surface, Mesh)
    mask = _checked_mask(surface, mask)
    cut = mask[surface.faces].any(axis=1)
    if not isinstance(surface, Surface):
        try:
            surface = Surface(*surface)
        except SurfaceError:
            surface = _without_wall(surface, mask, cut)
    piece = _disk_piece(surface, ~cut)
    if cut.any() and piece[cut].all():
        raise SurfaceError(
            "the mask only makes holes inside a surface that is open already "
            f"({len(surface.boundary)} boundary vertices from vertex {surface.boundary[0]}); let "
            "it reach that boundary, or use the surface as it is"
        )
    vertices, corners = np.unique(surface.faces[piece], return_inverse=True)
    filled = int(mask[vertices].sum())
    if filled > mask.sum() / 2:
        raise SurfaceError(
            f"only a pinhole would open: {filled} of the mask's {mask.sum()} vertices lie in holes "
            "away from the largest and would be filled; give a mask in one piece (the medial "
            "wall), or smooth this one"
        )
    curves = {name: places_of(path, vertices) for name, path in surface.curves.items()}
    for name, path in surface.curves.items():
        lost = path[curves[name] < 0]
        if lost.size:
            raise SurfaceError(
                f"curve '{name}' would lose {lost.size} of its {path.size} vertices, the first "
                f"{lost[0]}; shorten the curve, leave it out (Surface(vertices, faces)), or cut "
                "less"
            )
    opened = Surface(surface.vertices[vertices], corners.reshape(-1, 3), curves, vertices)
    require_disk(opened)
    if len(opened.boundary) == len(vertices):
        raise SurfaceError(
            f"the mask shreds the surface: the largest piece (faces left: {len(opened.faces)}) has "
            f"no inner vertex, only vertices {vertices[:5].tolist()} on its rim; smooth the mask, "
            "or give one that cuts less"
        )
    return opened, vertices


def _without_wall(mesh, mask, cut):
    """What `open_surface` needs of a `Mesh` of which the largest gap of the cut faces (F,) is torn
    off: these have corners of their own, NaN. SurfaceError for faults elsewhere."""
    count = len(mesh.vertices)
    points = np.where(abs(mesh.vertices) < LARGEST, mesh.vertices, 0)  # NaN, too
    a, b, c = (points[corner] for corner in mesh.faces.T)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    _, label = components(count, mesh.faces[cut][:, [0, 1, 1, 2]].reshape(-1, 2))
    gap = label[mesh.faces[:, 0]]
    wall = cut & (gap == np.bincount(gap, cut * areas).argmax())
    faces = mesh.faces.copy()
    faces[wall] = count + np.arange(3 * wall.sum()).reshape(-1, 3)
    used = np.bincount(faces.ravel(), minlength=count)[:count] > 0
    vertices = vertex_array(np.where(used[:, None], mesh.vertices, 0))
    vertices = np.concatenate([vertices, np.full((3 * wall.sum(), 3), np.nan)])
    check_shapes(vertices, faces, torn=True)
    judged = np.append(used & ~mask, np.zeros(3 * wall.sum(), dtype=bool))
    edges, edge_faces, _ = check_topology(vertices, faces, judged)
    part = {"vertices": vertices, "faces": faces, "edges": edges, "edge_faces": edge_faces}
    return SimpleNamespace(**part, curves=mesh.curves, face_areas=areas)


def _checked_mask(surface, mask):
    mask, n_vertices = unmasked(mask, "the mask", SurfaceError), len(surface.vertices)
    if mask.dtype != bool or mask.shape != (n_vertices,):
        raise SurfaceError(
            f"the mask must be {n_vertices} booleans, one a vertex (True = cut), not {mask.dtype} "
            f"of shape {mask.shape}. From vertex indices: mask = numpy.zeros({n_vertices}, bool); "
            "mask[indices] = True"
        )
    if not mask.any():
        raise SurfaceError("the mask cuts nothing; mark the vertices of the medial wall")
    if mask[surface.faces].any(axis=1).all():
        raise SurfaceError(
            f"the mask cuts everything ({mask.sum()} of {n_vertices} vertices, no face is left); "
            "if it marks what to keep, give its opposite (~mask, `qclearn open --keep`)"
        )
    return mask


def _disk_piece(surface, piece):
    """The faces of the disk, (F,) bool: the steps of `open_surface` until none changes anything."""
    while True:
        before = piece
        piece = _largest(surface, piece, cut=np.zeros(len(surface.edges), dtype=bool))
        piece = _with_holes_filled(surface, piece)
        # One fan of faces stays at every vertex, the largest.
        rim = surface.edges[_rim(surface, piece)]
        for vertex in np.flatnonzero(np.bincount(rim.ravel()) > 2):
            around = piece & (surface.faces == vertex).any(axis=1)
            apart = ~(surface.edges == vertex).any(axis=1)
            piece = piece & ~around | _largest(surface, around, cut=apart)
        # Inner edges that join two vertices of the rim part it.
        on_rim = np.zeros(len(surface.vertices), dtype=bool)
        on_rim[surface.edges[_rim(surface, piece)]] = True
        piece = _largest(surface, piece, cut=on_rim[surface.edges].all(axis=1))
        if (piece == before).all():
            return piece


def _largest(surface, piece, cut):
    """The part of largest area of a piece (F,), joined through edges (E,) that are not cut."""
    joined = surface.edge_faces[_sides(surface, piece).all(axis=1) & ~cut]
    _, label = components(len(surface.faces), joined)
    area = np.bincount(label[piece], weights=surface.face_areas[piece])
    return piece & (label == area.argmax())


def _with_holes_filled(surface, piece):
    """A piece and its gaps but the opening; gaps that touch in a vertex are one."""
    cut = ~piece
    if not cut.any():
        return piece
    outside = surface.edges[surface.edge_faces[:, 1] < 0]
    sides = surface.faces[cut]
    pairs = np.concatenate([sides[:, :2], sides[:, 1:], outside])
    _, label = components(len(surface.vertices), pairs)
    gap = label[surface.faces[:, 0]]
    # The opening is the surface's own boundary, else the largest gap.
    largest = np.bincount(gap[cut], surface.face_areas[cut]).argmax()
    return piece | ~np.isin(gap, label[outside] if len(outside) else largest)


def _rim(surface, piece):
    """Edges (E,) bool with one face in the piece."""
    return _sides(surface, piece).sum(axis=1) == 1


def _sides(surface, piece):
    """Which of its two faces is in the piece, of every edge: (E, 2) bool."""
    return piece[surface.edge_faces] & (surface.edge_faces >= 0)
