"""Runs a program with a time limit and writes what it cost: REPORT LIMIT COMMAND ... -> REPORT, JSON.

`python -I -S launch.py`, a process between the library and the program: Linux counts what a parent holds as the peak of
the child that it starts, and this one holds next to nothing. The program does not outlive who asked for it.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time

report, limit, *command = sys.argv[1:]
asker, end = os.getppid(), time.monotonic() + float(limit)
ended, late = threading.Event(), threading.Event()


def stop():
    with contextlib.suppress(OSError):
        os.killpg(process.pid, signal.SIGKILL)


def watch():
    while not ended.wait(0.1):
        if time.monotonic() > end or os.getppid() != asker:
            late.set()
            stop()


try:
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
except OSError as error:
    found = {"missing": f"{error.strerror}: {command[0]}"}
else:
    threading.Thread(target=watch, daemon=True).start()
    _, status, used = os.wait4(process.pid, 0)  # of the program and of all that it waited for
    ended.set()
    stop()  # what it left running
    found = {
        "status": os.waitstatus_to_exitcode(status),
        "late": late.is_set(),
        "cpu_seconds": used.ru_utime + used.ru_stime,
        "memory_mb": used.ru_maxrss / (1024**2 if sys.platform == "darwin" else 1024),
    }
with open(report, "w") as file:
    json.dump(found, file)
