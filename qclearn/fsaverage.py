"""Named sulci of fsaverage5: endpoints checked by hand on both hemispheres, in the numbering of the opened surfaces."""

import json
from importlib.resources import files

import numpy as np

from .surface import SurfaceError


def named_sulci(hemisphere, original_indices):
    """Endpoints of the named sulci of one hemisphere of fsaverage5: dict name -> (start, end).

    hemisphere: "left" or "right"; original_indices (V',): for each vertex of the opened surface its index on the closed
    mesh of 10,242 vertices, as `open_surface` returns it; start and end index the opened surface. Both sides run in the
    same anatomical order. SurfaceError for another hemisphere, or where an endpoint was cut away.
    """
    if hemisphere not in ("left", "right"):
        raise SurfaceError(f"hemisphere must be 'left' or 'right', not {hemisphere!r}")
    original_indices = np.asarray(original_indices)
    sulci = json.loads(files("qclearn").joinpath("fsaverage5_sulci.json").read_text(encoding="utf-8"))["sulci"]
    return {name: _renumber(name, entry[hemisphere]["vertices"], original_indices) for name, entry in sulci.items()}


def _renumber(name, vertices, original_indices):
    found = [np.flatnonzero(original_indices == vertex) for vertex in vertices]
    lost = [vertex for vertex, place in zip(vertices, found) if len(place) != 1]
    if lost:
        raise SurfaceError(f"{name}: vertices {lost} of the closed fsaverage5 are not on the opened surface; "
                           "open it with a smaller mask, and pass the original indices that belong to it")
    return tuple(int(place[0]) for place in found)
