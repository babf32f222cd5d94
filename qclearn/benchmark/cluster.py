"""Where the benchmark's rows are computed: on processes of this machine or on a dask scheduler."""

import gc
from contextlib import ExitStack, contextmanager
from tempfile import TemporaryDirectory

from ..interrupts import signals_wait
from ..io.provenance import versions as versions_of
from .isolated import isolated_trial
from .measured import BenchmarkError
from .methods import METHODS
from .pairs import mapped_subject
from .trial import failed, trial

PATIENCE = 20  # seconds for a scheduler to answer and to have a worker
LOCAL = {"threads_per_worker": 1, "host": "127.0.0.1", "silence_logs": 50}
LOCAL |= {"dashboard_address": "127.0.0.1:0"}


@contextmanager
def connect(scheduler, workers):
    """A dask client of the scheduler, or of `workers` processes of this machine; BenchmarkError."""
    with signals_wait():
        import dask
        from distributed import Client, LocalCluster

    # A failed client that is collected while the next one is made would wait for its lock forever.
    gc.collect()
    if scheduler is None:
        # Else workers hand memory back at once, and methods wait for pages: a third of their time.
        unset = {"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}
        with ExitStack() as stack:
            folder = stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
            stack.enter_context(dask.config.set(unset | {"temporary-directory": folder}))
            with signals_wait():  # a cluster that has half begun would leave its processes
                cluster = stack.enter_context(LocalCluster(n_workers=workers, **LOCAL))
            yield stack.enter_context(Client(cluster))
        return
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:  # TypeError: an address without a port
        advice = "start `dask scheduler`, give its tcp://HOST:8786"
        message = f"{scheduler}: no dask scheduler answers there ({error}); {advice}"
        raise BenchmarkError(message) from None
    with client:
        check_workers(client, scheduler)
        yield client


def check_workers(client, scheduler):
    """BenchmarkError unless there are workers, each with one thread and this version of qclearn."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        advice = f"start some: `dask worker {scheduler} --nthreads 1`"
        raise BenchmarkError(f"{scheduler} has no workers; {advice}") from None
    many = sorted(address for address, threads in client.nthreads().items() if threads != 1)
    if names := ", ".join(many[:5]):
        raise BenchmarkError(f"workers {names} have several threads: start them with --nthreads 1")
    own = versions()
    differ = [
        f"{address} has {name} {theirs.get(name, 'none')}, here {own.get(name, 'none')}"
        for address, theirs in sorted(client.run(versions).items())
        for name in own | theirs
        if theirs.get(name) != own.get(name)
    ]
    if names := "; ".join(differ[:5]):
        raise BenchmarkError(f"workers have other versions ({names}): install the same on all")


def versions():
    return versions_of("qclearn", "numpy", "scipy", "distributed", "torch")


def finished(client, tasks, methods, grown, limit):
    """Rows of (Spec, Run) tasks as they finish; a lost task or problem gives one with a message.

    grown: (vertices, folder, generation) of subjects, as workers may have other defaults; limit:
    seconds for a row of a method that is not one of METHODS, in a process of its own.
    """
    import cloudpickle
    from distributed import as_completed

    futures, pairs, more = {}, {}, {mapped_subject: grown}
    for spec, run in tasks:
        if spec not in pairs:  # its sides are futures that pairs share
            sides = [client.submit(*one, *more.get(one[0], ())) for one in spec.sides]
            pairs[spec] = client.submit(spec.make, *sides, *spec.options)
        method = methods[run.method]
        if method is METHODS.get(run.method):
            future = client.submit(trial, pairs[spec], run, method, pure=False)
        else:
            try:
                sent = isolated_trial, pairs[spec], run, cloudpickle.dumps(method), limit
            except Exception as error:  # it holds a lock or an open file
                sent = failed, f"the method cannot be sent to a process of its own: {error}"
            future = client.submit(*sent, pure=False)
        futures[future] = spec, run
    pairs.clear()  # from here on a problem stays on the workers as long as its tasks need it
    for future in as_completed(list(futures)):
        spec, run = futures.pop(future)
        if future.status == "cancelled":
            lost = "the scheduler was lost; what was finished is kept: run it again to go on"
            raise BenchmarkError(lost)
        row = {"set": spec.set, "pair": spec.pair, "run": run.name, "method": run.method}
        row |= {"parameters": run.parameters, "landmarks": run.landmarks}
        yield row | (failed(future.exception()) if future.status == "error" else future.result())
