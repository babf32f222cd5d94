"""The paper's three networks, each behind the same call as its exact twin."""

from ..files.extras import require

with require("nets", "the networks"):
    from .train import TrainConfig, TrainingError, train
    from .weights import WeightsError, build, load, load_file, save_weights

__all__ = ["TrainConfig", "TrainingError", "WeightsError", "build", "load", "load_file", "save_weights", "train"]
