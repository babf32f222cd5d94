"""Landmarks moved by a known map, so that at least one bijective answer exists."""

from copy import copy

from qclearn.plane.solver import DiskSolver

from .fields import random_coefficient


class DiskMaps:
    """`maps.solve(mu)`: the disk maps f (V,) of many mu (F,) on one `Disk`, as `DiskSolver.solve`.

    The solver keeps its last factorisation, tens of megabytes that cannot be sent to a worker; this
    one keeps none.
    """

    def __init__(self, disk):
        self.disk, self._solver = disk, DiskSolver(disk)
        _ = self._solver.calibration  # cached, so that the copies need not find it again

    def solve(self, mu):
        return copy(self._solver).solve(mu)


class Perturbation:
    """Draws random maps f of one `Disk` and moves landmarks by them: `p = f(q)`, f and mu known.

    landmarks (M,) complex: the targets q on the control. Source: paper, section 'Training the
    Coefficient Prediction Network'.
    """

    def __init__(self, disk, landmarks):
        self.maps, self.evaluate = DiskMaps(disk), disk.interpolation(landmarks)

    def draw(self, rng, **options):
        """(p (M,), mu (F,), f (V,)) of one random map; options as `random_coefficient`."""
        mu = random_coefficient(self.maps.disk, rng, **options)
        f = self.maps.solve(mu)
        return self.evaluate @ f, mu, f
