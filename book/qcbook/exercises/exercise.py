"""A graded exercise is one Python file of `tasks/`; the page, the student's and the teacher's
notebook are made of it.

    TITLE, PAGE, MINUTES, POINTS   what, on which page, how long, how much
    TASK                           the words, MyST text as on the page
    READ                           (optional) what is asked for in a sentence or a proof, which a teacher reads
    # %% answer                    code; ### BEGIN SOLUTION ... ### END SOLUTION is the blank of the student's notebook
    # %% test
    def cases(rng)                 inputs, drawn anew for each seed
    def verdict(answer, case)      None, or a sentence: what is wrong on this input; it does not tell the answer
    def evidence(answer, case)     what a known mistake is recognised by: numbers, an array, a truth value
    MISTAKES                       name -> ((old, new), sentence): an edit of the solution's text, and what names it
    NEAR                           (optional) how near evidence has to come, relative and absolute, to be that mistake's

The last function that the answer defines is asked for, or the last number. A known mistake is
recognised by what the answer returns: whoever makes the same mistake in other words is told the
same.
"""

import ast
import copy
import functools
import importlib
import inspect
import linecache
import numbers
import pkgutil
import re
import sys
import sysconfig
import textwrap
import traceback
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import issparse

import qclearn as qc

from . import tasks

_MARKED = re.compile(
    r"^([ \t]*)### BEGIN SOLUTION[ \t]*\n(.*?)^[ \t]*### END SOLUTION[ \t]*\n", re.DOTALL | re.MULTILINE
)
_MOST_CHARACTERS = 300  # of what a student is told
_OURS = Path(qc.__file__).parent, Path(__file__).parents[1]
_ELSEWHERE = (*map(str, _OURS), *(sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib")))


@dataclass(frozen=True)
class Exercise:
    """One file of `tasks/`: its texts, its solution, its known mistakes, and the check of an
    answer."""

    name: str
    title: str
    page: str
    minutes: int
    points: int
    words: str  # the question, MyST text
    read: str  # what is asked for in words, for a teacher to read; empty where nothing is
    module: object = field(repr=False)

    @property
    def sentences(self):
        """Name of a known mistake -> the sentence that names it to the student."""
        return {name: sentence for name, (_, sentence) in self.module.MISTAKES.items()}

    @cached_property
    def source(self):
        """The text of the answer, with the marks of its solution."""
        _, _, text = inspect.getsource(self.module).partition("# %% answer\n")
        return text.partition("# %% test")[0].strip() + "\n"

    @cached_property
    def solved(self):
        """The text of the solution."""
        return _MARKED.sub(lambda match: match[2], self.source)

    @cached_property
    def blank(self):
        """The answer's text as a student gets it."""
        name = "" if callable(self.solution) else f"{self.asks_for} = "
        return _MARKED.sub(lambda match: f"{match[1]}{name}...  # your lines here\n", self.source)

    @cached_property
    def asks_for(self):
        """The name of the function or number that is asked for: the last one that the answer
        defines."""
        names = [
            node.name if isinstance(node, ast.FunctionDef) else node.targets[0].id
            for node in ast.parse(self.solved).body
            if isinstance(node, ast.FunctionDef) or (isinstance(node, ast.Assign) and hasattr(node.targets[0], "id"))
        ]
        return names[-1]

    def _compiled(self, text):
        space = {"np": np, "qc": qc}  # what the first cell of a student's notebook imports
        exec(compile(text, f"<{self.name}>", "exec"), space)
        return space[self.asks_for]

    @cached_property
    def solution(self):
        return self._compiled(self.solved)

    @cached_property
    def wrong(self):
        """Name of a known mistake -> an answer that makes it."""
        made = {}
        for name, ((old, new), _) in self.module.MISTAKES.items():
            if self.solved.count(old) != 1:
                raise ValueError(f"{self.name}, {name}: {old!r} stands {self.solved.count(old)} times in the solution")
            made[name] = self._compiled(self.solved.replace(old, new))
        return made

    def check(self, answer, seed=0):
        """Check a function or number on the inputs of a seed.

        AssertionError with one line, at most 300 characters, that names the mistake; nothing where
        the answer is right.
        """
        words = self.misfit(answer)
        if not words:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                words = self._mistake(answer, seed)
        if words:
            raise AssertionError(_short(words))

    def misfit(self, answer):
        """In words, that an answer is no function or no number; empty where it is what is asked
        for."""
        asked, given = ("function" if callable(self.solution) else "number"), type(answer).__name__
        fits = callable(answer) if asked == "function" else _is_number(answer)
        return "" if fits else f"`{self.asks_for}` should be a {asked}; this is {_with_article(given)}"

    def _mistake(self, answer, seed):
        """What is wrong with an answer, in words; None where nothing is."""
        cases = list(self.module.cases(np.random.default_rng(seed)))
        for case in cases:
            asked = _Noted(answer) if callable(answer) else answer
            found = self._found(asked, case)
            if found and callable(answer) and asked.returned_nothing:
                return f"`{self.asks_for}` returns nothing yet; does it end with `return`?"
            if found and (named := self._known(answer, cases, seed)):
                together = f"{named} ({found})"
                return together if len(together) <= _MOST_CHARACTERS else named
            if self._gives_nan(asked, case):
                return f"`{self.asks_for}` gives NaN, which is not a number: is something divided by 0 there?"
            if found:
                return found
        return None

    def _gives_nan(self, asked, case):
        """Whether an answer, asked on an input, has given NaN where the solution gives none."""
        if not isinstance(asked, _Noted):
            return _has_nan(asked)
        rightly = _Noted(self.solution)
        return _has_nan(asked.returned) and not (self._found(rightly, case) is None and _has_nan(rightly.returned))

    def _found(self, answer, case):
        """The verdict on one input, an exception as words."""
        try:
            return self.module.verdict(answer, case)
        except tasks.Misfit as error:
            return str(error)
        except (Exception, SystemExit) as error:
            return _told(error, self.asks_for)

    def _known(self, answer, cases, seed):
        """The sentence of the known mistake that gives what the answer gives on all inputs; None
        where none does."""
        mine = functools.cache(lambda number: self._evidence(answer, cases[number]))

        def known(name, number):
            if (seed, name, number) not in self._seen:
                self._seen[seed, name, number] = self._evidence(self.wrong[name], cases[number])
            return self._seen[seed, name, number]

        numbers, near = range(len(cases)), getattr(self.module, "NEAR", (1e-6, 1e-9))
        for name in self.wrong:
            if not all(_same(mine(number), known(name, number), *near) for number in numbers):
                continue
            if not all(isinstance(mine(number), type) for number in numbers):
                return self.sentences[name]
        return None

    @cached_property
    def _seen(self):
        """(seed, known mistake, number of the input) -> its evidence, of those that were compared
        with an answer."""
        return {}

    def _evidence(self, answer, case):
        """What a mistake is recognised by on one input: an array, or the kind of an exception."""
        try:
            return np.asarray(self.module.evidence(_Noted(answer) if callable(answer) else answer, case))
        except (Exception, SystemExit) as error:
            return type(error)


class _Noted:
    """A function that gets arrays of its own, and notes what it returns."""

    def __init__(self, function):
        self.function, self.returned = function, []

    def __call__(self, *given, **named):
        own = {name: _own(value) for name, value in named.items()}
        self.returned.append(self.function(*map(_own, given), **own))
        return self.returned[-1]

    @property
    def returned_nothing(self):
        return bool(self.returned) and all(value is None or value is ... for value in self.returned)


def _own(value):
    """A copy of arrays, which an answer may write over; anything else as it is."""
    try:
        return copy.deepcopy(value) if isinstance(value, (np.ndarray, list, tuple, dict)) or issparse(value) else value
    except Exception:
        return value  # a list of what cannot be copied


def _is_number(answer):
    if isinstance(answer, np.ndarray):
        return answer.ndim == 0 and answer.dtype.kind in "iufc"
    return isinstance(answer, numbers.Number) and not isinstance(answer, (bool, np.bool_))


def _has_nan(value):
    """Whether a number, an array, or one inside lists and tuples is NaN."""
    if isinstance(value, (list, tuple)):
        return any(map(_has_nan, value))
    return isinstance(value, (numbers.Number, np.ndarray)) and bool(
        np.asarray(value).dtype.kind in "fc" and np.isnan(value).any()
    )


def _same(one, other, rtol, atol):
    """Whether two pieces of evidence are equal up to rounding; NaN equals NaN, an exception one of
    its kind."""
    if isinstance(one, type) or isinstance(other, type):
        return one is other
    if one.shape != other.shape:
        return False
    if one.dtype.kind not in "biufc" or other.dtype.kind not in "biufc":
        return one.dtype.kind == other.dtype.kind and np.array_equal(one, other)
    return np.allclose(one, other, rtol=rtol, atol=atol, equal_nan=True)


def _with_article(name):
    return "None" if name == "NoneType" else f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _short(words):
    return textwrap.shorten(words, _MOST_CHARACTERS, placeholder=" ...")


def _told(error, name):
    """Words on an exception: that of the student's function with its line, or one about what it
    returns."""
    theirs = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(_ELSEWHERE)]
    what = f"{type(error).__name__}: {_short(str(error))[:150]}".removesuffix(": ")
    if isinstance(error, TypeError) and not theirs and re.search("(positional|keyword|required) argument", f"{error}"):
        return f"`{name}` cannot be called as the question has it ({what})"
    if not theirs:
        return f"what `{name}` returns is not what is asked for ({what})"
    line = linecache.getline(theirs[-1].filename, theirs[-1].lineno).strip()
    return f"`{name}` stops with {what}" + (f", in `{line}`" if line else "")


def _load(name):
    module = importlib.import_module(f"{tasks.__name__}.{name}")
    texts = module.TASK.strip(), getattr(module, "READ", "").strip()
    return Exercise(name.replace("_", "-"), module.TITLE, module.PAGE, module.MINUTES, module.POINTS, *texts, module)


_LOADED = [_load(name) for name in sorted(module.name for module in pkgutil.iter_modules(tasks.__path__))]
EXERCISES = {exercise.name: exercise for exercise in _LOADED}


def check(name, answer=None):
    """For students: print in a line whether an answer to an exercise is right, or what is wrong
    with it."""
    exercise = EXERCISES.get(name) if isinstance(name, str) else None
    if exercise is None:
        _say(f"There is no exercise {name!r}; there are {', '.join(EXERCISES)}.")
        return
    try:
        exercise.check(answer)
    except AssertionError as error:
        _say(f"✗ {name}: not yet. {error}")
    except Exception as error:
        _say(f"✗ {name}: the check itself failed, which is no mistake of yours. {_short(f'{error!r}')}")
    else:
        _say(f"✓ {name}: right, {exercise.points} points.")


def _say(line):
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    print(line.encode(encoding, "replace").decode(encoding))
