"""What `register` reports of a map: errors of fitted and held-out curves, distortion, features, and what was done."""

from importlib.metadata import version

import numpy as np

from ..plane.diskmesh import sampling_matrix
from ..plane.mobius import mobius
from ..surfaces.checks import degenerate_faces
from .landmarks import curve_distance, curves_in_space
from .metrics import coefficient_statistics, log2_distortions, mean_rows
from .preparation import sample_side
from .suspect import disagreeing, reasons
from .transfer import error_rows

ERRORS = "landmark_error_before", "landmark_error", "landmark_error_mm"  # null where no landmark was given


def report_of(sides, landmarks, weights, fit, points):
    """The report of a registration, a dict for JSON, but for what the call asked for and the seconds it took."""
    rows, features = landmark_rows(sides, landmarks, fit), sides.features
    plain = mobius(sides.z_moving, *landmarks.problem.mobius)
    suspect = reasons(sides.moving, sides.control, sides.z_moving, sides.z_control, sides.entries, rows, fit)
    return {
        **dict.fromkeys(ERRORS),
        **mean_rows(rows),
        **coefficient_statistics(fit.mu),
        **log2_distortions(sides.moving, points),
        "flipped": len(fit.flipped),
        "bijective": fit.bijective,
        "degenerate": len(degenerate_faces(points, sides.moving.faces)),
        "fallbacks": [*sides.words, *landmarks.words, *fit.fallbacks],
        "alpha": weights.alpha,
        "beta": weights.beta,
        "gamma": weights.gamma,
        "delta": weights.delta,
        "features": dict(zip(features.names, features.shares.tolist())) if features else {},
        "r": fit.r if features else {},
        "mobius": {"a": [fit.mobius[0].real, fit.mobius[0].imag], "theta": fit.mobius[1]},
        "curves": rows,
        "held_out_mm": held_out_distances(sides, plain, fit.f),
        "suspect": [*suspect, *(disagreeing(features, plain) if features else [])],
        "version": version("qclearn"),
    }


def landmark_rows(sides, landmarks, fit):
    """`error_rows` of the fitted curves, [] without any."""
    if not sides.entries:
        return []
    maps = sides.moving, sides.control, sides.z_moving, sides.z_control
    return error_rows(*maps, sides.entries, landmarks.samples, fit.f)


def held_out_distances(sides, *maps):
    """How far the curves that took no part end from their own on the control: name -> mean two-way distance in the
    control's length, for each of the maps (V,)."""
    if not sides.held:
        return {}
    lines_moving, lines_control = (
        sample_side(surface, z, sides.held, side)[1]
        for surface, z, side in (
            (sides.moving, sides.z_moving, "moving"),
            (sides.control, sides.z_control, "control"),
        )
    )
    stops = np.cumsum([len(line) for line in lines_moving])[:-1]
    samples = sampling_matrix(sides.z_moving, sides.moving.faces, np.concatenate(lines_moving))
    wanted = curves_in_space(sides.control, sides.z_control, lines_control)
    found = [curves_in_space(sides.control, sides.z_control, np.split(samples @ f, stops)) for f in maps]
    distances = [[float(curve_distance(*pair)) for pair in zip(curves, wanted)] for curves in found]
    return {entry["name"]: list(row) for entry, row in zip(sides.held, zip(*distances))}
