"""conte69, the average cortex of 69 young adults, with maps, from the package brainspace.

Its mesh is fs_LR (Van Essen et al. 2012), on which the two sides correspond vertex by vertex:
ground truth on real cortex. The maps (T1w/T2w, thickness, gradients of connectivity) are averages,
too, and were not used to make the mesh.
"""

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..surfaces.opening import open_surface
from ..surfaces.surface import Surface, SurfaceError
from .extras import require
from .meshes import read_surface
from .safe import explain

SIDES = ["lh", "rh"]
ADVICE = "install brainspace again"
MAPS = {
    "T1w/T2w": "t1wt2w",
    "thickness": "thickness",
    "functional gradient": "fc_gradient0",
    "microstructural gradient": "mpc_gradient0",
}


class Conte69(NamedTuple):
    """Both sides of conte69, open at the medial wall, in mm; equal vertex numbers correspond.

    maps: name -> (left (V,), right (V,)), NaN where a map has no value.
    """

    left: Surface
    right: Surface
    maps: dict


def conte69(folder=None):
    """The two sides of conte69 and their maps, all cut by both sides' masks.

    folder: of brainspace's data sets, by default the installed package's. ImportError without the
    package; SurfaceError where a file is missing or does not fit the others.
    """
    folder = installed_folder() if folder is None else Path(folder)
    closed = [read_surface(folder / "surfaces" / f"conte69_32k_{side}.gii") for side in SIDES]
    if not np.array_equal(*(np.sort(surface.edges, axis=1) for surface in closed)):
        raise SurfaceError(f"{folder}: the two sides of conte69 differ in their mesh; {ADVICE}")
    count = len(closed[0].vertices)
    masks = [folder / "surfaces" / f"conte69_32k_{side}_mask.csv" for side in SIDES]
    wall = ~np.all([numbers(mask, count) for mask in masks], axis=0)
    (left, vertices), (right, same) = (open_surface(surface, wall) for surface in closed)
    if not np.array_equal(vertices, same):
        message = "the masks open the two sides of conte69 differently"
        raise SurfaceError(f"{folder}: {message}; {ADVICE}")
    maps = {}
    for name, file in MAPS.items():
        values = numbers(folder / "matrices" / "main_group" / f"conte69_32k_{file}.csv", 2 * count)
        maps[name] = values[:count][vertices], values[count:][vertices]
    return Conte69(left, right, maps)


def installed_folder():
    """The folder of brainspace's data sets, without importing it."""
    require("conte69", "the surfaces of conte69")
    return Path(find_spec("brainspace").submodule_search_locations[0], "datasets")


def numbers(path, count):
    """The `count` numbers of a text file, NaN where it says so, or SurfaceError."""
    with explain(path, "table of numbers"):
        values = np.loadtxt(path, delimiter=",").ravel()
    if len(values) != count:
        raise SurfaceError(f"{path}: {len(values)} numbers for {count} vertices; {ADVICE}")
    return values
