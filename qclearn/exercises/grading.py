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

from .exercise import EXERCISES

_ALONE = ["unshare", "--user", "--map-current-user", "--net", "--pid", "--fork", "--kill-child"]
_LARGEST = 100_000_000  # bytes of a notebook
_PASSED_ON = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH")
_WHOLE = 10  # so many times the limit of a cell is that of the notebook
UNANSWERED = "*Your answer here.*"


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

    @property
    def points(self):
        return sum(EXERCISES[name].points for name, words in self.said.items() if not words)


class _Unreadable(ValueError):
    """Why a file is no notebook, in words for its student."""


def grade(folder, seed, limits, jobs=2):
    """A list of `Graded`, one of each notebook in a folder, by name.

    seed: of the inputs, not 0, which is that of the students' own checks; jobs: notebooks side by side. The exercises
    graded are those that the notebooks name, all where none names any. GradingError where there is nothing to grade.
    """
    paths = sorted(path for path in Path(folder).glob("*.ipynb") if path.is_file())
    if not paths:
        raise GradingError(f"{folder}: no notebook (*.ipynb) in this folder; give the one with what was handed in")
    if seed < 1:
        raise GradingError(f"--seed {seed}: the students' own checks draw their inputs by 0; give 1 or more")
    if os.name != "posix":
        raise GradingError("grading needs limits that only Linux and macOS have; use one of these, or a container")
    if not (limits.seconds > 0 and limits.gb > 0 and jobs > 0):
        raise GradingError("--seconds, --gb and --jobs have to be positive numbers")
    notebooks = [_read(path) for path in paths]
    named = {name for notebook in notebooks for name in _named(notebook)}
    names = [name for name in EXERCISES if name in named] or list(EXERCISES)
    with ThreadPoolExecutor(jobs) as pool:
        said = pool.map(lambda notebook: _said(notebook, names, seed, limits), notebooks)
        return [Graded(path.stem, *both) for path, both in zip(paths, zip(said, map(_written, notebooks)))]


@cache
def is_isolated():
    """Whether processes can give up the network, and take all that they started with them when they end."""
    if not shutil.which(_ALONE[0]):
        return False
    return subprocess.run([*_ALONE, "true"], capture_output=True, check=False).returncode == 0


def _read(path):
    """The notebook of a file, as the format has it; the reason, an _Unreadable, where it is none."""
    try:
        if path.stat().st_size > _LARGEST:
            raise _Unreadable(f"the file has more than {_LARGEST // 10**6} MB: clear its outputs")
        notebook = json.loads(path.read_text(encoding="utf-8"))
        return [
            (cell["cell_type"], "".join(cell["source"]), set(cell["metadata"].get("tags", [])), dict(cell["metadata"]))
            for cell in notebook["cells"]
        ]
    except _Unreadable as error:
        return error
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return _Unreadable("the file is not a notebook")


def _named(notebook):
    """The exercises that a notebook's cells name."""
    if isinstance(notebook, _Unreadable):
        return set()
    return {meta["exercise"] for *_, meta in notebook if isinstance(meta.get("exercise"), str)} & set(EXERCISES)


def _written(notebook):
    """exercise -> what a student wrote for the teacher to read."""
    if isinstance(notebook, _Unreadable):
        return {}
    found = {meta.get("exercise"): source.strip() for _, source, tags, meta in notebook if "sentence" in tags}
    return {name: found[name] for name in EXERCISES if found.get(name) not in (None, "", UNANSWERED)}


def _said(notebook, names, seed, limits):
    """exercise -> what is wrong, empty where the answer is right."""
    if isinstance(notebook, _Unreadable):
        return dict.fromkeys(names, str(notebook))
    # The student's own checks cost time and decide nothing.
    cells = [source for kind, source, tags, _ in notebook if kind == "code" and "check" not in tags]
    said, end = {}, time.monotonic() + _WHOLE * limits.seconds
    while left := [name for name in names if name not in said]:
        found, ran = _sit(cells, left, seed, limits, end)
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
            ran = process.stdout.readline() == "ran\n"
            _tell(process, {"seed": seed, "password": password})
            while len(found) < len(names) and (line := process.stdout.readline()):
                if line.startswith(password):
                    name, words = json.loads(line.removeprefix(password))
                    found[name] = words
        finally:
            clock.cancel()
            _end(process, home)
    return found, ran


def _started(home):
    """The process that runs a notebook, in a folder that is its home."""
    program = [*(_ALONE if is_isolated() else []), sys.executable, "-m", "qclearn.exercises.sitting"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    return subprocess.Popen(program, cwd=home, env=_environment(home), start_new_session=True, **pipes)


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
                "Your sentence is read by your teacher." if name in graded.written else "No sentence is there."
            )
    return "\n\n".join(parts) + "\n"


def to_read(all_graded):
    """The page of what was written in words, for the teacher, by exercise; empty where nothing was."""
    parts = []
    for name in EXERCISES:
        texts = [(graded.student, graded.written[name]) for graded in all_graded if name in graded.written]
        if texts:
            parts.append(f"## {EXERCISES[name].title}\n\n{EXERCISES[name].read}")
            parts += [f"**{student}**\n\n{re.sub('^', '> ', text, flags=re.MULTILINE)}" for student, text in texts]
    return "\n\n".join(["# To read", *parts]) + "\n" if parts else ""


def table(all_graded):
    """The rows of the csv: student, points, of, each exercise, and the exercises whose sentences are to be read."""
    names = list(all_graded[0].said)
    of = sum(EXERCISES[name].points for name in names)
    rows = [["student", "points", "of", *names, "to read"]]
    for graded in all_graded:
        words = [graded.said[name] or "right" for name in names]
        rows.append([graded.student, graded.points, of, *words, " ".join(graded.written)])
    return [[_harmless(cell) for cell in row] for row in rows]


def _harmless(cell):
    """A text that no spreadsheet takes for a formula."""
    return f"'{cell}" if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@")) else cell
