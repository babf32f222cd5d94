"""Grade a folder of notebooks: each runs in a process of its own, and its answers are checked on inputs of another seed
than that of the students' own checks.

This runs the students' code with the rights of whoever grades. A process has limits of time and memory, an empty folder
as its home, no variable of the environment that it does not need and, where the system allows that, no network and no
process that outlives it. It may still read and write whatever the user may: code that is not trusted is graded in a
container. A student who wants to deceive the check, which runs beside his code, can.
"""

import json
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from tqdm import tqdm

from .exercise import EXERCISES
from .handedin import clean, read

_ALONE = ["unshare", "--user", "--map-current-user", "--net", "--pid", "--fork", "--kill-child"]
_PASSED_ON = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH")
_WHOLE = 10  # so many times the limit of a cell is that of the notebook
_LINE = 10_000  # characters that are read of a line at once, from a process that may write anything


class GradingError(ValueError):
    """A folder that cannot be graded; the message says which, why, and what to do."""


@dataclass(frozen=True)
class Limits:
    """What a notebook may take: seconds for a cell or a check, ten times that in all, and GB of memory."""

    seconds: float = 30
    gb: float = 4


@dataclass(frozen=True)
class Graded:
    """A notebook's results: student, exercise -> what is wrong (empty: right), exercise -> words for a teacher."""

    student: str
    said: dict
    written: dict
    look_at: str

    @property
    def points(self):
        return sum(EXERCISES[name].points for name, words in self.said.items() if not words)


def grade(folder, seed, limits, jobs=2, sheet=None):
    """A list of `Graded`, one of each notebook in a folder, by name.

    seed: of the inputs, not 0, which is that of the students' own checks; jobs: notebooks side by side. The exercises
    graded are those that the notebook `sheet` names; without one those that the notebooks name, all where none names
    any. GradingError where there is nothing to grade.
    """
    paths, _ = found_in(folder)
    if not paths:
        raise GradingError(f"{folder}: no notebook (*.ipynb) in this folder; give the one with what was handed in")
    if seed < 1:
        raise GradingError(f"--seed {seed}: the students' own checks draw their inputs by 0; give 1 or more")
    if os.name != "posix":
        raise GradingError("grading needs limits that only Linux and macOS have; use one of these, or a container")
    if not (limits.seconds > 0 and limits.gb > 0 and jobs > 0):
        raise GradingError("--seconds, --gb and --jobs have to be positive numbers")
    notebooks = list(map(read, paths))
    named = {name for notebook in notebooks for name in notebook.names}
    names = [name for name in EXERCISES if name in named] or list(EXERCISES)
    if sheet and not (names := read(Path(sheet)).names):
        raise GradingError(f"--sheet {sheet}: names no exercise; give a student's notebook as `make course` writes it")
    with ThreadPoolExecutor(jobs) as pool:
        graded = pool.map(lambda notebook: _graded(notebook, names, seed, limits), notebooks)
        return list(tqdm(graded, total=len(notebooks), desc="grading", delay=2, leave=False))


def found_in(folder):
    """(notebooks that are graded, notebooks that are passed over: in folders below, or with another ending)."""
    every = sorted(path for path in Path(folder).rglob("*") if path.suffix.lower() == ".ipynb" and path.is_file())
    taken = [path for path in every if path.parent == Path(folder) and path.suffix == ".ipynb"]
    return taken, [path for path in every if path not in taken and ".ipynb_checkpoints" not in path.parts]


@cache
def is_isolated():
    """Whether processes can give up the network, and take all that they started with them when they end."""
    if not shutil.which(_ALONE[0]):
        return False
    return subprocess.run([*_ALONE, "true"], capture_output=True, check=False).returncode == 0


def _graded(notebook, names, seed, limits):
    try:
        said = _said(notebook, names, seed, limits)
    except Exception as error:  # whatever a notebook brings about, the others are graded
        said = dict.fromkeys(names, f"could not be graded: {type(error).__name__}: {error}")
    said = {name: clean(words) for name, words in said.items()}
    return Graded(notebook.student, said, notebook.written, notebook.look_at)


def _said(notebook, names, seed, limits):
    """exercise -> what is wrong, empty where the answer is right."""
    if notebook.unread:
        return dict.fromkeys(names, notebook.unread)
    said, end = {}, time.monotonic() + _WHOLE * limits.seconds
    while left := [name for name in names if name not in said]:
        found, ran = _sit(notebook.code, left, seed, limits, end)
        said |= found
        unanswered = [name for name in left if name not in found]
        late = time.monotonic() > end
        if late or not ran:
            why = "it took too long" if late else "its process ended, by os._exit, a crash or for want of memory"
            said |= dict.fromkeys(unanswered, f"the notebook could not be run to its end: {why}")
        elif unanswered:  # the next ones are asked in another process
            said[unanswered[0]] = f"`{EXERCISES[unanswered[0]].asks_for}` ends the process that checks it"
    return {name: said[name] for name in names}


def _sit(cells, names, seed, limits, end):
    """(exercise -> words, of those that were answered; whether the cells ran to their end), by one process."""
    told = {"cells": cells, "names": names, "seconds": limits.seconds, "gb": limits.gb, "isolated": is_isolated()}
    password, found, ran = secrets.token_hex(8), {}, False
    with (
        TemporaryDirectory(prefix="qclearn-grade-", ignore_cleanup_errors=True) as home,
        suppress(BrokenPipeError),  # of a process that has ended, when it is told or when its pipe is closed
        _started(home) as process,
    ):
        clock = threading.Timer(max(end - time.monotonic(), 0), _end, [process, home])
        clock.start()
        try:
            _tell(process, told)
            ran = process.stdout.readline(_LINE) == "ran\n"
            _tell(process, {"seed": seed, "password": password})
            while len(found) < len(names) and (line := process.stdout.readline(_LINE)):
                if line.startswith(password):
                    name, words = json.loads(line.removeprefix(password))
                    found[name] = words
        finally:
            clock.cancel()
            _end(process, home)
    return found, ran


def _started(home):
    """The process that runs a notebook, in a folder that is its home."""
    program = [*(_ALONE if is_isolated() else []), sys.executable, "-m", "qcbook.exercises.sitting"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    text = {"encoding": "utf-8", "errors": "replace"}
    return subprocess.Popen(program, cwd=home, env=_environment(home), start_new_session=True, **pipes, **text)


def _tell(process, message):
    process.stdin.write(json.dumps(message) + "\n")
    process.stdin.flush()


def _end(process, home):
    """End a process with all that it has started: its session, and what has left that; home: its folder.

    An isolated process takes all with it; elsewhere /proc, where there is one, tells whose home the folder is.
    """
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    if not is_isolated():
        for file in Path("/proc").glob("[0-9]*/environ"):
            with suppress(OSError):
                if f"HOME={home}\0".encode() in file.read_bytes():
                    os.kill(int(file.parent.name), signal.SIGKILL)


def _environment(home):
    package = str(Path(__file__).resolve().parents[2])
    paths = [package, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    own = {"HOME": home, "TMPDIR": home, "MPLBACKEND": "agg", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    own |= {"PYTHONDONTWRITEBYTECODE": "1"}
    kept = {name: os.environ[name] for name in _PASSED_ON if name in os.environ}
    return kept | own | {"PYTHONPATH": os.pathsep.join(paths)}


def feedback(graded):
    """The page for one student, Markdown."""
    parts = [f"# {graded.student}: {graded.points} of {sum(EXERCISES[name].points for name in graded.said)} points"]
    for name, words in graded.said.items():
        parts.append(f"## {EXERCISES[name].title}\n\n{words or 'Right.'}")
        if EXERCISES[name].read:
            parts.append(
                "Your sentence is read by your teacher." if name in graded.written else "No sentence was found."
            )
    return "\n\n".join(parts) + "\n"


def to_read(all_graded):
    """The page of what was written in words, for the teacher, by exercise; empty where nothing was."""
    parts = []
    for name in EXERCISES:
        texts = [(graded.student, graded.written[name]) for graded in all_graded if name in graded.written]
        if texts:
            asked = re.sub(r"\[([^\]]*)\]\(#[^)]*\)", r"\1", EXERCISES[name].read)  # the book's labels are not here
            parts.append(f"## {EXERCISES[name].title}\n\n{asked}")
            parts += [f"**{student}**\n\n{re.sub('^', '> ', text, flags=re.MULTILINE)}" for student, text in texts]
    return "\n\n".join(["# To read", *parts]) + "\n" if parts else ""


def table(all_graded):
    """The rows of the csv: student, points, of, each exercise, and the exercises whose sentences are to be read, and
    what is to be looked at."""
    names = list(all_graded[0].said)
    of = sum(EXERCISES[name].points for name in names)
    rows = [["student", "points", "of", *names, "to read", "look at"]]
    for graded in all_graded:
        words = [graded.said[name] or "right" for name in names]
        rows.append([graded.student, graded.points, of, *words, " ".join(graded.written), graded.look_at])
    return [[_harmless(cell) for cell in row] for row in rows]


def _harmless(cell):
    """A text that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@")) else cell
