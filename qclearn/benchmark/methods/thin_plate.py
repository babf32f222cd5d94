"""Thin-plate splines: the smoothest interpolation of the landmarks, with no word on bijectivity."""

import numpy as np
from scipy.interpolate import RBFInterpolator
from threadpoolctl import threadpool_limits

from ...plane.disk import pairs
from ...plane.mobius import mobius


@threadpool_limits.wrap(limits=1)
def thin_plate(problem, smoothing=0.0):
    """The best Möbius map, then the thin-plate spline from its landmarks to the targets, f (V,).

    Minimises `sum_k |f(p_k) - q_k|^2 + smoothing * int |D^2 f|^2` over the plane, up to the
    spline's constant; 0 interpolates. Keeps neither the circle nor orientation. Source: Bookstein
    (1989); scipy's RBFInterpolator.
    """
    moved, points = mobius(problem.disk.z, *problem.mobius), mobius(problem.moving, *problem.mobius)
    spline = RBFInterpolator(
        pairs(points), pairs(problem.target), kernel="thin_plate_spline", smoothing=smoothing
    )
    return spline(pairs(moved)) @ np.array([1, 1j])
