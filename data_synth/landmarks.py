"""Landmarks moved by a known map, so that at least one bijective answer exists."""

from copy import copy

from data_synth.fields import random_coefficient
from qclearn.plane.disk import BeltramiDiskSolver
from qclearn.plane.diskmesh import sampling_matrix


class DiskMaps:
    """`maps.solve(mu)`: the disk maps f (V,) of many mu (F,) on one mesh, as `BeltramiDiskSolver.solve`.

    The solver keeps its last factorisation, tens of megabytes that cannot be sent to a worker; this one keeps none.
    """

    def __init__(self, z, faces):
        self._solver = BeltramiDiskSolver(z, faces)
        self.z, self.faces = self._solver.z, self._solver.faces
        _ = self._solver.calibration  # cached, so that the copies need not find it again

    def solve(self, mu):
        return copy(self._solver).solve(mu)


class Perturbation:
    """Draws random disk maps on one mesh and moves landmarks by them: `p = f(q)`, with f and its mu known.

    z (V,), faces (F, 3): the disk mesh; landmarks (M,) complex: the targets q on the control. Source: paper, section
    'Training the Coefficient Prediction Network'.
    """

    def __init__(self, z, faces, landmarks):
        self.maps = DiskMaps(z, faces)
        self.evaluate = sampling_matrix(z, faces, landmarks)

    def draw(self, rng, **options):
        """(p (M,), mu (F,), f (V,)) of one random map; options as `random_coefficient`."""
        mu = random_coefficient(self.maps.z, self.maps.faces, rng, **options)
        f = self.maps.solve(mu)
        return self.evaluate @ f, mu, f
