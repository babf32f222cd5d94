"""The benchmark's table of runs: each a method with its parameters and a source of landmarks."""

import inspect
import json
from dataclasses import dataclass, field, replace

from ..io.extras import require
from ..registration.problem import DELTA, Weights
from .measured import BenchmarkError
from .methods.networks import network, networks_of
from .methods.programs import command_words
from .pairs import DETECTORS, SOURCES

SETS = ("cohort", "displacement", "fsaverage5", "heldout", "warp", "conte69")


@dataclass(frozen=True)
class Run:
    """One row's recipe: its name in the tables, the method and its parameters, the landmarks'
    source (`SOURCES`).

    sets: the sets of problems it is run on; keep_field: keep |mu| on the control's disk, for
    pictures over subjects; alone: run it once more in a process of its own, for the CPU seconds and
    the memory of the whole process; uncertainty: where the truth is known, judge the radius that
    `register` gives with the same settings.
    """

    name: str
    method: str
    parameters: dict = field(default_factory=dict)
    landmarks: str = "given"
    sets: tuple = SETS
    keep_field: bool = False
    alone: bool = False
    uncertainty: bool = False


KNOWN = ("cohort",)  # the set with true curves and a true map
DETECTED = (
    *KNOWN,
    "fsaverage5",
)  # sets of real or synthetic cortex, whose curves have ends to detect them from
WEIGHED = (
    *KNOWN,
    "displacement",
    "fsaverage5",
)  # sets on which every weight of a method has its line
HELD_OUT = ("heldout", "conte69")  # sets with curves that take no part
FOLDED = (*DETECTED, *HELD_OUT, "warp")  # all sets on which folds say where to go
COARSE = (*WEIGHED, "heldout", "warp")  # all but conte69 with its 29,000 vertices: for slow methods
USUAL = {
    "alpha": Weights.alpha,
    "beta": Weights.beta,
    "gamma": Weights.gamma,
}  # named where a run differs
HYBRID = USUAL | {"delta": DELTA}
EQUAL = {"alpha": 1.0, "beta": 1.0}
PRINTED = {"preset": "paper"} | EQUAL

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
    # The paper's CP-Net has weights for one control and each gamma.
    Run("paper's networks (1, 1, 1e4)", "cpnet_dbsnet", PRINTED | {"gamma": 1e4}, sets=KNOWN),
    Run(
        "paper's networks (1, 1, 1e5)",
        "cpnet_dbsnet",
        PRINTED | {"gamma": 1e5},
        sets=KNOWN,
        keep_field=True,
    ),
    Run("paper's networks (1, 1, 2e5)", "cpnet_dbsnet", PRINTED | {"gamma": 2e5}, sets=KNOWN),
    Run(
        "paper's networks (1, 1, 1e5), LD-Net",
        "cpnet_dbsnet",
        PRINTED | {"gamma": 1e5},
        "ldnet_paper",
        KNOWN,
    ),
    Run(
        "paper's networks (1, 1, 1e5), path",
        "cpnet_dbsnet",
        PRINTED | {"gamma": 1e5},
        "path",
        KNOWN,
    ),
    Run("CP-Net and DBS-Net", "cpnet_dbsnet", USUAL, sets=WEIGHED, keep_field=True),
    Run("CP-Net and DBS-Net, LD-Net", "cpnet_dbsnet", USUAL, "ldnet", DETECTED),
    Run("CP-Net, exact solver", "cpnet_exact", USUAL, sets=WEIGHED),
    Run("CP-Net, 1 step", "cpnet_steps", USUAL | {"steps": 1}),
    Run("CP-Net, 2 steps", "cpnet_steps", USUAL | {"steps": 2}, sets=WEIGHED),
    Run("CP-Net, 1 step, LD-Net", "cpnet_steps", USUAL | {"steps": 1}, "ldnet", DETECTED),
    Run("CP-Net, 1 step, path", "cpnet_steps", USUAL | {"steps": 1}, "path", KNOWN),
    Run("coarse fit, 1 step", "coarse_steps", USUAL, sets=WEIGHED),
    Run("guarded networks", "guarded", USUAL, sets=WEIGHED),
)


def along_front(beta, gamma, **more):
    """A Gauss-Newton run, hardly smoothed."""
    parameters = {"alpha": 1.0, "beta": float(beta), "gamma": gamma, **more}
    return Run(f"Gauss-Newton (1, {beta}, {gamma:g})", "gauss_newton", parameters, sets=KNOWN)


# Competitors, which are no maps of the disk.
PEERS = (
    Run("rotation", "rotation", sets=FOLDED, alone=True),
    Run("Spherical Demons", "spherical_demons", sets=FOLDED),
)
BESIDE = (
    "Möbius",
    "Gauss-Newton",
    "hybrid",
    "landmark-free",
)  # of ours, whose whole processes stand beside theirs


# For comparisons at the harmonic maps' distortion, some on a mesh like the subject's: a third of
# all runs' time.
FRONT = (
    *(along_front("1e-4", gamma) for gamma in (0.5, 2.0, 8.0)),
    *(along_front("1e-5", gamma, rings=64) for gamma in (0.25, 1.0, 4.0, 16.0, 64.0)),
)


def table_of(peers, fronts):
    """The runs of the table: ours, with FRONT if `fronts`, and with `peers` PEERS beside them;
    "only": those and what stands BESIDE them."""
    own = RUNS + FRONT * fronts
    if peers:
        own = tuple(
            replace(run, alone=run.name in BESIDE)
            for run in own
            if peers != "only" or run.name in BESIDE
        )
    return own + PEERS * bool(peers)


def program_of(text, limit):
    """The Run of a command line's "NAME=COMMAND", a method that is a program; BenchmarkError."""
    name, _, command = text.partition("=")
    try:
        command_words(command)
    except ValueError as error:
        raise BenchmarkError(f"--program {text!r}: {error}") from None
    if not name.strip() or not limit > 0:
        raise BenchmarkError(
            f"--program {text!r}, --limit {limit}: write NAME=COMMAND, and seconds above 0"
        )
    return Run(name.strip(), "program", {"command": command, "limit": limit}, sets=FOLDED)


def run_of(text):
    """The Run of a command line's "harmonic" or "harmonic:weight=2,landmarks=path"; BenchmarkError."""
    method, _, given = text.partition(":")
    parameters = {}  # and the landmarks' source
    for pair in filter(None, given.split(",")):
        name, equals, value = pair.partition("=")
        try:
            parameters[name.strip()] = json.loads(value)
        except ValueError:
            parameters[name.strip()] = value.strip()
        if not equals:
            raise BenchmarkError(
                f"{text}: {pair!r} is no parameter; write {method}:NAME=VALUE,NAME=VALUE"
            )
    source = parameters.pop("landmarks", "given")
    return Run(text, method, parameters, source)


def check_runs(runs, methods):
    """The runs as a tuple, or BenchmarkError for an unknown method, parameter or source, or a name
    used twice."""
    for run in runs:
        if run.method not in methods:
            raise BenchmarkError(
                f"{run.name}: there is no method {run.method!r}; there are {', '.join(methods)}"
            )
        known = list(inspect.signature(methods[run.method]).parameters)[1:]
        unknown = sorted(set(run.parameters) - set(known))
        if unknown:
            raise BenchmarkError(
                f"{run.name}: {run.method} has no parameter {', '.join(unknown)}; it has "
                f"{', '.join(known) or 'none'}"
            )
        if run.landmarks not in SOURCES or not set(run.sets) <= set(SETS):
            raise BenchmarkError(
                f"{run.name}: no landmarks {run.landmarks!r} or sets {run.sets}; landmarks are "
                "one of "
                f"{', '.join(SOURCES)}, sets some of {', '.join(SETS)}"
            )
    names = [run.name for run in runs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice or not names:
        raise BenchmarkError(
            f"runs named twice: {twice}; give each a name of its own" if twice else "no runs given"
        )
    return tuple(runs)


def lacking(run):
    """Why a run's networks cannot be loaded, or its extra is missing, as a message, or None."""
    try:
        if run.method == "spherical_demons":
            require("peers", "Spherical Demons")
        networks_of(run.method, run.parameters)
        if run.landmarks in DETECTORS:
            network("ldnet", DETECTORS[run.landmarks])
    except (ImportError, ValueError) as error:
        return str(error)
    return None
