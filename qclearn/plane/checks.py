"""Checks of planar meshes, their maps, coefficients and pins, and the two errors that name what is
wrong: with these (BeltramiError), or with a surface or its file (SurfaceError)."""

import numpy as np


class BeltramiError(ValueError):
    """A Beltrami coefficient, a planar mesh or a constraint that admits no quasi-conformal
    solution."""


class SurfaceError(ValueError):
    """A surface, or a file of one, that cannot be used; the message has what, where (indices) and
    what to do."""


def read_only(array):
    """The array, or a copy where the caller could write to it."""
    if array.flags.writeable or array.base is not None:
        array = array.copy()
        array.flags.writeable = False
    return array


def unmasked(values, name, error=BeltramiError):
    """The values as an array; an `error` where a masked array hides some (`np.asarray` would drop
    its mask), or lists have unequal lengths."""
    if np.ma.is_masked(values):
        rows = np.unique(np.argwhere(np.ma.getmaskarray(values))[:, 0])
        raise error(
            f"{name}: values are masked in {counted(rows, 'row')}: {some(rows)}; the mask would be "
            "lost: fill them in (values.filled(0), say), or leave them out"
        )
    try:
        return np.asarray(values)
    except ValueError:
        raise error(f"{name}: lists of unequal lengths; give an array (faces: triangles)") from None


def blendable(values):
    """Real or complex values as an array; ValueError for what may be labels, and a masked array."""
    values = unmasked(values, "values", ValueError)
    if values.dtype.kind not in "fc":
        raise ValueError(
            f"values of type {values.dtype} may be labels, which interpolation would blend into "
            "others: carry them with nearest=True, or give values.astype(float)"
        )
    return values


def complex_numbers(values, name):
    """An array as complex128, or BeltramiError."""
    try:
        values = unmasked(values, name, TypeError)
        if values.dtype.kind not in "biufcO":  # NumPy would read text and count dates
            raise TypeError(f"they have type {values.dtype}")
        return values.astype(complex, copy=False)
    except (TypeError, ValueError) as error:
        raise BeltramiError(f"{name} must be complex numbers, but {error}") from None


def planar_points(points, name="z"):
    """Points of the plane as complex128 (P,), also where one stands alone, or BeltramiError."""
    points = np.atleast_1d(complex_numbers(points, name))
    if points.ndim > 1:
        raise BeltramiError(f"{name} has shape {points.shape}: give complex numbers (V,), x + iy")
    return points


def counted(items, one, many=None):
    """How many items there are, with their noun: '1 face', '2 faces'."""
    return f"{len(items)} {one if len(items) == 1 else many or one + 's'}"


def some(items):
    """The first five of a list or an array, and how many more, for error messages."""
    items = items if isinstance(items, list) else items.tolist()
    more = f" and {len(items) - 5} more" if len(items) > 5 else ""
    return ", ".join(map(str, items[:5])) + more


def check_faces(faces, n_vertices, error=BeltramiError):
    """Triangles as int64 (F, 3), at least one, with corners in range; or an `error`, which is a
    SurfaceError for the faces of a surface."""
    faces = unmasked(faces, "faces", error)
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise error(f"faces must be triangles (F, 3), not {faces.shape}; split polygons")
    if faces.dtype.kind not in "iu":
        raise error(f"faces must be integers, not {faces.dtype}; give faces.astype(int)")
    if not len(faces):
        raise error("there are no faces; give at least one triangle")
    if faces.min() < 0 or faces.max() >= n_vertices:
        out = np.flatnonzero(((faces < 0) | (faces >= n_vertices)).any(axis=1))
        raise error(
            f"{counted(out, 'face')} with corners outside 0 ... {n_vertices - 1}: {some(out)}. "
            "Indices count from 0 (subtract 1 if the source counts from 1); do the mesh and the "
            "vertices belong together?"
        )
    return faces.astype(np.int64, copy=False)  # products of indices leave the smaller types


def check_map(f, n_vertices):
    """A map as one number or point a vertex, complex (V,) or real (V, 3), or BeltramiError."""
    surface = np.ndim(f) == 2 and np.shape(f)[1] == 3 and np.asarray(f).dtype.kind in "biuf"
    f = unmasked(f, "f").astype(float) if surface else planar_points(f, "f")
    if len(f) != n_vertices:
        raise BeltramiError(
            f"f has shape {f.shape}: give a value for each of {n_vertices} vertices"
        )
    return f


def check_coefficient(mu, n_faces):
    """mu (F,) as complex128, or BeltramiError unless |mu| < 1 everywhere."""
    mu = complex_numbers(mu, "mu")
    if mu.shape != (n_faces,):
        raise BeltramiError(f"mu has shape {mu.shape}: give a value for each of {n_faces} faces")
    bad = np.flatnonzero(~(abs(mu) < 1))
    if len(bad):
        raise BeltramiError(
            f"|mu| < 1 fails on {len(bad)} faces (first: {bad[:5].tolist()}, mu = "
            f"{mu[bad[0]]:.3g}); no orientation-preserving map has such a coefficient: truncate or "
            "mend mu there"
        )
    return mu


def check_used(disk):
    """BeltramiError where a vertex of a `Disk` is in no face: nothing says where it goes."""
    unused = np.flatnonzero(np.bincount(disk.faces.ravel(), minlength=len(disk.z)) == 0)
    if len(unused):
        raise BeltramiError(
            f"vertices {unused[:5].tolist()} are in no face; do the mesh and the vertices belong "
            "together?"
        )


def check_pins(pinned, values, n_vertices):
    """`pinned` as integers and `values` as complex numbers, or BeltramiError."""
    pinned = np.atleast_1d(unmasked(pinned, "pinned"))
    values = np.atleast_1d(complex_numbers(values, "values"))
    if pinned.ndim != 1 or pinned.shape != values.shape or len(pinned) == 0:
        raise BeltramiError(
            f"{pinned.shape} pinned vertices with {values.shape} values: give one value a vertex, "
            "for at least one"
        )
    if not np.issubdtype(pinned.dtype, np.integer):
        raise BeltramiError(f"pinned vertices have type {pinned.dtype}: give integer indices")
    outside = pinned[(pinned < 0) | (pinned >= n_vertices)]
    if len(outside):
        raise BeltramiError(f"pinned vertices out of range 0..{n_vertices - 1}: {some(outside)}")
    unique, count = np.unique(pinned, return_counts=True)
    if (count > 1).any():
        raise BeltramiError(
            f"vertices pinned more than once: {unique[count > 1][:5].tolist()}; keep one value each"
        )
    if not np.isfinite(values).all():
        raise BeltramiError(
            f"values not finite at pins {some(np.flatnonzero(~np.isfinite(values)))}"
        )
    return pinned, values
