"""A masked array is refused wherever one comes in, unless it masks nothing: NumPy would drop the mask in silence."""

import numpy as np
import pytest

import qclearn as qc
from known_surfaces import sphere
from meshes import bowl
from qclearn.plane.disk import Disk
from qclearn.plane.fourier import from_square
from qclearn.plane.grids import polar_disk
from qclearn.registration.features import Feature, check_features

Z, FACES = polar_disk(3, 8)
FEW = np.zeros(len(FACES), complex)
BALL = sphere()
SHAPE = bowl(0.6)
X = SHAPE.vertices[:, 0]
PATH = np.array([1, 25, 49])
# An array, and a call that takes it; what goes through one check of qclearn.plane.checks is here once.
TAKEN = {
    "z": (Z, lambda z: qc.signed_areas(z, FACES)),
    "faces": (FACES, lambda faces: qc.signed_areas(Z, faces)),
    "a surface": (np.ones((len(Z), 3)), lambda f: qc.wirtinger(Z, FACES, f)),
    "pins": (np.arange(2), lambda pins: qc.solve_beltrami(Z, FACES, FEW, pins, Z[:2])),
    "landmarks": (Z[1:5], lambda p: qc.fit_landmarks(Z, FACES, p, Z[1:5])),
    "a square": (np.ones((8, 8)), lambda image: from_square(image, Disk(Z, FACES))),
    "values": (Z.real, lambda values: qc.transfer(values, Z, FACES, Z)),
    "vertices": (SHAPE.vertices, lambda vertices: qc.Surface(vertices, SHAPE.faces)),
    "numbers": (np.arange(len(X)), lambda some: qc.Surface(SHAPE.vertices, SHAPE.faces, original_vertices=some)),
    "a curve": (PATH, lambda path: qc.Surface(SHAPE.vertices, SHAPE.faces, {"a": path})),
    "a path": (PATH, lambda path: qc.sample_curve(SHAPE, path)),
    "ends": (PATH[None, :2], lambda ends: qc.detect_curves(SHAPE, X + 1j * SHAPE.vertices[:, 1], ends)),
    "what to cut": (BALL.vertices[:, 2] < -0.8, lambda mask: qc.open_surface(BALL, mask)),
    "a feature": (X, lambda given: check_features([Feature("x", given, X)], SHAPE, SHAPE)),
    "a map": (X, lambda values: qc.write_values("map.npy", values)),
}


@pytest.mark.parametrize("case", TAKEN)
def test_a_mask_that_hides_values_is_never_dropped(case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    array, take = TAKEN[case]
    take(np.ma.masked_array(array, False))
    hidden = np.ma.masked_array(array, np.arange(array.size).reshape(array.shape) == array.size - 1)
    with pytest.raises(ValueError, match=rf"masked in 1 row: {len(array) - 1}; .* fill them in"):
        take(hidden)
