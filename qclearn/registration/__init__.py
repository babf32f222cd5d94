"""From landmark curves to a certified map. In the order in which `register` uses them:

- register: the call itself, its arguments, its stages, its result.
- curves: landmark curves, read, sampled, detected, checked.
- features: depth, curvature and maps of one's own; disks aligned by them.
- start: two surfaces with their disks, aligned, the landmarks sampled on both, and two starts of a
  fit without landmarks.
- diagnose: wrong landmarks told before the fit, suspect maps after it, and the limits of both.
- problem: what a fit is given: landmarks, targets, weights and their defaults.
- fit: the fit, what it falls back to, and its certificate.
- levels: the meshes of a fit, from coarse to fine; how many steps each takes, when it
  ends.
- gauss_newton, residuals: the objective, one step on one mesh, and the terms that it lowers.
- networks: maps that networks predict, checked, and replaced or fitted further where they fail.
- report: errors, distortion, held-out curves.
- uncertainty: the error radius.

Beside it: transfer (values carried).
"""

from ..interrupts import attach

TABLE = {
    "curves": "Curve check_curves curve_distance curves_in_space",
    "diagnose": "astray diagnose_landmarks",
    "features": "FINEST FOLDS LOCAL NEIGHBOURHOOD Feature check_features featured",
    "fit": "OVERFITS exact_map fit_problem",
    "gauss_newton": "PrimalStep",
    "levels": "GUIDING_DELTA GUIDING_GAMMA LEVELS Level MultiresolutionFit guided run_level",
    "networks": "certified_network_map",
    "start": "SurfacePair align_disks lines_by_name sample_landmarks",
    "problem": "DELTA_BY_DISKS DELTA ETA Problem Weights",
    "report": "held_out_distances log2_distortions measured_losses",
    "residuals": "LandmarkTerm",
    "uncertainty": "Laplace calibrated",
}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
