"""Every method on the same problems: pairs of surfaces, runs, measures, and the files that keep the figures."""

from importlib import import_module

__all__ = ["FRONT", "RUNS", "BenchmarkError", "Run", "benchmark", "read_measured", "run_of"]


def __getattr__(name):
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # Here: run and runs load the methods and the synthetic subjects, which readers of results need not.
    room = {"benchmark": "run", "BenchmarkError": "measured", "read_measured": "measured"}.get(name, "runs")
    return getattr(import_module(f".{room}", __name__), name)
