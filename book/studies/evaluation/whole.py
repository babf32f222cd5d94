"""The paper's CP-Net, corrected, at gamma = 1e5 as it is shipped, and trained with what its averages
lose counted in."""

from qclearn.nets import load
from qclearn.nets.weights import load_file

from .controls import RUNS
from .cpnet import EACH, curves_of, printed

NAME = "cpnet-paper-g1e5-whole"


def figures(seeds, quick=False):
    """Loss -> `printed` on subjects that neither has seen. The second is read from where it was
    trained."""
    path = next((RUNS / NAME).glob("cpnet-*.safetensors"), None)
    if path is None:
        raise SystemExit(f"not trained here: {NAME}; python -m book.studies.training --only {NAME}")
    subjects = curves_of(seeds[:2] if quick else seeds[: EACH + 1], 2_500 if quick else 10_000)
    return {
        "corrected": printed(load("cpnet", "paper", 1e5), subjects, quick),
        "whole": printed(load_file(path), subjects, quick),
    }
