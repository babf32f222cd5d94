"""The benchmark: every run on every problem, as tasks on one machine or many, kept as they finish and resumed if
killed.

    from qclearn.benchmark import benchmark, Run
    results = benchmark("small.json", subjects=3)

A run is a method with its parameters and a source of landmarks. A method of one's own joins by
`benchmark(..., methods=METHODS | {"mine": mine}, runs=(*RUNS, Run("mine", "mine")))`.
"""

import time
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path

from tqdm import tqdm

from data_synth.cohort import GENERATION, SEEDS, hemispheres
from data_synth.cortex import FEWEST, MOST

from ..files.extras import require
from ..files.provenance import commit, processor
from ..group.workers import connect, versions
from ..methods import METHODS
from .pairs import CONTROL, cohort_pair, displacement_pair, fsaverage_pair, mapped_subject
from .results import BenchmarkError, Journal
from .runs import FRONT, RUNS, SETS, check_runs, lacking
from .trial import trial

DISTANCES, CURVE_COUNTS = (0.05, 0.1, 0.2, 0.3, 0.4), (4, 8)


@dataclass(frozen=True)
class Spec:
    """One problem by name: the set, the pair's name and what it is made from."""

    set: str
    pair: str
    moving: int | None = None
    control: int | None = None
    distance: float = 0.0
    curves: int = 0


def benchmark(
    out,
    subjects=24,
    vertices=10_000,
    sets=("cohort",),
    runs=None,
    methods=METHODS,
    scheduler=None,
    workers=2,
    folder=None,
    progress=True,
    fronts=False,
    generation=GENERATION,
):
    """Run all `runs` on all problems of `sets` and write the results file `out`: its contents.

    subjects: how many of the cohort's 24; runs: by default RUNS, with FRONT if `fronts`, without those whose networks
    have no weights here.
    scheduler: address of a dask scheduler (its workers with one thread each), None for `workers` processes on this
    machine; folder: where synthetic subjects, of `generation`, are kept (on each worker's machine). Finished tasks are
    kept beside `out` at once; called again, a run that was stopped goes on. Errors: BenchmarkError, WorkersError,
    CortexError for a bad generation; ImportError without the extra.
    """
    require("benchmark", "benchmarks")
    out, left_out = Path(out), {}
    if runs is None:
        table = RUNS + FRONT * fronts
        left_out = {run.name: reason for run in table if (reason := lacking(run))}
        runs = [run for run in table if run.name not in left_out]
    runs, specs = check_runs(runs, methods), problems(subjects, sets)
    if not FEWEST <= vertices <= MOST or workers < 1:
        raise BenchmarkError(
            f"{vertices} vertices, {workers} workers: give {FEWEST:,} to {MOST:,} vertices and at least one worker"
        )
    origin = provenance()
    settings = {
        "sets": list(sets),
        "subjects": subjects,
        "seeds": sorted({spec.moving for spec in specs if spec.moving}),
        "controls": sorted({spec.control for spec in specs if spec.control}),
        "vertices": vertices,
        "generation": generation,
        "commit": origin["commit"],
        "runs": [asdict(run) for run in runs],
    }
    if not out.absolute().parent.is_dir() or out.is_dir():
        raise BenchmarkError(f"{out}: not a file in a folder that exists; give another --out")
    folder = None if folder is None else str(Path(folder).absolute())
    if scheduler is None and settings["controls"]:
        # An unwritable folder is refused now, not in each task.
        hemispheres([], vertices, folder, generation=generation)
    journal, start = Journal(out, settings), time.perf_counter()
    done = {(row["set"], row["pair"], row["run"]) for row in journal.rows if row["status"] == "done"}
    wanted = [(spec, run) for spec in specs for run in runs if spec.set in run.sets]
    tasks = [(spec, run) for spec, run in wanted if (spec.set, spec.pair, run.name) not in done]
    with connect(scheduler, workers) if tasks else nullcontext() as client:
        machines = machine(client) if tasks else {"workers": 1, "processors": [processor()]}
        with tqdm(total=len(wanted), initial=len(done), desc="benchmark", disable=not progress) as bar:
            for row in finished(client, tasks, methods, (vertices, folder, generation)):
                journal.append(row)
                bar.set_postfix_str(f"{row['pair']}, {row['run']}", refresh=False)
                bar.update()
    return journal.finish(
        origin
        | machines
        | {"seconds": round(time.perf_counter() - start, 1), "resumed": bool(done), "left_out": left_out}
    )


def problems(subjects, sets):
    """The problems of the sets, list of Spec; BenchmarkError for an unknown set or a bad count of subjects."""
    unknown = sorted(set(sets) - set(SETS))
    if unknown or not sets:
        raise BenchmarkError(f"no set of problems {', '.join(unknown) or 'given'}; there are {', '.join(SETS)}")
    least = 2 if "pairs" in sets else 1
    if not isinstance(subjects, int) or not least <= subjects <= len(SEEDS):
        raise BenchmarkError(f"{subjects!r} subjects: the cohort has 1 to {len(SEEDS)}, and pairs need at least 2")
    seeds, specs = SEEDS[:subjects], []
    if "cohort" in sets:
        specs += [Spec("cohort", f"{seed} to {CONTROL}", seed, CONTROL) for seed in seeds]
    if "pairs" in sets:
        specs += [Spec("pairs", f"{a} to {b}", a, b) for b in seeds for a in seeds if a != b]
    if "displacement" in sets:
        specs += [
            Spec("displacement", f"{distance:g}, {curves} curves", None, CONTROL, distance, curves)
            for curves in CURVE_COUNTS
            for distance in DISTANCES
        ]
    if "fsaverage5" in sets:
        specs.append(Spec("fsaverage5", "right to left"))
    return specs


def submit_pair(client, spec, grown):
    """The future of a problem's Pair. Subjects are futures with keys of their own, so that pairs share them."""
    if spec.set == "fsaverage5":
        return client.submit(fsaverage_pair)
    # The generation goes along: the workers' own default may be another.
    control = client.submit(mapped_subject, spec.control, *grown)
    if spec.set == "displacement":
        return client.submit(displacement_pair, control, spec.distance, spec.curves, 0)
    moving = client.submit(mapped_subject, spec.moving, *grown)
    return client.submit(cohort_pair, moving, control)


def finished(client, tasks, methods, grown):
    """Rows as their tasks finish. A task that fails, with its worker or its problem, gives a row that says so."""
    if not tasks:
        return
    from distributed import as_completed

    futures, pairs = {}, {}
    for spec, run in tasks:
        if spec not in pairs:
            pairs[spec] = submit_pair(client, spec, grown)
        future = client.submit(trial, pairs[spec], run, methods[run.method], pure=False)
        futures[future] = spec, run
    pairs.clear()  # from here on a problem is kept on the workers as long as its tasks need it
    for future in as_completed(list(futures)):
        spec, run = futures.pop(future)
        if future.status == "cancelled":
            raise BenchmarkError("the scheduler was lost; what was finished is kept: run it again to go on")
        error = future.exception() if future.status == "error" else None
        row = {"status": "failed", "message": f"{type(error).__name__}: {error}"} if error else future.result()
        yield {
            "set": spec.set,
            "pair": spec.pair,
            "run": run.name,
            "method": run.method,
            "parameters": run.parameters,
            "landmarks": run.landmarks,
            **row,
        }


def machine(client):
    return {"workers": len(client.nthreads()), "processors": sorted(set(client.run(processor).values()))}


def provenance():
    return {"commit": commit(), "date": date.today().isoformat(), "versions": versions(), "threads_per_task": 1}
