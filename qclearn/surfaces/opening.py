"""Cutting a closed hemisphere open along a mask (the medial wall), so that a disk is left."""

import numpy as np
from jaxtyping import Bool, Integer
from numpy import ndarray

from .checks import components
from .surface import Surface, SurfaceError, require_disk


def open_surface(
    surface: Surface, mask: Bool[ndarray, " V"]
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
    """
    mask = _checked_mask(surface, mask)
    n_masked = int(mask.sum())
    cut = mask[surface.faces].any(axis=1)
    kept = _opened(surface, ~cut)
    if kept[cut].all():
        raise SurfaceError(
            "the mask only makes holes inside a surface that is open already "
            f"({len(surface.boundary)} boundary "
            f"vertices from vertex {surface.boundary[0]}); let it reach that boundary, or use the "
            "surface as it is"
        )
    vertices, corners = np.unique(surface.faces[kept], return_inverse=True)
    new_index = np.full(len(surface.vertices), -1)
    new_index[vertices] = np.arange(len(vertices))
    filled = int(mask[vertices].sum())
    if filled > n_masked / 2:
        raise SurfaceError(
            f"only a pinhole would open: {filled} of the mask's {n_masked} vertices lie in holes "
            "away from the largest "
            f"and would be filled; give a mask in one piece (the medial wall), or smooth this one"
        )
    curves = {name: _renumbered(name, path, new_index) for name, path in surface.curves.items()}
    opened = Surface(surface.vertices[vertices], corners.reshape(-1, 3), curves, vertices)
    require_disk(opened)
    if len(opened.boundary) == len(vertices):
        raise SurfaceError(
            f"the mask shreds the surface: the largest piece (faces left: {len(opened.faces)}) "
            "has no inner vertex, "
            f"only vertices {vertices[:5].tolist()} on its rim; smooth the mask, or give one that "
            "cuts less"
        )
    return opened, vertices


def _checked_mask(surface, mask):
    mask, n_vertices = np.asarray(mask), len(surface.vertices)
    if mask.dtype != bool or mask.shape != (n_vertices,):
        raise SurfaceError(
            f"the mask must be {n_vertices} booleans, one a vertex (True = cut), not {mask.dtype} "
            "of shape "
            f"{mask.shape}. From vertex indices: mask = numpy.zeros({n_vertices}, bool); "
            "mask[indices] = True"
        )
    if not mask.any():
        raise SurfaceError("the mask cuts nothing; mark the vertices of the medial wall")
    if mask[surface.faces].any(axis=1).all():
        raise SurfaceError(
            f"the mask cuts everything ({mask.sum()} of {n_vertices} vertices, no face is left); "
            "if it marks what to "
            f"keep, give its opposite (~mask, `qclearn open --keep`)"
        )
    return mask


def _opened(surface, kept):
    """Faces (F,) bool of the disk: the steps of `open_surface` until none changes anything."""
    while True:
        before = kept
        kept = _largest(surface, kept, cut=np.zeros(len(surface.edges), dtype=bool))
        kept = _with_holes_filled(surface, kept)
        kept = _without_touching_fans(surface, kept)
        kept = _largest(surface, kept, cut=_chords(surface, kept))
        if (kept == before).all():
            return kept


def _largest(surface, kept, cut):
    """The piece of largest area of the kept faces, joined through edges that are not cut."""
    joined = surface.edge_faces[_sides(surface, kept).all(axis=1) & ~cut]
    _, label = components(len(surface.faces), joined)
    area = np.bincount(label[kept], weights=surface.face_areas[kept])
    return kept & (label == area.argmax())


def _with_holes_filled(surface, kept):
    """The kept faces and their gaps but the opening; gaps that touch in a vertex are one."""
    faces, cut = surface.faces, ~kept
    if not cut.any():
        return kept
    outside = surface.edges[surface.edge_faces[:, 1] < 0]
    _, label = components(
        len(surface.vertices), np.concatenate([faces[cut][:, :2], faces[cut][:, 1:], outside])
    )
    gap = label[faces[:, 0]]
    opening = (
        label[outside] if len(outside) else np.bincount(gap[cut], surface.face_areas[cut]).argmax()
    )
    return kept | ~np.isin(gap, opening)


def _without_touching_fans(surface, kept):
    """The kept faces with one fan, the largest, at every vertex."""
    rim = _rim(surface, kept)
    for vertex in np.flatnonzero(np.bincount(surface.edges[rim].ravel()) > 2):
        around = kept & (surface.faces == vertex).any(axis=1)
        kept = kept & ~around | _largest(
            surface, around, cut=~(surface.edges == vertex).any(axis=1)
        )
    return kept


def _chords(surface, kept):
    """Inner edges (E,) bool that join two vertices of the rim."""
    on_rim = np.zeros(len(surface.vertices), dtype=bool)
    on_rim[surface.edges[_rim(surface, kept)]] = True
    return _sides(surface, kept).all(axis=1) & on_rim[surface.edges].all(axis=1)


def _rim(surface, kept):
    return _sides(surface, kept).sum(axis=1) == 1


def _sides(surface, kept):
    """Which of its two faces is kept, for every edge: (E, 2) bool."""
    return kept[surface.edge_faces] & (surface.edge_faces >= 0)


def _renumbered(name, path, new_index):
    lost = path[new_index[path] < 0]
    if lost.size:
        raise SurfaceError(
            f"curve '{name}' would lose {lost.size} of its {path.size} vertices, the first "
            f"{lost[0]}; shorten the "
            f"curve, leave it out (Surface(vertices, faces)), or cut less"
        )
    return new_index[path]
