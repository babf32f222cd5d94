"""Some fifty notebooks as students hand them in, graded, and every result that is not as planted told: two minutes.

    python -m book.builder.handins

Right ones, every known mistake of three exercises, and what else comes: endless loops, crashes, deleted cells, attempts
to change the check. Nothing here harms the machine, and grading says what it runs.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from copy import deepcopy
from pathlib import Path

import numpy as np

from .course import Sheets
from .graded import EXERCISES

NAMES = ("alpha-signs", "accept-fold", "landmark-gradient")  # asked for: alphas, accepts, landmark_gradient
SECONDS = 5
NOT_RUN = "the notebook could not be run to its end"
NOT_THERE = "no function `alphas`"
OTHERS = {
    "right-in-other-words": "def alphas(m):\n    s = 1 - abs(m)**2\n"
    "    return abs(1 - m)**2 / s, -2 * m.imag / s, abs(1 + m)**2 / s",
    "right-after-a-magic": "%matplotlib inline\n!echo hello\nfiles = !ls\ntime = %timeit -o 1\nnp.roll?\n"
    "import asyncio\nawait asyncio.sleep(0)\nget_ipython().system('ls')\n" + EXERCISES["alpha-signs"].solved,
    "right-then-another-thing": EXERCISES["alpha-signs"].solved + "\nalphas = alphas(0.5j)",
}
# name of a hand-in -> what stands in the blank of alpha-signs, what the student is told of it
ANSWERS = {
    "syntax-error": ("def alphas(mu:\n    return 1", f"{NOT_THERE}: its cell stops with SyntaxError"),
    "endless-cell": ("def alphas(mu):\n    return 1\nwhile True:\n    pass", "the shape ()"),
    "endless-before-alphas": (
        "while True:\n    pass\ndef alphas(mu):\n    pass",
        f"{NOT_THERE}: its cell stops with Out",
    ),
    "endless-function": ("def alphas(mu):\n    while True:\n        pass", "does it end?"),
    "endless-and-deaf": (
        "from signal import *\ndef alphas(mu):\n    signal(SIGALRM, SIG_IGN)\n    while True:\n        pass",
        "could not be run to its end: it took too long",
    ),
    "raises": ("def alphas(mu):\n    return 1 / 0", "`alphas` stops with ZeroDivisionError: division by zero, in `ret"),
    "two-values": ("def alphas(mu):\n    return mu.real, mu.imag", "the shape (2,)"),
    "a-number": ("alphas = 3", "should be a function"),
    "the-blank": (EXERCISES["alpha-signs"].blank, "returns nothing yet"),
    "tampers": (
        "def alphas(mu):\n    return 0, 0, 0\nimport qcbook.exercises\nqcbook.exercises.check = print\n"
        "from qcbook.exercises import EXERCISES\nfrom qcbook.exercises.exercise import Exercise\n"
        "Exercise.check = lambda *a, **k: None\nimport sys\nsys.modules['qcbook.exercises'] = None\n"
        "np.max = lambda *given: 0",
        "off by",
    ),
    "patches-the-draw": (
        "def alphas(mu):\n    return 1, 0, 1\nclass Still:\n    def __getattr__(self, name):\n"
        "        return lambda *given, size=(), **named: np.zeros(size)\n"
        "np.random.default_rng = lambda seed: Still()",
        "off by",
    ),
    "patches-what-is-built-in": (
        "import builtins, sys\nbuiltins.max = lambda *given: 0\nsys.modules['numpy'] = None\n"
        "alphas = lambda mu: (0, 0, 0)",
        "off by",
    ),
    "check-overwritten": ("def check(*a): print('right')\ndef alphas(mu):\n    return 0, 0, 0", "off by"),
    "forged": (
        "import json, os\nos.write(1, b'ran\\n')\nprint(json.dumps(['alpha-signs', '']))\nalphas = lambda m: (0, 0, 0)",
        "off by",
    ),
    "function-exits": ("import os\ndef alphas(mu):\n    os._exit(0)", "ends the process that checks it"),
    "function-leaves": ("def alphas(mu):\n    exit()", "`alphas` stops with"),
    "memory": ("def alphas(mu):\n    return np.ones(10**12)", "MemoryError"),
    "huge-output": (
        "def alphas(mu):\n    print('x' * 10**7)\n    return 0, 0, 0\nfor _ in range(20):\n    print('x' * 10**7)",
        "off by",
    ),
}
# What stops the whole notebook, or nothing of it
HARMLESS = {
    "right-but-child-left": "import subprocess\nfor _ in range(5):\n"
    "    subprocess.Popen(['sleep', '86399'], start_new_session=True)\n",
    "right-but-forks": "import os, time\nfor _ in range(3):\n    if os.fork() == 0:\n        os.setsid()\n"
    "        time.sleep(86399)\n",
    "right-but-writes": "import os\nopen('here.txt', 'w').write('x')\nos.makedirs(os.path.expanduser('~/there'))\n"
    "open(os.path.expanduser('~/there/x'), 'w').write('x')\n",
    "right-but-moves": "import os, sys\nos.chdir('/')\nsys.stdout = None\nnp.seterr(all='raise')\nsys.exit()\n",
}

# What could stop the grading of all: junk to where a process answers, words that no file takes
JUNK = """import os
for channel in range(3, 20):
    try:
        os.write(channel, b'\\xff' * 10**6)
    except OSError:
        pass
"""
UNFIT = "def accepts(*given):\n    raise ValueError('\\ud800')"


def seen():
    """The inputs of the students' own check with the right answers, by heart."""
    exercise = EXERCISES["alpha-signs"]
    cases = exercise.module.cases(np.random.default_rng(0))
    return {repr(case[0]): np.array(exercise.solution(case[0])).tolist() for case in cases}


class HandIns:
    """Makes the notebooks: name -> (notebook, exercise -> a part of what the student is told; right where none is)."""

    def __init__(self):
        self.sheet = Sheets().notebook(NAMES)
        self.right = {name: EXERCISES[name].solved for name in NAMES}

    def notebook(self, **answers):
        """The student's notebook with these texts in the blanks, solutions in the others."""
        notebook = deepcopy(self.sheet)
        texts = self.right | {name.replace("_", "-"): text for name, text in answers.items()}
        for cell in notebook.cells:
            if "answer" in cell.metadata.get("tags", []):
                cell.source = texts[cell.metadata["exercise"]]
        return notebook

    def mistakes(self):
        for name in NAMES:
            exercise = EXERCISES[name]
            for number, ((old, new), sentence) in enumerate(exercise.module.MISTAKES.values(), 1):
                yield f"{name}-{number}", self.notebook(**{name: exercise.solved.replace(old, new)}), {name: sentence}

    def answers(self):
        known = OTHERS["right-in-other-words"].replace("-2 * m.imag", "(m - m.conjugate()).imag")
        (sentence,) = (words for name, words in EXERCISES["alpha-signs"].sentences.items() if name == "sign of alpha_2")
        by_heart = f"_seen = {seen()!r}\ndef alphas(mu):\n    return _seen[repr(mu)]"
        told = {"mistake-in-other-words": (known, sentence), "by-heart": (by_heart, "KeyError")} | ANSWERS
        for key, (text, words) in told.items():
            expected = {"alpha-signs": words}
            if key == "endless-and-deaf":  # it takes the time of all
                expected = dict.fromkeys(NAMES, words) | {"accept-fold": ""}
            yield key, self.notebook(alpha_signs=text), expected
        for key, text in OTHERS.items():
            yield key, self.notebook(alpha_signs=text), {}
        for key, text in HARMLESS.items():
            yield key, self.notebook(alpha_signs=self.right["alpha-signs"] + "\n\n" + text), {}

    def notebooks(self):
        right = self.notebook()
        yield "all-right", right, {}
        yield "nothing-done", self.sheet, dict.fromkeys(NAMES, "returns nothing yet")
        exits = self.notebook(alpha_signs="import os\nos._exit(1)")
        yield "exits", exits, dict.fromkeys(NAMES, NOT_RUN)
        fewer = deepcopy(right)
        fewer.cells = [cell for cell in right.cells if cell.metadata.get("exercise") != "accept-fold"]
        yield "deleted-a-cell", fewer, {"accept-fold": "no function `accepts`: its cell is missing"}
        backwards = deepcopy(right)
        backwards.cells = right.cells[::-1]
        yield "cells-in-reverse", backwards, {}
        bare = deepcopy(right)
        for cell in bare.cells:
            cell.metadata.clear()
        yield "without-metadata", bare, {}
        merged = self.notebook(alpha_signs=EXERCISES["alpha-signs"].blank)
        for cell in merged.cells:
            if cell.metadata.get("exercise") == "alpha-signs" and "check" in cell.metadata.tags:
                cell.source = f"{self.right['alpha-signs']}\n{cell.source}"
        yield "right-in-the-check's-cell", merged, {}
        junk = self.notebook(alpha_signs=f"{self.right['alpha-signs']}\n{JUNK}", accept_fold=UNFIT)
        for cell in junk.cells:
            if "sentence" in cell.metadata.get("tags", []):
                cell.source = "Half a character, \ud800, and \x1b[31mred."
        junk.cells.append(deepcopy(junk.cells[-1]))
        junk.cells[-1].metadata["exercise"] = ["alpha-signs"]
        yield os.fsdecode(b"J\xfcrgen"), junk, {"accept-fold": "`accepts` stops with ValueError"}

    def all(self):
        made = [*self.notebooks(), *self.answers(), *self.mistakes()]
        return {key: (notebook, expected) for key, notebook, expected in made}


def plant(folder, chosen):
    """Write hand-ins, name -> (notebook, expected), and one file that is no notebook; what is expected of each."""
    for key, (notebook, _) in chosen.items():
        (folder / f"{key}.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    (folder / "no-notebook.ipynb").write_text("def alphas(mu): ...", encoding="utf-8")
    none = {"no-notebook": dict.fromkeys(NAMES, "the file is not a notebook")}
    return {os.fsencode(key).decode(errors="replace"): expected for key, (_, expected) in chosen.items()} | none


def unexpected(file, expected):
    """Lines on each result in a csv that is not as planted."""
    with open(file, newline="", encoding="utf-8") as rows:
        found = {row["student"]: row for row in csv.DictReader(rows)}
    if set(found) != set(expected):
        yield f"notebooks: {sorted(set(found) ^ set(expected))}"
    for student, row in found.items():
        for name in NAMES:
            wanted = expected.get(student, {}).get(name, "")
            if row[name] != "right" if not wanted else wanted not in row[name] or row[name] == "right":
                yield f"{student}, {name}: {row[name]!r}, where {wanted or 'right'!r} was planted"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="notebooks side by side")
    arguments = parser.parse_args()
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder, "handed-in")
        place.mkdir()
        expected = plant(place, HandIns().all())
        options = ["--seed", "2026", "--seconds", str(SECONDS), "--jobs", str(arguments.jobs)]
        command = [sys.executable, "-m", "qclearn", "grade", place, "--out", Path(folder, "grades.csv"), *options]
        subprocess.run(command, check=True)
        wrong = list(unexpected(Path(folder, "grades.csv"), expected))
    print(*wrong, sep="\n")
    print(f"{len(expected)} hand-ins in {time.monotonic() - begun:.0f} s, {len(wrong)} results not as planted")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
