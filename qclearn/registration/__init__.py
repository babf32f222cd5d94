"""From landmark curves to a certified map: detection, the fit, checked networks, `register`, and its judges."""

import lazy_loader as lazy

TABLE = {
    "checked": ["guarded_map"],
    "features": ["FINEST", "FOLDS", "Feature", "check_features", "featured"],
    "fit": ["OVERFITS", "exact_map", "fit_problem"],
    "ladder": ["GUIDING_DELTA", "GUIDING_GAMMA", "LEVELS", "Climb", "Level", "climbed", "guided"],
    "landmarkfile": ["check_curves"],
    "landmarks": ["curve_distance", "curves_in_space"],
    "link": ["Link"],
    "metrics": ["log2_distortions", "measured_losses"],
    "preparation": ["Sides", "laid_upon", "sampled"],
    "problem": ["BY_DISKS", "DELTA", "ETA", "INDIVIDUAL", "Problem", "Weights"],
    "readings": ["mistakes"],
    "report": ["held_out_distances"],
    "steps": ["PrimalStep"],
    "sure": ["Laplace", "calibrated"],
    "terms": ["LandmarkTerm"],
}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
