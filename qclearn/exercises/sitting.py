"""The process in which one notebook is graded: `grading.py` starts it, tells it the cells, and later the seed.

It runs the student's code with the rights of whoever grades. A line of JSON comes in, with the cells; the word `ran`
goes out; a line with seed and password comes in; for each exercise a line goes out, the password, the name, the words.
What the code prints goes nowhere.
"""

import json
import linecache
import os
import re
import resource
import signal
import sys
import types
from contextlib import contextmanager, suppress

MAGIC = re.compile(r"^([ \t]*)[%!].*", re.MULTILINE)  # %matplotlib inline, !pip install
PROCESSES = 256  # of one notebook, where the system counts them by notebook


class OutOfTime(BaseException):
    """A cell or a check takes too long; no `except Exception` of a student holds it."""

    def __str__(self):
        return "it takes too long"


@contextmanager
def at_most(seconds):
    """OutOfTime in a block that takes longer, and each second again."""

    def stop(*_):
        raise OutOfTime

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def bound(gb, isolated):
    """Let this process have so much memory and write files up to that size."""
    most = int(gb * 2**30)
    limits = {resource.RLIMIT_AS: most, resource.RLIMIT_FSIZE: most, resource.RLIMIT_CORE: 0}
    if isolated:
        limits[resource.RLIMIT_NPROC] = PROCESSES
    for kind, limit in limits.items():
        with suppress(ValueError, OSError):  # macOS bounds no memory
            resource.setrlimit(kind, (limit, limit))


def channels():
    """(file to read from, file to write to): this process's own, out of the way of what a student reads and prints."""
    question, answer = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for standard in range(3):
        os.dup2(nowhere, standard)
    return question, answer


def run_cell(source, place, space):
    """Run a cell in a namespace; what stopped it as words, empty where it came to its end."""
    linecache.cache[place] = len(source), None, source.splitlines(keepends=True), place
    try:
        try:
            code = compile(source, place, "exec")
        except SyntaxError:
            code = compile(MAGIC.sub(r"\1pass", source), place, "exec")
        exec(code, space)
    except BaseException as error:
        return f"{type(error).__name__}: {error}".removesuffix(": ")
    return ""


def run_all(cells, seconds):
    """(namespace, what stopped each cell) of a notebook that is run from above, whatever fails."""
    sys.modules["__main__"] = types.ModuleType("__main__")
    space = vars(sys.modules["__main__"])
    space["display"] = lambda *values, **how: None
    stopped = []
    for number, source in enumerate(cells, 1):
        try:
            with at_most(seconds):
                stopped.append(run_cell(source, f"<cell {number}>", space))
        except OutOfTime as error:  # between the cell and the end of its time
            stopped.append(f"OutOfTime: {error}")
    return space, stopped


def fresh_exercises():
    """The exercises, imported anew: whatever a notebook did to those that it imported."""
    for name in [name for name in sys.modules if name == "qclearn.exercises" or name.startswith("qclearn.exercises.")]:
        del sys.modules[name]
    from qclearn.exercises import EXERCISES

    return EXERCISES


def words_on(exercise, space, stopped, seed):
    """What is wrong with a notebook's answer to an exercise, empty where nothing is; stopped: cell -> its error."""
    name = exercise.asks_for
    if name not in space:
        kind = "function" if callable(exercise.solution) else "number"
        errors = [error for source, error in stopped if error and re.search(rf"\b{name}\b", source)]
        return f"no {kind} `{name}`: " + (f"its cell stops with {errors[-1]}" if errors else "its cell is missing")
    try:
        exercise.check(space[name], seed=seed)
    except AssertionError as error:
        return str(error) or "not right"
    except OutOfTime:
        return f"`{name}` takes longer than it may: does it end?"
    except BaseException as error:
        return f"`{name}` cannot be checked: {type(error).__name__}: {error}"
    return ""


def main():
    """Answer the questions of `grading.py` on one notebook."""
    question, answer = channels()
    told = json.loads(question.readline())
    bound(told["gb"], told["isolated"])
    space, errors = run_all(told["cells"], told["seconds"])
    stopped = list(zip(told["cells"], errors))
    print("ran", file=answer, flush=True)
    asked = json.loads(question.readline())
    exercises = fresh_exercises()
    for name in told["names"]:
        try:
            with at_most(told["seconds"]):
                words = words_on(exercises[name], space, stopped, asked["seed"])
        except OutOfTime:
            words = f"`{exercises[name].asks_for}` takes longer than it may: does it end?"
        print(asked["password"], json.dumps([name, words]), file=answer, flush=True)
    answer.flush()
    os._exit(0)  # whatever threads and exit handlers a notebook has left


if __name__ == "__main__":
    main()
