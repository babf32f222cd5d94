"""From landmark curves to a certified map: detection, the fit, checked networks, `register`, and
its diagnosis."""

import lazy_loader as lazy

TABLE = {
    "curves": ["Curve", "check_curves", "curve_distance", "curves_in_space"],
    "diagnose": ["astray", "diagnose_landmarks"],
    "features": ["FINEST", "FOLDS", "Feature", "check_features", "featured"],
    "fit": ["OVERFITS", "exact_map", "fit_problem"],
    "gauss_newton": ["PrimalStep"],
    "metrics": ["log2_distortions", "measured_losses"],
    "multiresolution": [
        "GUIDING_DELTA",
        "GUIDING_GAMMA",
        "LEVELS",
        "Level",
        "MultiresolutionFit",
        "guided",
        "run_level",
    ],
    "networks": ["certified_network_map"],
    "pair": ["SurfacePair", "align_disks", "lines_by_name", "sample_landmarks"],
    "problem": ["DELTA_BY_DISKS", "DELTA", "ETA", "Problem", "Weights"],
    "report": ["held_out_distances"],
    "residuals": ["LandmarkTerm"],
    "uncertainty": ["Laplace", "calibrated"],
}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
