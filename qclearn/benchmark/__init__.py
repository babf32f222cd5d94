"""Every method on the same problems: surface pairs, runs, measures, and files of results."""

import lazy_loader as lazy

TABLE = {
    "cortex": "AMPLITUDES",
    "images": "carried",
    "measured": "BenchmarkError read_measured",
    "pairs": "CONTROL cohort_pair displacement_pair fsaverage_pair mapped mapped_subject prepare",
    "problems": "DISTANCES",
    "reference_metrics": "area_and_shape floors",
    "rows": "chain_seconds compare_fronts compare_runs failures median_pair methods_and_oracles "
    "noted saving summary",
    "run": "benchmark",
    "runs": "RUNS Run",
    "verdicts": "FACTOR compared judge_all judge_bound judge_order judge_ratio judge_size side",
}
MODULES = {module: names.split() for module, names in TABLE.items()}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=MODULES)
