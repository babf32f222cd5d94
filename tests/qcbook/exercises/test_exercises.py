"""Graded exercises: the solution is right, each known mistake is told by its own sentence, anything else by words."""

import ast
import linecache
import re
import subprocess
import sys
from collections import Counter
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from book.builder.graded import EXERCISES
from book.builder.references import chapters, markdown_of
from leaks import lines_of
from qcbook.exercises import check
from qcbook.exercises.exercise import Exercise
from test_repository import WIDEST_LINE

SEEDS = range(5)
OTHERS = [None, "yes", lambda *given: None, lambda *given: 1 / 0, lambda *given: exit(), lambda: 1]
OTHERS += [lambda *given: np.nan, lambda *given: "yes"]
every = pytest.mark.parametrize("exercise", EXERCISES.values(), ids=EXERCISES)


def said(exercise, answer, seed=0):
    """What a student is told, empty where the answer is right."""
    try:
        exercise.check(answer, seed)
    except AssertionError as error:
        return str(error)
    return ""


class Renamed(ast.NodeTransformer):
    """Code with other names for the variables that it assigns in functions, and without docstrings."""

    def __init__(self, names):
        self.names = names

    def visit_Name(self, node):
        return ast.Name(f"{node.id}_of_mine" if node.id in self.names else node.id, node.ctx)

    def visit_FunctionDef(self, node):
        node.body = node.body[ast.get_docstring(node) is not None :] or node.body
        return self.generic_visit(node)


def in_other_words(text):
    tree = ast.parse(text)
    inner = [node for function in tree.body if isinstance(function, ast.FunctionDef) for node in ast.walk(function)]
    stored = {node.id for node in inner if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    given = {node.arg for node in inner if isinstance(node, ast.arg)}
    return ast.unparse(ast.fix_missing_locations(Renamed(stored - given).visit(tree)))


@every
def test_the_solution_is_right_whatever_it_does_to_its_input(exercise):
    assert [said(exercise, exercise.solution, seed) for seed in SEEDS] == [""] * len(SEEDS)
    if callable(exercise.solution):
        assert said(exercise, spoiling(exercise.solution)) == ""


@every
def test_a_section_that_the_question_names_is_on_its_page(exercise):
    named = re.findall(r"[Ss]ection \*(.+?)\*", " ".join(exercise.words.split()))
    assert set(named) <= set(re.findall(r"^#+ (.*)$", markdown_of(exercise.page), re.MULTILINE))


def spoiling(function):
    """A function that writes over the arrays it was given."""

    def spoilt(*given):
        found = function(*given)
        for value in given:
            if isinstance(value, np.ndarray) and value.flags.writeable and value is not found:
                value[...] = 0
        return found

    return spoilt


@every
def test_each_mistake_is_told_by_its_own_sentence_at_each_seed(exercise):
    assert len(exercise.wrong) >= 3
    for name, answer in exercise.wrong.items():
        told = [said(exercise, answer, seed) for seed in SEEDS]
        assert [text for text in told if not text.startswith(exercise.sentences[name])] == [], name
        assert all(30 <= len(text) <= 300 for text in told), name
        assert [line for line in lines_of(exercise.solved) if any(line in text for text in told)] == [], name


@every
def test_sentences_differ_before_their_brackets(exercise):
    heads = [sentence.split("(")[0].strip() for sentence in exercise.sentences.values()]
    assert len(set(heads)) == len(heads) and min(map(len, heads)) >= 30


@every
def test_a_mistake_is_recognised_in_other_words(exercise):
    for name, ((old, new), sentence) in exercise.module.MISTAKES.items():
        retyped = exercise._compiled(in_other_words(exercise.solved.replace(old, new)))
        answer = partial(lambda inner, *given: inner(*given), retyped) if callable(retyped) else retyped
        assert said(exercise, answer).startswith(sentence), name


@every
def test_any_other_answer_gets_words_and_no_traceback(exercise, capsys):
    for answer in (*OTHERS, 3.0 if callable(exercise.solution) else True):
        check(exercise.name, answer)
        printed = capsys.readouterr().out
        assert printed.startswith(f"✗ {exercise.name}: not yet. ") and len(printed.splitlines()) == 1
        assert len(printed) < 340 and "the check itself failed" not in printed


@every
def test_what_stands_around_an_exercise_is_sound(exercise):
    assert exercise.page in chapters()
    assert 5 <= exercise.minutes <= 60 and 1 <= exercise.points <= 10
    assert "### " not in exercise.solved + exercise.blank and "# your lines here" in exercise.blank
    assert ":::" not in exercise.words and "{eval}" not in exercise.words
    assert [line for line in exercise.blank.splitlines() if len(line) > WIDEST_LINE] == []


def test_answers_in_one_notebook_do_not_overwrite_each_other():
    nodes = [node for exercise in EXERCISES.values() for node in ast.parse(exercise.solved).body]
    names = [getattr(node, "name", None) or getattr(getattr(node, "targets", [None])[0], "id", None) for node in nodes]
    assert [name for name, times in Counter(names).items() if name and times > 1] == []


def test_checking_needs_no_torch_and_naming_the_exercises_is_light():
    program = (
        "import sys; from qcbook.exercises import EXERCISES; print(len(sys.modules) < 800)\n"
        "for exercise in EXERCISES.values(): exercise.check(exercise.solution)\n"
        "print([name for name in ('torch', 'matplotlib', 'nbformat', 'IPython') if name in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ran.stdout == "True\n[]\n"


# The check itself, on small exercises that are made here.


def off(answer, case):
    return None if abs(answer(case) - case - 1).max() < 1e-9 else "it is off by more than rounding"


def small(source, **parts):
    """An exercise that is made of a source and of other parts than these."""
    usual = {
        "MISTAKES": {"two": (("1", "2"), "This adds two and not one, as one sees at zero")},
        "cases": lambda rng: list(rng.normal(size=(3, 2))),
        "verdict": off,
        "evidence": lambda answer, case: answer(case),
    }
    made = Exercise("small", "Small", "lbs", 5, 1, "Add one.", "", SimpleNamespace(**usual | parts))
    vars(made)["source"] = source
    return made


FUNCTION = "def more(x):\n    ### BEGIN SOLUTION\n    return x + 1\n    ### END SOLUTION\n"


def test_a_mistake_is_told_by_what_it_returns_with_the_verdict_in_brackets():
    told = "This adds two and not one, as one sees at zero (it is off by more than rounding)"
    assert said(small(FUNCTION), lambda x: -(-x - 2)) == told
    assert said(small(FUNCTION), lambda x: x + 3) == "it is off by more than rounding"


def test_nan_is_never_right_even_where_a_verdict_lets_it_through():
    careless = small(
        FUNCTION, verdict=lambda answer, case: "off" if abs(answer(case) - case - 1).max() > 1e-9 else None
    )
    assert "NaN" in said(careless, lambda x: x * np.nan) and said(careless, lambda x: x + 1) == ""
    missing = small(FUNCTION.replace("x + 1", "x * np.nan"), verdict=lambda answer, case: (answer(case), None)[1])
    assert said(missing, lambda x: np.nan) == ""  # where the solution gives NaN, too


def test_an_exception_is_told_with_the_students_line():
    space, cell = {}, "def more(x):\n    return x.no_such_thing\n"
    linecache.cache["<cell 1>"] = len(cell), None, cell.splitlines(keepends=True), "<cell 1>"
    exec(compile(cell, "<cell 1>", "exec"), space)
    told = said(small(FUNCTION), space["more"])
    assert told.startswith("`more` stops with AttributeError") and told.endswith("in `return x.no_such_thing`")


def test_a_number_is_asked_for_and_checked():
    exercise = small(
        "### BEGIN SOLUTION\nhow_many = 6.0\n### END SOLUTION\n",
        MISTAKES={"half": (("6.0", "3.0"), "This is half of the number that is asked for here")},
        cases=lambda rng: [None],
        verdict=lambda answer, case: "not this number" if abs(answer - 6) > 1e-9 else None,
        evidence=lambda answer, case: answer,
    )
    assert exercise.blank == "how_many = ...  # your lines here\n" and said(exercise, np.array(6)) == ""
    assert said(exercise, 3).startswith("This is half of the number that is asked for here (")
    assert all(
        said(exercise, answer).startswith("`how_many` should be a number; this is ") for answer in (..., "6", True)
    )
    assert "NaN" in said(exercise, np.nan)


def test_warnings_of_an_answer_are_not_shown(recwarn):
    said(small(FUNCTION), lambda x: np.log(-1 - x * x) + x)
    assert len(recwarn) == 0


def test_an_unknown_name_is_told(capsys):
    for name in ("no-such-exercise", None, ["a list"]):
        check(name, 1)
        assert capsys.readouterr().out.startswith("There is no exercise ")
