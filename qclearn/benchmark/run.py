"""The benchmark: every run on every problem, as tasks on one machine or many, saved one by one.

    from qclearn.benchmark import benchmark, Run
    results = benchmark("small.json", subjects=3)

A method of one's own joins by `benchmark(..., methods=METHODS | {"mine": mine}, runs=(*RUNS,
Run("mine", "mine")))`.
"""

import time
from contextlib import nullcontext
from dataclasses import asdict
from datetime import date
from hashlib import sha256
from pathlib import Path

from tqdm import tqdm

from data_synth.cohort import GENERATION, hemispheres
from data_synth.cortex import FEWEST, MOST

from ..io.extras import require
from ..io.provenance import commit, processor
from ..moved import gone
from .cluster import connect, finished, versions
from .cortex import person
from .measured import BenchmarkError
from .methods import METHODS
from .pairs import CONTROL
from .problems import problems
from .rows import Journal
from .runs import FRONT, RUNS, check_runs, lacking

LIMIT = 3600.0  # seconds for a row of a method that is not ours


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
    limit=LIMIT,
    peers=None,
    programs=None,
):
    """Run all `runs` on all problems of `sets`, write the results file `out`, return its contents.

    subjects: number, of the cohort's 24; runs: by default RUNS, with `fronts` FRONT, too, without
    those whose networks have no weights here; scheduler: address of a dask scheduler (one thread a
    worker), None for `workers` processes here; folder: for synthetic subjects (on each worker's
    machine); limit: seconds for a row of a method that is not one of METHODS. Called again, a
    stopped run goes on from the finished tasks. Errors: BenchmarkError, also for the arguments
    `peers` and `programs` of version 0.2; ImportError without the extra.
    """
    for name, value in {"peers": peers, "programs": programs}.items():
        if value is not None:
            raise BenchmarkError(gone(f"benchmark({name}=)"))
    require("benchmark", "benchmarks")
    out, left_out = Path(out), {}
    if runs is None:
        table = RUNS + FRONT * fronts
        left_out = {run.name: reason for run in table if (reason := lacking(run))}
        runs = [run for run in table if run.name not in left_out]
    runs, specs = check_runs(runs, methods), problems(subjects, sets)
    if not (FEWEST <= vertices <= MOST and workers >= 1 and limit > 0):
        wanted = f"{FEWEST:,} to {MOST:,} vertices, at least one worker, and a limit above 0"
        given = f"{vertices} vertices, {workers} workers, a limit of {limit} s"
        raise BenchmarkError(f"{given}: give {wanted}")
    origin = {"commit": commit(), "date": date.today().isoformat(), "versions": versions()}
    origin["threads_per_task"] = 1
    seeds = {seed for spec in specs for seed in spec.seeds}
    settings = {
        "sets": [name.partition(":")[0] for name in sets],
        "subjects": subjects,
        "seeds": sorted(seeds - {CONTROL}),
        "controls": sorted(seeds & {CONTROL}),
        "vertices": vertices,
        "generation": GENERATION,
        "commit": origin["commit"],
        "runs": [asdict(run) for run in runs],
    }
    if known := people_files(specs):
        settings["people"] = known
    if not out.absolute().parent.is_dir() or out.is_dir():
        raise BenchmarkError(f"{out}: not a file in a folder that exists; give another --out")
    folder = None if folder is None else str(Path(folder).absolute())
    if scheduler is None and settings["controls"]:
        hemispheres([], vertices, folder)  # refuses an unwritable folder now, not in each task
    journal, start = Journal(out, settings), time.perf_counter()
    finished_rows = [row for row in journal.rows if row["status"] == "done"]
    done = {(row["set"], row["pair"], row["run"]) for row in finished_rows}
    wanted = [(spec, run) for spec in specs for run in runs if spec.set in run.sets]
    tasks = [(spec, run) for spec, run in wanted if (spec.set, spec.pair, run.name) not in done]
    counts = {"total": len(wanted), "initial": len(done)}
    with connect(scheduler, workers) if tasks else nullcontext() as client:
        machines = {"workers": 1, "processors": [processor()]}
        if tasks:
            processors = sorted(set(client.run(processor).values()))
            machines = {"workers": len(client.nthreads()), "processors": processors}
        with tqdm(desc="benchmark", disable=not progress or None, **counts) as bar:
            grown = vertices, folder, GENERATION
            for row in finished(client, tasks, methods, grown, limit) if tasks else ():
                journal.append(row)
                bar.set_postfix_str(f"{row['pair']}, {row['run']}", refresh=False)
                bar.update()
    seconds = round(time.perf_counter() - start, 1)
    costs = {"seconds": seconds, "resumed": bool(done), "left_out": left_out}
    return journal.finish(origin | machines | costs)


def people_files(specs):
    """The sha256 of each person's file that the Specs read, dict by name: a folder's rows are of
    these files alone."""
    paths = {given[0] for spec in specs for read, *given in spec.sides if read is person}
    return {Path(path).stem: sha256(Path(path).read_bytes()).hexdigest() for path in sorted(paths)}
