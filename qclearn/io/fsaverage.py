"""fsaverage5, the template that comes with nilearn, open at the medial wall, with named sulci."""

import json
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ..surfaces.opening import open_surface
from ..surfaces.surface import Surface, SurfaceError, places_of
from .meshes import read_surface
from .values import read_mask

_FILES = {"pial": "pial", "white": "white", "inflated": "infl", "sphere": "sphere"}


def fsaverage5(hemisphere: str = "left", kind: str = "pial", wall: str = "cortex") -> Surface:
    """The open hemisphere "left" or "right" of fsaverage5, in mm, of a kind.

    The medial wall is cut away: "cortex", as FreeSurfer's annotation leaves it out, a tenth of the
    vertices (fsaverage5_wall.json names the source), so that it matches a person's surface cut by
    ?h.cortex.label; "thickness", where thickness is 0, a smaller cut. All kinds of a hemisphere
    share it, so their vertices and faces correspond. SurfaceError where nilearn is missing.
    """
    whole = whole_fsaverage5(hemisphere, kind)
    vertices, faces = _opening(hemisphere, wall)
    return Surface(whole.vertices[vertices], faces, original_vertices=vertices)


def whole_fsaverage5(hemisphere="left", kind="sphere"):
    """The closed hemisphere of fsaverage5 with its medial wall, kinds as of `fsaverage5`, in mm."""
    if hemisphere not in ("left", "right") or kind not in _FILES:
        raise SurfaceError(
            f"fsaverage5 has no '{hemisphere}' '{kind}' surface; hemispheres left and right, "
            f"kinds {', '.join(_FILES)}"
        )
    return read_surface(_folder() / f"{_FILES[kind]}_{hemisphere}.gii.gz")


def named_sulci(hemisphere, original_indices):
    """Ends of fsaverage5's named sulci: dict name -> (start, end) on the opened surface.

    hemisphere: "left" or "right"; original_indices (V',): the opened surface's vertices on the
    closed mesh, as from `open_surface`. fsaverage5_sulci.json tells how each was chosen.
    SurfaceError where an endpoint was cut away.
    """
    if hemisphere not in ("left", "right"):
        message = f"fsaverage5 has no hemisphere '{hemisphere}'"
        raise SurfaceError(f"{message}; hemispheres are left and right")
    original_indices = np.asarray(original_indices)
    ends = {}
    for name, entry in _record("sulci")["sulci"].items():
        vertices = np.array(entry[hemisphere]["vertices"])
        ends[name] = tuple(places_of(vertices, original_indices).tolist())
        if min(ends[name]) < 0:
            lacking = vertices[np.array(ends[name]) < 0].tolist()
            raise SurfaceError(
                f"{name}: vertices {lacking} of the closed fsaverage5 are cut away; cut less, and "
                "pass this surface's indices"
            )
    return ends


def demo_landmarks() -> dict:
    """Landmarks of `mirror(fsaverage5("right"))` (moving) and `fsaverage5("left")` (control).

    `{"curves": [{"name", "moving": [start, end], "control": [start, end]}]}`: endpoints only.
    """
    moving, control = (named_sulci(side, _opening(side)[0]) for side in ("right", "left"))
    ends = {name: (list(moving[name]), list(control[name])) for name in control}
    curves = [{"name": name, "moving": a, "control": b} for name, (a, b) in ends.items()]
    return {"curves": curves}


@cache
def _opening(hemisphere, wall="cortex"):
    """The remaining vertices (V',) of the closed surface and the faces (F', 3) among them."""
    closed = whole_fsaverage5(hemisphere, "pial")
    if wall == "cortex":
        medial_wall = np.isin(np.arange(len(closed.vertices)), _record("wall")[hemisphere])
    elif wall == "thickness":
        medial_wall = read_mask(_folder() / f"thick_{hemisphere}.gii.gz", closed, keep=True)
    else:
        raise SurfaceError(f"fsaverage5 has no wall '{wall}'; walls are cortex and thickness")
    opened, vertices = open_surface(closed, medial_wall)
    return vertices, opened.faces


def _record(name):
    """fsaverage5_NAME.json, which comes with the package."""
    path = files(__package__).joinpath(f"fsaverage5_{name}.json")
    return json.loads(path.read_text(encoding="utf-8"))


def _folder():
    nilearn = find_spec("nilearn")  # finds it without importing it, which takes seconds
    if nilearn is None:
        raise SurfaceError(
            "fsaverage5 comes with nilearn, which is not installed; install it: pip install nilearn"
        )
    return Path(nilearn.submodule_search_locations[0], "datasets", "data", "fsaverage5")
