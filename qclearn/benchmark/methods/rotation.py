"""The floor of methods on spheres: the best rotation by folds."""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from ...registration.features import FINEST, SCALE
from .folds import with_folds
from .spheres import SphereError

# Degrees, half of the widths of the searches, one after the other.
SPANS = 32.0, 16.0, 8.0, 4.0, 2.0, 1.0
STEPS = 2, 1  # grid points to either side of 0, first and later
JUDGES = 4000  # vertices that judge a rotation


def rotation(problem):
    """The rotation of the moving sphere whose folds fit the control's best: points (V', 3).

    Greatest mean over the moving area of each map of folds times the control's, standardised, each
    moving vertex with the control's nearest: at the scale SCALE from far, at FINEST from 4 degrees
    on. Grids of three angles, ever narrower, from the spheres as they lie.
    SphereError where a surface has no sphere.
    """
    pair = with_folds(problem)
    moving, control = pair.moving.sphere, pair.control.sphere
    if moving is None or control is None:
        advice = "give each `ParameterizedSurface` a `sphere`"
        raise SphereError(f"this method turns spheres, and the surfaces come without: {advice}")
    count = len(pair.moving.surface.vertices)
    judges = np.random.default_rng(0).permutation(count)[:JUDGES]
    points, areas = moving.points[judges], pair.features.areas[judges]
    tree, best = cKDTree(control.points), Rotation.identity()
    for span in SPANS:
        here, there = pair.features.at(FINEST if span <= 4 else SCALE)
        # The wall has no folds.
        there = np.pad(there, ((0, len(control.points) - len(there)), (0, 0)))
        steps = STEPS[span < SPANS[0]]
        axis = np.arange(-steps, steps + 1) * span / steps
        angles = np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)
        tries = Rotation.from_euler("xyz", angles, degrees=True) * best
        nearest = [tree.query(one.apply(points))[1] for one in tries]
        weights = pair.features.feature_weights
        fits = [areas @ ((here[judges] * there[near]) @ weights) for near in nearest]
        best = tries[int(np.argmax(fits))]
    return best.apply(moving.points)
