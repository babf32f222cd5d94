"""Values at vertices, carried from one surface to the other."""

import warnings

import numpy as np
from jaxtyping import Bool, Complex, Integer, Num
from numpy import ndarray

from ..plane.checks import check_used, unmasked
from ..plane.disk import Disk


def transfer(
    values: Num[ndarray, " V *k"] | Bool[ndarray, " V *k"],
    z_from: Complex[ndarray, " V"],
    faces_from: Integer[ndarray, " F 3"],
    z_to: Complex[ndarray, " P"],
    nearest: bool = False,
    sum: bool = False,
    faces_to: Integer[ndarray, " G 3"] | None = None,
) -> Num[ndarray, " P *k"] | Bool[ndarray, " P *k"]:
    """Per-vertex values of one disk mesh carried to the points z_to of the same disk.

    From control to moving: `transfer(values, disk_control, faces_control, disk_map)`; back:
    `transfer(values, disk_map, faces_moving, disk_control)`. Linear in each triangle, or with
    `nearest` the value of the corner with the largest weight (for labels: whole numbers and booleans
    are refused without it, and a warning tells of floats that are all whole).

    sum: the values are amounts at vertices (FreeSurfer's ?h.area and ?h.volume), and z_to with
    `faces_to` is a mesh. Their density is carried, `t_p = k A_p sum_i w_pi s_i / a_i`: s the
    values, w the weights, a and A a third of the areas in the disk around a vertex of either mesh,
    and k, near 1, such that the sum of |s| is kept, where s >= 0 that of s (what is not finite
    counts as 0). ValueError if the count of values is not that of the vertices, or some are masked.
    """
    values = np.atleast_1d(unmasked(values, "values", ValueError))
    disk = Disk(z_from, faces_from)
    if len(values) != len(disk.z):
        raise ValueError(
            f"{len(values)} values for {len(disk.z)} vertices: give one a vertex of the surface "
            "they come from (the cut-open one, if it was cut), of a file by read_values(path)"
        )
    face, weights = disk.locate(z_to)

    def carried(values):
        if nearest:
            return values[disk.faces[face, weights.argmax(1)]]
        return disk.interpolate(values, (face, weights))

    if sum:
        if faces_to is None or values.dtype.kind not in "fc":
            raise ValueError("sum needs amounts (floats), and faces_to, the faces of the mesh z_to")
        meshes, shape = (disk, Disk(z_to, faces_to)), (-1, *[1] * (values.ndim - 1))
        for mesh in meshes:
            check_used(mesh)
        a, A = ((mesh.to_faces.T @ abs(mesh.areas)).reshape(shape) for mesh in meshes)
        size = np.where(np.isfinite(values), abs(values), 0)
        found = (A * carried(size / a)).sum(0)
        k = np.divide(size.sum(0), found, out=np.ones_like(found), where=found > 0)
        return k * A * carried(values / a)
    columns = values.reshape(len(values), -1).T if values.dtype.kind == "f" else ()
    sets = [np.unique(column[np.isfinite(column)]) for column in columns]
    if not nearest and any(len(one) > 1 and not (one % 1).any() for one in sets):
        advice = "give nearest=True (--nearest) if these are labels"
        warnings.warn(f"whole numbers, carried as numbers; {advice}", stacklevel=2)
    return carried(values)
