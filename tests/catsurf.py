"""A stand-in for cat-surf: its spheres are projections, its Spherical Demons half a turn about x."""

import os

PROGRAM = """
import nibabel, numpy as np
def read_surface(path):
    return tuple(array.data for array in nibabel.load(path).darrays)
def write_surface(path, points, faces):
    kinds = zip((points.astype("f4"), faces.astype("i4")), ("NIFTI_INTENT_POINTSET", "NIFTI_INTENT_TRIANGLE"))
    arrays = [nibabel.gifti.GiftiDataArray(data, intent) for data, intent in kinds]
    nibabel.save(nibabel.gifti.GiftiImage(darrays=arrays), path)
def surf_to_sphere(points, faces, stop_at, relax):
    assert len(points) > 200, "no licence"
    out = points - points.mean(0)
    return 100 * out / np.linalg.norm(out, axis=1, keepdims=True), faces
def spherical_demon(moving, sphere, control, other):
    return sphere[0] * [1, -1, -1], sphere[1]
"""


def put_in_place_of_cat_surf(folder, monkeypatch):
    """For this process to find, and for its children to load."""
    (folder / "cat_surf.py").write_text(PROGRAM)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
