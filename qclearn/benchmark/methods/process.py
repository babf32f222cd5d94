"""A program in a process of its own, with a time limit, and what it costs."""

import os
import time
from contextlib import suppress
from pathlib import Path
from signal import SIGKILL, Signals
from subprocess import DEVNULL, STDOUT
from tempfile import TemporaryFile
from typing import NamedTuple

from ...io.extras import require

PACKAGES = "OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "ITK_GLOBAL_DEFAULT_NUMBER_OF"
ONE_THREAD = {f"{package}_THREADS": "1" for package in PACKAGES}
PAUSE = 0.02  # seconds between two readings of a program's memory


class ProgramError(ValueError):
    """A program that cannot be started, fails, takes too long or writes no answer."""


class Costs(NamedTuple):
    """What a program took.

    CPU seconds, user's and system's, with its children's; peak memory in MB of the largest of its
    processes, read every PAUSE (0 of a program that ends before); seconds.
    """

    cpu_seconds: float
    memory_mb: float
    seconds: float


def measured(command, limit, out=None):
    """Run a command (list) in one thread for at most `limit` seconds: its `Costs`.

    ProgramError where it cannot be started, fails, is not done by then, or has not written the
    file `out`. What it leaves running is killed. POSIX alone.
    """
    with require("benchmark", "measured programs"):
        import psutil
    name, start = Path(command[0]).name, time.monotonic()
    children, search, peak = [], 0.0, 0
    with TemporaryFile() as log:
        group = {"env": os.environ | ONE_THREAD, "start_new_session": True}
        try:
            process = psutil.Popen(command, stdin=DEVNULL, stdout=log, stderr=STDOUT, **group)
        except OSError as error:
            reason = f"{error.strerror}: {command[0]}"
            raise ProgramError(f"{name} cannot be started ({reason}); check the command") from None
        try:
            while process.status() != psutil.STATUS_ZOMBIE and time.monotonic() < start + limit:
                for member in [process, *children]:
                    with suppress(psutil.Error):
                        peak = max(peak, member.memory_info().rss)
                time.sleep(PAUSE)
                now = time.monotonic()
                if now > search:  # reads all the machine's processes: a tenth of the time at most
                    children = process.children(recursive=True)
                    search = now + 10 * (time.monotonic() - now)
            late = process.status() != psutil.STATUS_ZOMBIE
            cpu_seconds = sum(process.cpu_times()[:4])  # user's and system's, own and children's
            costs = Costs(cpu_seconds, peak / 2**20, time.monotonic() - start)
        finally:
            with suppress(OSError):
                os.killpg(process.pid, SIGKILL)
            status = process.wait()
        log.seek(0)
        lines = log.read()[-10_000:].decode(errors="replace").strip().splitlines() or ["none"]
    how = f"with the status {status}" if status >= 0 else f"by the signal {Signals(-status).name}"
    if late:
        advice = "give it more time with the limit"
        raise ProgramError(f"{name} was not done after {limit:g} s and was stopped; {advice}")
    if status:
        raise ProgramError(f"{name} ended {how}; its last words: {lines[-1][-300:]}")
    if out is not None and not Path(out).exists():
        raise ProgramError(f"{name} ended without an error and wrote no sphere to {{out}}")
    return costs
