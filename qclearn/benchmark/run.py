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
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from tqdm import tqdm

from data_synth.cohort import GENERATION, hemispheres
from data_synth.cortex import FEWEST, MOST

from ..group.workers import connect, versions
from ..io.extras import require
from ..io.provenance import commit, processor
from .cortex import person
from .measured import BenchmarkError
from .methods import METHODS
from .pairs import CONTROL
from .problems import problems, submit_pair
from .rows import Journal
from .runs import check_runs, lacking, table_of
from .trial import trial


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
    peers=True,
    programs=(),
):
    """Run all `runs` on all problems of `sets`, write the results file `out`, return its contents.

    subjects: number, of the cohort's 24; runs: by default the table of `table_of(peers, fronts)`,
    without those whose networks have no weights here or whose extra is missing; programs: more
    runs, beside either; scheduler: address of a dask scheduler (one thread a worker), None for
    `workers` processes here; folder: for synthetic subjects (on each worker's machine). Called
    again, a stopped run goes on from the finished tasks. Errors: BenchmarkError, WorkersError;
    ImportError without the extra.
    """
    require("benchmark", "benchmarks")
    out, left_out = Path(out), {}
    if runs is None:
        table = table_of(peers, fronts)
        left_out = {run.name: reason for run in table if (reason := lacking(run))}
        runs = [run for run in table if run.name not in left_out]
    runs, specs = check_runs((*runs, *programs), methods), problems(subjects, sets)
    if not FEWEST <= vertices <= MOST or workers < 1:
        wanted = f"{FEWEST:,} to {MOST:,} vertices and at least one worker"
        raise BenchmarkError(f"{vertices} vertices, {workers} workers: give {wanted}")
    known = versions() | ({"cat-surf": version("cat-surf")} if find_spec("cat_surf") else {})
    origin = {"commit": commit(), "date": date.today().isoformat(), "versions": known}
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
        machines = machine(client) if tasks else {"workers": 1, "processors": [processor()]}
        with tqdm(desc="benchmark", disable=not progress, **counts) as bar:
            for row in finished(client, tasks, methods, (vertices, folder, GENERATION)):
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


def finished(client, tasks, methods, grown):
    """Rows as their tasks finish; a failed task, worker or problem gives a row with a message."""
    if not tasks:
        return
    from distributed import as_completed

    futures, pairs = {}, {}
    for spec, run in tasks:
        if spec not in pairs:
            pairs[spec] = submit_pair(client, spec, grown)
        future = client.submit(trial, pairs[spec], run, methods[run.method], pure=False)
        futures[future] = spec, run
    pairs.clear()  # from here on a problem stays on the workers as long as its tasks need it
    for future in as_completed(list(futures)):
        spec, run = futures.pop(future)
        if future.status == "cancelled":
            raise BenchmarkError(
                "the scheduler was lost; what was finished is kept: run it again to go on"
            )
        error = future.exception() if future.status == "error" else None
        row = {"set": spec.set, "pair": spec.pair, "run": run.name, "method": run.method}
        row |= {"parameters": run.parameters, "landmarks": run.landmarks}
        if error:
            yield row | {"status": "failed", "message": f"{type(error).__name__}: {error}"}
        else:
            yield row | future.result()


def machine(client):
    processors = sorted(set(client.run(processor).values()))
    return {"workers": len(client.nthreads()), "processors": processors}
