"""Synthetic cortex: folded hemispheres with named sulci and a known dense correspondence."""

from qclearn.interrupts import attach
from qclearn.io.extras import require

TABLE = {
    "cohort": "cohort hemispheres",
    "correspondence": "correspondence depth_correlation locate_on_sphere",
    "cortex": "CortexError Mechanics growth_frames make_cortex unfolded",
    "datasets": "CurveDataset cached",
    "fields": "MAX_ABS ImageFolder dead_leaves random_coefficient smooth_coefficient",
    "folding_measures": "smooth",
    "generations": "GENERATION",
    "intersections": "self_intersections",
    "realism": "low_pass_curvature realism score",
    "subjects": "load_cortex save_cortex",
    "training": "DATA_POINTS TRAINING_SEEDS Fields Pairs SolvedFields SquareFields",
}

with require("synth", "synthetic surfaces"):
    __getattr__, __dir__, __all__ = attach(__name__, TABLE)
