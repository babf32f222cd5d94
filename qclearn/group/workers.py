"""Where tasks run: in this process, in processes of this machine, or on a dask scheduler."""

import gc
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass

from ..io.extras import require
from ..io.provenance import versions as versions_of

PATIENCE = 20  # seconds for a scheduler to answer and to have a worker
LOCAL = {
    "threads_per_worker": 1,
    "host": "127.0.0.1",
    "dashboard_address": "127.0.0.1:0",
    "silence_logs": 50,
}


class WorkersError(ValueError):
    """A scheduler or workers that cannot be used: says which and what to do."""


@dataclass(frozen=True)
class Done:
    """A finished task, in place of dask's future."""

    value: object

    def result(self):
        return self.value


class Here:
    """In place of a dask client: each task runs in this process when it is submitted."""

    def submit(self, function, *arguments, **_):
        values = [given.value if isinstance(given, Done) else given for given in arguments]
        return Done(function(*values))

    def scatter(self, value, **_):
        return Done(value)


def client_of(scheduler, workers):
    """`connect`; one worker without a scheduler is this process and needs no dask."""
    if scheduler is None and workers == 1:
        return nullcontext(Here())
    require("benchmark", "several workers")
    return connect(scheduler, workers)


@contextmanager
def connect(scheduler, workers):
    """A dask client of the scheduler, or of `workers` processes of this machine; WorkersError."""
    import dask
    from distributed import Client, LocalCluster

    # A failed client that is collected while the next one is made would wait for its lock forever.
    gc.collect()
    if scheduler is None:
        # dask has its workers hand memory back at once, and methods then wait for pages: up to a
        # third of their time.
        with (
            dask.config.set({"distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None}),
            LocalCluster(n_workers=workers, **LOCAL) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError, TypeError) as error:  # TypeError: an address without a port
        raise WorkersError(
            f"{scheduler}: no dask scheduler answers there ({error}); start `dask scheduler`, "
            "give its tcp://HOST:8786"
        ) from None
    with client:
        check_workers(client, scheduler)
        yield client


def check_workers(client, scheduler):
    """WorkersError unless there are workers, each with one thread and this version of qclearn."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        advice = f"start some: `dask worker {scheduler} --nthreads 1`"
        raise WorkersError(f"{scheduler} has no workers; {advice}") from None
    many = sorted(address for address, threads in client.nthreads().items() if threads != 1)
    if many:
        names = ", ".join(many[:5])
        raise WorkersError(f"workers {names} have several threads: start them with --nthreads 1")
    own = versions()
    differ = [
        f"{address} has {name} {theirs.get(name, 'none')}, here {own.get(name, 'none')}"
        for address, theirs in sorted(client.run(versions).items())
        for name in own | theirs
        if theirs.get(name) != own.get(name)
    ]
    if differ:
        names = "; ".join(differ[:5])
        raise WorkersError(f"workers have other versions ({names}): install the same on all")


def versions():
    return versions_of("qclearn", "numpy", "scipy", "distributed", "torch")


def result_of(future, name):
    """A task's result; its ValueError with the subject's name; WorkersError for a lost worker."""
    try:
        return future.result()
    except ValueError as error:
        raise type(error)(f"{name}: {error}") from None
    except Exception as error:
        if not type(error).__module__.startswith(("distributed", "concurrent")):
            raise
        raise WorkersError(
            f"{name}: lost with its worker ({type(error).__name__}); run it again: it goes on "
            "with what its folder has"
        ) from None
