"""A row in a process of its own: whatever its method does, it touches no other row."""

import os
import pickle
import shutil
import signal
import sys
from contextlib import suppress
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, TimeoutExpired
from tempfile import TemporaryDirectory
from threading import Thread

from .trial import failed, trial


def isolated_trial(pair, run, method, limit):
    """The row of `trial`, or a failed one after `limit` seconds; method: bytes by cloudpickle."""
    with TemporaryDirectory() as folder:
        Path(folder, "task").write_bytes(pickle.dumps((pair, run, method, limit)))
        command = [sys.executable, "-c", f"import {__name__} as own; own.run_task({folder!r})"]
        paths = {"PYTHONPATH": os.pathsep.join(sys.path)}  # where a method's module lies
        options = {"env": os.environ | paths, "start_new_session": True}
        options |= {"stdin": PIPE, "stdout": DEVNULL, "stderr": DEVNULL}
        with Popen(command, **options) as process:
            with suppress(TimeoutExpired):
                process.wait(limit)
            status = process.poll()
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)  # with all that it has started
        if (row := Path(folder, "row")).exists():
            return pickle.loads(row.read_bytes())
    if status is None:
        return failed(f"not done after {limit:g} s and was stopped: give it more time by the limit")
    name = signal.Signals(-status).name if status < 0 else f"status {status}"
    return failed(f"its process ended with {name} and gave no map")


def run_task(folder):
    """What the process does; sys.exit and a method that cannot be loaded end here."""
    pair, run, method, limit = pickle.loads(Path(folder, "task").read_bytes())
    # The pipe from whoever started this process ends with it, and so does all that is here; at the
    # latest, where a method keeps Python's lock, after the limit.
    pipe = os.dup(0)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    Thread(target=end_after, args=(pipe, folder), daemon=True).start()
    signal.alarm(int(min(limit, 1e9)) + 5)
    try:
        row = trial(pair, run, pickle.loads(method))
    except BaseException as error:
        row = failed(error)
    here = Path(folder, f"row of {os.getpid()}")  # a method may have forked
    here.write_bytes(pickle.dumps(row))
    os.replace(here, Path(folder, "row"))
    os._exit(0)  # threads of a method do not hold the row up


def end_after(pipe, folder):
    """End this process, its folder and all that it has started, once its pipe is closed."""
    os.read(pipe, 1)
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)
