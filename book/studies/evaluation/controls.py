"""The paper's CP-Net, corrected, trained through each solver, alike in all else, on subjects that it
has not seen."""

from platformdirs import user_cache_path

from qclearn.nets.weights import load_file

from .cpnet import EACH, curves_of, printed

RUNS = user_cache_path("qclearn") / "training" / "runs"  # of book/studies/training.py
SOLVERS = "exact", "best", "paper"


def figures(seeds, quick=False):
    """Name of the solver -> `printed`. The networks are not shipped: they are read from where they
    were trained."""
    trained = {name: next((RUNS / f"cpnet-paper-g1e5-{name}").glob("cpnet-*.safetensors"), None) for name in SOLVERS}
    missing = [name for name, path in trained.items() if path is None]
    if missing:
        raise SystemExit(
            f"not trained here: {', '.join(missing)}; python -m book.studies.training --only cpnet-paper-g1e5-"
        )
    subjects = curves_of(seeds[:2] if quick else seeds[: EACH + 1], 2_500 if quick else 10_000)
    return {name: printed(load_file(path), subjects, quick) for name, path in trained.items()}
