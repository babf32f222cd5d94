"""The process in which one notebook is graded: `grading.py` starts it, tells it the cells, and later the seed.

It runs the student's code with the rights of whoever grades. A line of JSON comes in, with the cells; the word `ran`
goes out; a line with seed and password comes in; for each exercise a line goes out, the password, the name, the words.
What the code prints goes nowhere.
"""

import ast
import asyncio
import inspect
import json
import linecache
import os
import re
import resource
import signal
import sys
import types
from contextlib import contextmanager, suppress
from unittest.mock import MagicMock

MAGIC = re.compile(r"^([ \t]*)(?:[%!?].*|[\w.]+\?+[ \t]*$)", re.MULTILINE)  # %matplotlib inline, !pip install, np.roll?
GIVEN = re.compile(r"^([ \t]*[\w, ]+=[ \t]*)[%!].*", re.MULTILINE)  # files = !ls
RELIED_ON = re.compile(r"(?:builtins|math|numpy|scipy|shapely|qclearn|qcbook)(?:\.|$)")
MOST = 1000  # characters of what is wrong
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


def parsed(source, place):
    """The syntax tree of a cell; lines of IPython's own are passed over where Python does not take them."""
    try:
        return ast.parse(source, place)
    except SyntaxError:
        return ast.parse(MAGIC.sub(r"\1pass", GIVEN.sub(r"\1get_ipython()", source)), place)


def run_cell(source, place, space, note=lambda: None):
    """Run a cell in a namespace; what stopped it as words, empty where it came to its end.

    note() is called after each statement: a later one may give a name to another thing.
    """
    linecache.cache[place] = len(source), None, source.splitlines(keepends=True), place
    try:
        for node in parsed(source, place).body:
            try:
                code = compile(ast.Module([node], []), place, "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
                if inspect.iscoroutine(awaited := eval(code, space)):
                    asyncio.run(awaited)
            finally:
                note()
    except BaseException as error:
        what = f"{error}"
        if isinstance(error, SyntaxError) and error.filename == place:
            what = f"{error.msg}, in `{linecache.getline(place, error.lineno or 1).strip()}`"
        return f"{type(error).__name__}: {what}".removesuffix(": ")
    return ""


def run_all(cells, seconds, names):
    """(name -> the values that it had, what stopped each cell) of a notebook that is run from above, whatever fails."""
    sys.modules["__main__"] = types.ModuleType("__main__")
    space = vars(sys.modules["__main__"])
    space |= {"display": lambda *values, **how: None, "get_ipython": MagicMock()}
    stopped, values = [], {name: [] for name in names}

    def note():
        for name, had in values.items():
            if name in space and not (had and had[-1] is space[name]):
                had.append(space[name])

    for number, source in enumerate(cells, 1):
        try:
            with at_most(seconds):
                stopped.append(run_cell(source, f"<cell {number}>", space, note))
        except BaseException as error:  # between the cell and the end of its time, or one that has no words
            stopped.append(type(error).__name__)
    return values, stopped


def kept():
    """name -> (module, what it holds), of the modules that checks rely on."""
    return {name: (module, dict(vars(module))) for name, module in sys.modules.items() if RELIED_ON.match(name)}


def restore(modules):
    """Undo what a notebook did to the names in modules that were `kept`."""
    for name, (module, held) in modules.items():
        sys.modules[name] = module
        vars(module).update(held)
        for new in set(vars(module)) - set(held):
            if not isinstance(vars(module)[new], types.ModuleType):
                del vars(module)[new]


def fresh_exercises():
    """The exercises, imported anew: whatever a notebook did to those that it imported."""
    for name in [name for name in sys.modules if name == "qcbook.exercises" or name.startswith("qcbook.exercises.")]:
        del sys.modules[name]
    from . import EXERCISES

    return EXERCISES


def words_on(exercise, values, stopped, seed):
    """What is wrong with a notebook's answer to an exercise, empty where nothing is.

    values: what the name had that is asked for, of which the last one of the right kind counts; stopped: cell -> its
    error.
    """
    name = exercise.asks_for
    if not values:
        kind = "function" if callable(exercise.solution) else "number"
        errors = [error for source, error in stopped if error and re.search(rf"\b{name}\b", source)]
        return f"no {kind} `{name}`: " + (f"its cell stops with {errors[-1]}" if errors else "its cell is missing")
    try:
        exercise.check(next((value for value in reversed(values) if not exercise.misfit(value)), values[-1]), seed=seed)
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
    exercises = [fresh_exercises()[name] for name in told["names"]]
    for exercise in exercises:  # so that all that a check needs is loaded, and kept
        with suppress(Exception):
            exercise.check(exercise.solution)
    modules = kept()
    values, errors = run_all(told["cells"], told["seconds"], [exercise.asks_for for exercise in exercises])
    stopped = list(zip(told["cells"], errors))
    restore(modules)
    print("ran", file=answer, flush=True)
    asked = json.loads(question.readline())
    exercises = fresh_exercises()
    for exercise in map(exercises.get, told["names"]):
        try:
            with at_most(told["seconds"]):
                words = words_on(exercise, values[exercise.asks_for], stopped, asked["seed"])
        except OutOfTime:
            words = f"`{exercise.asks_for}` takes longer than it may: does it end?"
        line = json.dumps([exercise.name, " ".join(words[:MOST].split())])
        print(asked["password"], line, file=answer, flush=True)
    answer.flush()
    os._exit(0)  # whatever threads and exit handlers a notebook has left


if __name__ == "__main__":
    main()
