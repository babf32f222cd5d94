"""A program in a process of its own, with a time limit; what it costs, and what it says when it fails."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

LAUNCH = sys.executable, "-I", "-S", str(Path(__file__).with_name("launch.py"))
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "ITK_GLOBAL_DEFAULT_NUMBER_OF_THREADS"), "1"
)
MOST_WORDS = 300  # of what a program that failed said last


class ProgramError(ValueError):
    """A program that cannot be started, fails, takes too long or writes no answer; the message names it."""


class Costs(NamedTuple):
    """What a whole process took: CPU seconds, user's and system's, of all its processes; peak memory, MB; seconds."""

    cpu_seconds: float
    memory_mb: float
    seconds: float


def measured(command, limit, out=None):
    """Run a command (list of words) for at most `limit` seconds, in one thread: its `Costs`.

    ProgramError where it cannot be started, ends with an error or by a signal, is not done by then, or has not written
    the file `out`. POSIX alone (os.wait4).
    """
    name = Path(command[0]).name
    with TemporaryDirectory() as folder:
        report, words = Path(folder, "report.json"), Path(folder, "words.txt")
        with words.open("wb") as file:
            launcher, start = [*LAUNCH, str(report), str(limit), *command], time.perf_counter()
            subprocess.run(launcher, stdout=file, stderr=subprocess.STDOUT, env=os.environ | ONE_THREAD, check=False)
            seconds = time.perf_counter() - start
        said = words.read_bytes()[-10_000:].decode(errors="replace").strip().splitlines()
        found = json.loads(report.read_text()) if report.exists() else {"missing": "; ".join(said[-1:])}
    if "missing" in found:
        raise ProgramError(f"{name} cannot be started ({found['missing']}); check the command")
    if found["late"]:
        raise ProgramError(f"{name} was not done after {limit:g} s and was stopped; give it more time with the limit")
    if found["status"]:
        code = found["status"]
        how = f"with the status {code}" if code > 0 else f"by the signal {signal.Signals(-code).name}"
        raise ProgramError(f"{name} ended {how}; its last words: {(said or ['none'])[-1][-MOST_WORDS:]}")
    if out is not None and not Path(out).exists():
        raise ProgramError(f"{name} ended without an error and wrote no sphere to {{out}}")
    return Costs(found["cpu_seconds"], found["memory_mb"], seconds)
