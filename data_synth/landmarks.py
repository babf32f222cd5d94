"""Landmarks moved by a known map, so that at least one bijective answer exists."""

from qclearn.disk import BeltramiDiskSolver
from qclearn.fit import sampling_matrix

from .fields import random_coefficient


class Perturbation:
    """Draws random disk maps on one mesh and moves landmarks by them: `p = f(q)`, with f and its mu known.

    z (V,), faces (F, 3): the disk mesh; landmarks (M,) complex: the targets q on the control. Source: paper, section
    'Training the Coefficient Prediction Network'.
    """

    def __init__(self, z, faces, landmarks):
        self.solver = BeltramiDiskSolver(z, faces)
        self.evaluate = sampling_matrix(z, faces, landmarks)

    def draw(self, rng, **options):
        """(p (M,), mu (F,), f (V,)) of one random map; options as `random_coefficient`."""
        mu = random_coefficient(self.solver.z, self.solver.faces, rng, **options)
        f = self.solver.solve(mu)
        return self.evaluate @ f, mu, f
