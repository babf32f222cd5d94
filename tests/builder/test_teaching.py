"""What the guide for teachers lays out is there, fits its weeks, and the recipes name what exists."""

import copy
import re
import tomllib

import nbformat
import pytest

from book.builder import execute_pages, references, teaching
from book.builder.core import CORE
from book.builder.graded import EXERCISES
from book.builder.reading import minutes_of_text

ROOT = references.BOOK.parent
GUIDE = references.markdown_of("teaching")


SHORT = [*teaching.plan()["two-weeks"], *teaching.plan()["the-day"]]


def test_the_weeks_and_the_day_fit_and_have_pages_exercises_and_work_in_class():
    weeks, most = list(teaching.weeks()), 60 * teaching.plan()["hours"]
    taken = {week["title"]: teaching.spent(pages, names, week["class"]) for week, pages, names in weeks}
    taken |= {part["pages"][-1]: teaching.spent(part["pages"], part["exercises"], part["class"]) for part in SHORT}
    assert {title: sum(parts) for title, parts in taken.items() if sum(parts) > most} == {}
    assert len(weeks) == 6 and all(pages and names and week["class"] for week, pages, names in weeks)
    assert {name for week, _, names in weeks for name in (*names, *week["leave"])} >= set(EXERCISES)
    for part in SHORT:
        assert {EXERCISES[name].page for name in part["exercises"]} <= set(part["pages"]) <= set(references.chapters())


def test_a_class_works_on_the_pages_of_its_week_and_meets_the_core_path():
    weeks = [(week, pages) for week, pages, _ in teaching.weeks()]
    for part, pages in weeks + [(part, part["pages"]) for part in SHORT]:
        for _, text in part["class"]:
            assert set(re.findall(r"\{(\w+)\}", text)) <= set(pages), text
    kept = [page for _, pages in weeks for page in pages]
    assert set(CORE) <= set(kept)


@pytest.mark.parametrize("key, value", [("from", "nowhere"), ("leave", ["nothing"]), ("class", [[5, "On {nowhere}."]])])
def test_a_name_that_is_not_there_stops_the_build(monkeypatch, key, value):
    plan = copy.deepcopy(teaching.plan())
    plan["week"][0][key] = value
    monkeypatch.setattr(teaching, "plan", lambda: plan)
    with pytest.raises(SystemExit, match=r"teaching\.toml"):
        teaching.of_weeks()


def test_the_tables_stand_in_the_pages():
    shown = teaching.put(GUIDE)
    assert teaching.PLACE.findall(GUIDE) == ["two-weeks", "weeks", "the-day"] and not teaching.PLACE.search(shown)
    assert "### Week 6: " in shown and "`alpha-signs` (15)" in shown
    assert "[The Linear Beltrami Solver](lbs.ipynb)" in shown
    assert teaching.put("Table of weeks") == "Table of weeks"


def test_the_executed_book_has_the_tables(tmp_path, monkeypatch):
    monkeypatch.setattr(execute_pages, "SOURCE", tmp_path)
    execute_pages.copy_book()
    text = (tmp_path / "teaching.md").read_text(encoding="utf-8")
    assert "### Week 1: " in text and "Table of" not in text


def test_a_page_is_read_at_the_pace_of_its_parts():
    assert minutes_of_text("word " * 150) == pytest.approx(1)
    assert minutes_of_text("$$\nx = 1\n$$ (eq-x)\n\nand\n\n$$y$$") == pytest.approx(2 / 0.67 + 1 / 150)
    assert minutes_of_text("```python\na\nb\nc\nd\ne\n```") == pytest.approx(1)
    folded = ":::{admonition} Answers\n:class: dropdown\nMany words.\n:::\n\n:::{solution} ex-x\nMore.\n:::"
    assert minutes_of_text(folded) == 0


def test_the_recipe_without_internet_brings_what_the_build_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (download,) = re.findall(r"pip download (.+)", GUIDE)
    assert all(f"'{need}'" in download for need in project["build-system"]["requires"])
    assert "-c constraints.txt" in download and "'.[test]' uv" in download
    assert GUIDE.count("touch .venv/installed") == 1  # the stamp of the Makefile
    assert "INSTALLED := .venv/installed" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_each_project_has_a_first_cell_and_its_parts():
    cells = nbformat.read(references.BOOK / "projects.ipynb", as_version=4).cells
    text = "\n\n".join(cell.source if cell.cell_type == "markdown" else "CODE" for cell in cells)
    projects = [part for part in re.split(r"^## ", text, flags=re.MULTILINE) if "**Question.**" in part]
    assert len(projects) == 6
    heads = "**Question.**", "CODE", "**First steps.**", "**Milestones.**", "**A good"
    for part in projects:
        order = [part.index(word) for word in heads]
        assert order == sorted(order), part[:40]
    points = [int(n) for n in re.findall(r"\| (\d+) \|$", text.split("## Marking")[1], re.MULTILINE)]
    assert sum(points) == 20
