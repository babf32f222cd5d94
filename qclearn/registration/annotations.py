"""Annotations of both sides, regions by name: how well the moving side's own and the control's, carried over, agree."""

import numpy as np

from ..surfaces.surface import SurfaceError

NAMELESS = ("", "???", "unknown")  # regions that are none
SIDES = ("moving", "control")


def check_annotations(annotations, *surfaces):
    """Both sides' regions as numbers (V,) and (W,), -1 for those that are not on both, and their names (R,); None where
    there are no annotations. SurfaceError where counts do not fit, or no region is on both sides."""
    if annotations is None:
        return None
    if not isinstance(annotations, (list, tuple)) or len(annotations) != len(SIDES):
        raise SurfaceError("annotations are no pair: give the moving and the control vertices' names of regions")
    names = [of_vertices(*one) for one in zip(SIDES, annotations, surfaces)]
    shared = np.intersect1d(*names)
    shared = shared[~np.isin(np.char.lower(shared), NAMELESS)]
    if not len(shared):
        some = [", ".join(np.unique(own)[:3].tolist()) for own in names]
        raise SurfaceError(f"the annotations share no region's name (moving: {some[0]}; control: {some[1]}); rename")
    numbers = [np.where(np.isin(own, shared), np.searchsorted(shared, own), -1) for own in names]
    return *numbers, shared.tolist()


def of_vertices(side, names, surface):
    """The names of regions of a surface's vertices (V,), also from those of the whole surface that it was cut from."""
    names, count, table = np.asarray(names), len(surface.vertices), surface.original_vertices
    if names.dtype.kind != "U" or names.ndim != 1:
        raise SurfaceError(
            f"annotation, {side} side: {names.dtype} {names.shape}; give the name of each vertex's region"
        )
    if len(names) == count:
        return names
    if table is not None and table.max() < len(names) <= 2 * count:  # no more than half of a surface is cut away
        return names[table]
    raise SurfaceError(
        f"annotation, {side} side: {len(names)} regions for {count} vertices; give one a vertex of the surface as it "
        "is registered, or of the whole one if its npz has original_vertices"
    )


def dice(sides, regions, *maps):
    """Dice's coefficients of two `Sides` and regions of `check_annotations` after a first and a last disk map (V,).

    `2 |A n B| / (|A| + |B|)`, |.| the moving surface's area, A a region of the moving side and B the control's of that
    name where the map takes its vertices: `{"before", "after"}`, the mean weighted by |A| + |B|, and `"regions"`: name
    -> [before, after]. Empty where there are none. Source: Dice 1945.
    """
    if regions is None:
        return {}
    own, there, names = regions
    areas, disk = sides.moving.surface.vertex_areas, sides.control.disk
    rows = []
    for f in maps:
        face, weights = disk.lookup(f)
        carried = there[disk.faces[face, weights.argmax(1)]]
        one, other, both = (
            np.bincount(found[found >= 0], areas[found >= 0], len(names))
            for found in (own, carried, np.where(own == carried, own, -1))
        )
        rows.append([2 * both.sum() / (one + other).sum(), *(2 * both / (one + other))])
    (before, after), *rest = np.transpose(rows).tolist()
    return {"before": before, "after": after, "regions": dict(zip(names, rest))}
