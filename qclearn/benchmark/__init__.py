"""Every method on the same problems: surface pairs, runs, measures, and files of results."""

from ..interrupts import attach

TABLE = {
    "cortex": "AMPLITUDES",
    "images": "carried",
    "measured": "BenchmarkError read_measured",
    "pairs": "CONTROL cohort_pair displacement_pair fsaverage_pair mapped mapped_subject prepare",
    "problems": "DISTANCES",
    "reference_metrics": "area_and_shape floors",
    "rows": "failures summary",
    "run": "benchmark",
    "runs": "RUNS Run",
}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
