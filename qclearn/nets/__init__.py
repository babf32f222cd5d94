"""The paper's three networks, each behind the same call as its exact counterpart."""

from ..interrupts import attach
from ..io.extras import require

TABLE = {
    "cpnet": "BestCPNet BestCPNetConfig",
    "gauges": "gauge_errors",
    "layers": "DiskNetwork PolarFunction",
    "ldnet": "heat_metric",
    "losses": "L_LBS L_Boundary L_DBSNet L_Energy L_LBS_printed L_grad_mu L_lost LossMesh area energy",
    "networks": "NETWORKS Network WeightsError",
    "pictures": "picture stamp",
    "polar": "PolarSolver",
    "run": "header",
    "train": "Objective Process TrainConfig TrainingError rate_at take_step train",
    "weights": "FOLDER build load load_file read_weights save_weights",
}

with require("nets", "the networks"):
    __getattr__, __dir__, __all__ = attach(__name__, TABLE)
