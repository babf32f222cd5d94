"""Every method on the same problems: pairs of surfaces, runs, measures, and the files that keep the figures."""

__all__ = ["FRONT", "RUNS", "BenchmarkError", "Run", "benchmark", "run_of"]


def __getattr__(name):
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import run, runs  # here: they load the methods and the synthetic subjects, which readers of results need not

    return getattr(run if name == "benchmark" else runs, name)
