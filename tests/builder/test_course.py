"""Products of one source: the page, nbgrader's assignment and its release to students, the teacher's notebook."""

import copy
import re
from types import SimpleNamespace

import nbformat
import pytest
from nbformat.v4 import new_markdown_cell, new_notebook

from book.builder import course, execute_pages, graded, references, solutions
from book.builder.graded import EXERCISES, put
from leaks import drift, graded_lines, leaks, of

NAME = "alpha-signs"
PAGE = f"# Here\n\n{graded.place(NAME)}\n\nMore."


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """(student's, teacher's, nbgrader's) notebook of all exercises, as files."""
    folder = tmp_path_factory.mktemp("course")
    source, teacher = course.write(course.in_order(), "exercises", folder)
    (student,) = course.release("exercises", folder)
    return student, teacher, source


@pytest.fixture(scope="module")
def notebooks(written):
    return [nbformat.read(path, as_version=4) for path in written]


def test_the_students_notebook_has_a_blank_and_a_check_for_each_exercise(notebooks):
    student = notebooks[0]
    assert [cell.metadata["exercise"] for cell in of(student, "answer")] == course.in_order()
    assert [cell.source for cell in of(student, "check")] == [graded.call(EXERCISES[n]) for n in course.in_order()]
    assert [cell.source for cell in of(student, "answer")] == [EXERCISES[n].blank.strip() for n in course.in_order()]
    assert {cell.source for cell in of(student, "sentence")} == {"*Your answer here.*"}
    assert [role for cell in of(student, "question") for role in re.findall(r"\{[\w:]+\}`|\]\(#", cell.source)] == []


def test_the_students_notebook_carries_what_nbgrader_keeps(notebooks):
    kept = [cell.metadata.nbgrader for cell in notebooks[0].cells if "nbgrader" in cell.metadata]
    assert len({each.grade_id for each in kept}) == len(kept) >= 2 * len(EXERCISES)
    keys = {"schema_version", "grade", "solution", "locked", "task", "cell_type", "grade_id", "checksum"}
    for each in kept:
        assert set(each) == keys | ({"points"} if each.grade else set()) and each.schema_version == 3
    assert sum(each.get("points", 0) for each in kept) == sum(e.points for e in EXERCISES.values())


def test_nbgraders_notebook_is_its_source(notebooks):
    """The student's cells, but solutions between marks, and hidden tests on other numbers, which raise."""
    student, _, nbgraders = notebooks
    assert [cell.id for cell in nbgraders.cells] == [cell.id for cell in student.cells]
    assert [cell.source for cell in of(nbgraders, "question")] == [cell.source for cell in of(student, "question")]
    assert [cell.source + "\n" for cell in of(nbgraders, "answer")] == [EXERCISES[n].source for n in course.in_order()]
    for check in of(nbgraders, "check"):
        exercise = EXERCISES[check.metadata.exercise]
        shown, tests = check.source.split("\n### BEGIN HIDDEN TESTS\n")
        assert shown == graded.call(exercise) and "seed=1)" in tests and tests.endswith("\n### END HIDDEN TESTS")
        exec(tests, {exercise.asks_for: exercise.solution})
        name, answer = next(iter(exercise.wrong.items()))
        with pytest.raises(AssertionError) as told:
            exec(tests, {exercise.asks_for: answer})
        assert str(told.value).startswith(exercise.sentences[name])


def test_the_teachers_notebook_has_solutions_mistakes_and_points(notebooks):
    teacher = notebooks[1]
    text = "\n".join(cell.source for cell in teacher.cells)
    assert [cell.source + "\n" for cell in of(teacher, "answer")] == [EXERCISES[n].solved for n in course.in_order()]
    assert all(f"| {name.replace('|', chr(92) + '|')} |" in text for e in EXERCISES.values() for name in e.wrong)
    assert f"| {sum(e.points for e in EXERCISES.values())} |" in text


def test_no_solution_leaks_into_the_students_notebook(written):
    assert all(graded_lines().values()) and leaks(written[:1], graded_lines()) == {}
    assert list(leaks(written[1:2], graded_lines())) == [str(written[1])]


def test_page_and_notebook_have_the_same_words_and_blank(notebooks):
    page = new_notebook(cells=[new_markdown_cell(course.in_words(put(PAGE)))])
    assert list(drift(page, notebooks[0])) == []


def test_the_build_runs_the_solution_and_shows_none(monkeypatch):
    monkeypatch.setattr(solutions, "SHOWN", False)
    notebook = new_notebook(cells=[new_markdown_cell(PAGE)])
    assert execute_pages.prepare(notebook) == []
    (cell,) = (cell for cell in notebook.cells if solutions.TAG in cell.metadata.get("tags", []))
    assert EXERCISES[NAME].solved in cell.source and graded.call(EXERCISES[NAME]) in cell.source
    assert "right, " in cell.metadata["prints"]
    executed = copy.deepcopy(notebook)
    executed.cells = [each for each in executed.cells if each.cell_type == "markdown"]
    for shown in (False, True):
        monkeypatch.setattr(solutions, "SHOWN", shown)
        monkeypatch.setattr(execute_pages, "expressions", SimpleNamespace(store=lambda notebook: []))
        page = copy.deepcopy(executed)
        assert execute_pages.finish(page) == []
        assert "{exercise} " + EXERCISES[NAME].title in page.cells[0].source
        assert ("{solution}" in page.cells[0].source) == shown
        assert [line for line in graded_lines()[NAME] if (line in page.cells[0].source) != shown] == []


def test_a_page_that_names_no_exercise_stops_the_build():
    page = new_notebook(cells=[new_markdown_cell(graded.place("no-such"))])
    (line,) = execute_pages.prepare(page)
    assert "no-such" in line and "book/qcbook/exercises/tasks has" in line


def test_no_page_shows_a_line_of_a_solution_by_chance():
    assert leaks([path for path in references.BOOK.iterdir() if path.suffix in (".ipynb", ".md")], graded_lines()) == {}


def test_an_exercise_stands_on_its_own_page_once():
    pages = {path.stem: nbformat.read(path, as_version=4).cells for path in references.BOOK.glob("*.ipynb")}
    sources = [(page, cell.source) for page, cells in pages.items() for cell in cells]
    placed = [(name, page) for page, source in sources for name in graded.PLACE.findall(source)]
    assert sorted(placed) == sorted((name, exercise.page) for name, exercise in EXERCISES.items())


def test_every_week_has_a_sheet(monkeypatch):
    written = {}
    monkeypatch.setattr(course, "write", lambda names, name, **_: written.update({name: names}))
    monkeypatch.setattr(course, "release", lambda name: written.update(released=name) or [])
    monkeypatch.setattr("sys.argv", ["course"])
    course.main()
    assert written.pop("released") == "*"
    assert list(written) == ["exercises", *(f"week{number}" for number in range(1, 7))]
    assert "alpha-signs" in written["week2"] and set(written["exercises"]) == set(EXERCISES)
