"""Every method on the same problems: pairs of surfaces, runs, measures, and the files that keep the figures."""

from ..lazy import offer

TABLE = {
    "cortex": ["AMPLITUDES"],
    "pairs": ["CONTROL", "cohort_pair", "displacement_pair", "fsaverage_pair", "mapped", "mapped_subject", "prepare"],
    "problems": ["DISTANCES"],
    "results": [
        "BenchmarkError",
        "compare_fronts",
        "compare_runs",
        "median_pair",
        "methods_and_oracles",
        "noted",
        "read_networks",
        "read_results",
        "summary",
    ],
    "run": ["benchmark"],
    "runs": ["FRONT", "RUNS", "Run"],
    "yardstick": ["floors"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
