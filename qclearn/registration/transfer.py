"""Values at vertices, carried from one surface to the other."""

import numpy as np
from jaxtyping import Bool, Complex, Integer, Num
from numpy import ndarray

from ..plane.disk import Disk


def transfer(
    values: Num[ndarray, " V *k"] | Bool[ndarray, " V *k"],
    z_from: Complex[ndarray, " V"],
    faces_from: Integer[ndarray, " F 3"],
    z_to: Complex[ndarray, " P"],
    nearest: bool = False,
) -> Num[ndarray, " P *k"] | Bool[ndarray, " P *k"]:
    """Per-vertex values of one disk mesh carried to the points z_to of the same disk.

    From control to moving: `transfer(values, disk_control, faces_control, disk_map)`; back:
    `transfer(values, disk_map, faces_moving, disk_control)`. Linear in each triangle, or with
    `nearest` the value of the corner with the largest weight (for labels). ValueError if the count
    of values is not that of the vertices.
    """
    values = np.asarray(values)
    if len(values) != len(z_from):
        raise ValueError(
            f"{len(values)} values for {len(z_from)} vertices: give one a vertex of the surface "
            "they come from (the cut-open one, if it was cut)"
        )
    disk = Disk(z_from, faces_from)
    face, weights = disk.locate(z_to)
    if nearest:
        return values[disk.faces[face, weights.argmax(1)]]
    return disk.interpolate(values, (face, weights))
