"""fsaverage5, the template hemispheres that come with nilearn, cut open at the medial wall."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

from .files import read_mask, read_surface
from .opening import open_surface
from .surface import Surface, SurfaceError

_FILES = {"pial": "pial", "white": "white", "inflated": "infl", "sphere": "sphere"}


def fsaverage5(hemisphere="left", kind="pial"):
    """The open hemisphere "left" or "right" of fsaverage5 as "pial", "white", "inflated" or "sphere" surface, in mm.

    The medial wall, where the cortical thickness is 0, is cut away by open_surface on the pial surface; all kinds of a
    hemisphere share this cut, so their vertices and faces correspond. Raises SurfaceError where nilearn is missing.
    """
    if hemisphere not in ("left", "right") or kind not in _FILES:
        raise SurfaceError(
            f"fsaverage5 has no '{hemisphere}' '{kind}' surface; hemispheres are left and right, kinds "
            f"{', '.join(_FILES)}."
        )
    vertices, faces = _opening(hemisphere)
    return Surface(_closed(hemisphere, kind).vertices[vertices], faces)


@cache
def _opening(hemisphere):
    """The kept vertices (V',) of the closed surface and the faces (F', 3) among them."""
    closed = _closed(hemisphere, "pial")
    medial_wall = read_mask(_folder() / f"thick_{hemisphere}.gii.gz", closed, keep=True)
    opened, vertices = open_surface(closed, medial_wall)
    return vertices, opened.faces


def _closed(hemisphere, kind):
    return read_surface(_folder() / f"{_FILES[kind]}_{hemisphere}.gii.gz")


def _folder():
    nilearn = find_spec("nilearn")  # finds it without importing it, which takes seconds
    if nilearn is None:
        raise SurfaceError("fsaverage5 comes with nilearn, which is not installed; install it: pip install nilearn.")
    return Path(nilearn.submodule_search_locations[0], "datasets", "data", "fsaverage5")
