"""From landmark curves to a certified map: detection, the fit, checked networks, `register`, and its judges."""

from ..lazy import offer

TABLE = {
    "certified": ["exact_map"],
    "checked": ["guarded_map"],
    "engine": ["GaussNewton", "SurfaceGaussNewton"],
    "features": ["FINEST", "FOLDS", "Feature", "Features", "check_features"],
    "fit": ["fit_on_grid", "fit_on_mesh", "fit_problem"],
    "hybrid": ["GUIDING_DELTA", "GUIDING_GAMMA", "LEVELS", "OVERFITS", "Level", "engine_of"],
    "landmarkfile": ["check_curves"],
    "landmarks": ["curve_distance", "curves_in_space"],
    "landmarkterm": ["Landmarks"],
    "metrics": ["measured_losses"],
    "normal": ["NormalEquations"],
    "preparation": ["Sides", "lay_upon", "sampled"],
    "problem": ["DELTA", "Problem", "Weights"],
    "report": ["held_out_distances"],
    "suspect": ["mistakes"],
    "transfer": ["lift"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
