"""The benchmark's table of runs: each a method with its parameters and a source of landmarks."""

import inspect
import json
from dataclasses import dataclass, field

from ..registration.problem import DELTA, Weights
from .measured import BenchmarkError
from .methods.networks import network, networks_of
from .pairs import DETECTORS, SOURCES

SETS = ("cohort", "displacement", "fsaverage5", "heldout", "warp", "conte69", "folder")


@dataclass(frozen=True)
class Run:
    """A row's recipe: its name, the method and its parameters, the landmarks' source (SOURCES).

    sets: the sets of problems it is run on; keep_field: keep |mu| on the control's disk, for
    pictures over subjects; uncertainty: where the truth is known, judge the radius that `register`
    gives with the same settings.
    """

    name: str
    method: str
    parameters: dict = field(default_factory=dict)
    landmarks: str = "given"
    sets: tuple = SETS
    keep_field: bool = False
    uncertainty: bool = False


KNOWN = ("cohort",)  # the set with true curves and a true map
DETECTED = (*KNOWN, "fsaverage5")  # sets whose curves have ends to detect them from
WEIGHED = (*KNOWN, "displacement", "fsaverage5")  # sets with a row for every weight of a method
HELD_OUT = ("heldout", "conte69", "folder")  # sets with held-out curves
FOLDED = (*DETECTED, *HELD_OUT, "warp")  # all sets with folds to match
COARSE = (*WEIGHED, "heldout", "warp")  # those with few vertices: for slow methods
USUAL = {"alpha": Weights.alpha, "beta": Weights.beta, "gamma": Weights.gamma}
HYBRID = USUAL | {"delta": DELTA}
EQUAL = {"alpha": 1.0, "beta": 1.0}
PRINTED = {"preset": "paper"} | EQUAL


def paper_run(name, gamma, **more):
    """A run of the paper's networks; its CP-Net has weights for one control and each gamma."""
    return Run(name, "cpnet_dbsnet", PRINTED | {"gamma": gamma}, sets=KNOWN, **more)


RUNS = (
    Run("Möbius", "mobius_only"),
    *(
        Run(f"harmonic {weight:g}", "harmonic", {"weight": weight}, sets=WEIGHED)
        for weight in (0.1, 0.5, 1.0)
    ),
    Run("harmonic 5", "harmonic", {"weight": 5.0}),
    Run("thin plate", "thin_plate", sets=COARSE),
    Run("QC iteration", "qc_iteration", sets=COARSE),
    Run("Teichmüller", "teichmuller", sets=WEIGHED),
    Run("Gauss-Newton (1, 1, 1e4)", "gauss_newton", EQUAL | {"gamma": 1e4}, sets=WEIGHED),
    Run("Gauss-Newton (1, 1, 1e5)", "gauss_newton", EQUAL | {"gamma": 1e5}, sets=WEIGHED),
    Run("Gauss-Newton (1, 1, 2e5)", "gauss_newton", EQUAL | {"gamma": 2e5}, sets=WEIGHED),
    Run("Gauss-Newton", "gauss_newton", USUAL, keep_field=True, uncertainty=True),
    Run("Gauss-Newton, sliding", "gauss_newton", USUAL | {"sliding": True}, sets=WEIGHED),
    Run("Gauss-Newton (1, 0.01, 1e5)", "gauss_newton", USUAL | {"gamma": 1e5}),
    Run("hybrid", "hybrid", HYBRID, sets=FOLDED, keep_field=True, uncertainty=True),
    Run("hybrid (1, 0.01, 1e5)", "hybrid", HYBRID | {"gamma": 1e5}, sets=("fsaverage5", *HELD_OUT)),
    Run("dense", "dense", {"delta": DELTA}, sets=FOLDED),
    Run("landmark-free", "landmark_free", {"delta": DELTA}, sets=FOLDED, uncertainty=True),
    Run("Gauss-Newton, path", "gauss_newton", USUAL, "path", KNOWN),
    Run("Gauss-Newton, exact landmarks", "gauss_newton", USUAL, "exact", KNOWN),
    paper_run("paper's networks (1, 1, 1e4)", 1e4),
    paper_run("paper's networks (1, 1, 1e5)", 1e5, keep_field=True),
    paper_run("paper's networks (1, 1, 2e5)", 2e5),
    paper_run("paper's networks (1, 1, 1e5), LD-Net", 1e5, landmarks="ldnet_paper"),
    paper_run("paper's networks (1, 1, 1e5), path", 1e5, landmarks="path"),
    Run("CP-Net and DBS-Net", "cpnet_dbsnet", USUAL, sets=WEIGHED, keep_field=True),
    Run("CP-Net and DBS-Net, LD-Net", "cpnet_dbsnet", USUAL, "ldnet", DETECTED),
    Run("CP-Net, exact solver", "cpnet_exact", USUAL, sets=WEIGHED),
    Run("CP-Net, 1 step", "cpnet_steps", USUAL | {"steps": 1}),
    Run("CP-Net, 2 steps", "cpnet_steps", USUAL | {"steps": 2}, sets=WEIGHED),
    Run("CP-Net, 1 step, LD-Net", "cpnet_steps", USUAL | {"steps": 1}, "ldnet", DETECTED),
    Run("CP-Net, 1 step, path", "cpnet_steps", USUAL | {"steps": 1}, "path", KNOWN),
    Run("coarse fit, 1 step", "coarse_steps", USUAL, sets=WEIGHED),
    Run("guarded networks", "guarded", USUAL, sets=WEIGHED),
    Run("rotation", "rotation", sets=("fsaverage5", "heldout")),  # whose surfaces have spheres
)


def along_front(beta, gamma, **more):
    """A Gauss-Newton run, hardly smoothed."""
    parameters = {"alpha": 1.0, "beta": float(beta), "gamma": gamma, **more}
    return Run(f"Gauss-Newton (1, {beta}, {gamma:g})", "gauss_newton", parameters, sets=KNOWN)


# For comparisons at the harmonic maps' distortion, some on a mesh as fine as the subject's: a third
# of all runs' time.
FRONT = (
    *(along_front("1e-4", gamma) for gamma in (0.5, 2.0, 8.0)),
    *(along_front("1e-5", gamma, rings=64) for gamma in (0.25, 1.0, 4.0, 16.0, 64.0)),
)


def run_of(text):
    """The Run of a command line's "harmonic" or "harmonic:weight=2,landmarks=path"; BenchmarkError."""
    method, _, given = text.partition(":")
    parameters = {}  # and the landmarks' source
    for pair in filter(None, given.split(",")):
        name, _, value = pair.partition("=")
        try:
            parameters[name.strip()] = json.loads(value)
        except ValueError:
            parameters[name.strip()] = value.strip()
        if not value.strip():
            advice = f"write {method}:NAME=VALUE,NAME=VALUE"
            raise BenchmarkError(f"{text}: {pair!r} is no parameter; {advice}")
    source = parameters.pop("landmarks", "given")
    return Run(text, method, parameters, source)


def check_runs(runs, methods):
    """The runs as a tuple; BenchmarkError for an unknown method, parameter, source or a twin."""
    for run in runs:
        if run.method not in methods:
            message = f"there is no method {run.method!r}; there are {', '.join(methods)}"
            raise BenchmarkError(f"{run.name}: {message}")
        known = list(inspect.signature(methods[run.method]).parameters)[1:]
        unknown = ", ".join(sorted(set(run.parameters) - set(known)))
        if unknown:
            message = f"no parameter {unknown}; it has {', '.join(known) or 'none'}"
            raise BenchmarkError(f"{run.name}: {run.method} has {message}")
        if run.landmarks not in SOURCES or not set(run.sets) <= set(SETS):
            raise BenchmarkError(
                f"{run.name}: no landmarks {run.landmarks!r} or sets {run.sets}; landmarks are "
                f"one of {', '.join(SOURCES)}, sets some of {', '.join(SETS)}"
            )
    names = [run.name for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise BenchmarkError(f"runs named twice: {twice}; give each a name of its own")
    if not names:
        raise BenchmarkError("no runs given")
    return tuple(runs)


def lacking(run):
    """A message where a run's networks cannot be loaded, or None."""
    try:
        networks_of(run.method, run.parameters)
        if run.landmarks in DETECTORS:
            network("ldnet", DETECTORS[run.landmarks])
    except (ImportError, ValueError) as error:
        return str(error)
    return None
