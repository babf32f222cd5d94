"""The tables of the guide for teachers: two weeks, six weeks and a day, by minutes.

It says `:::{admonition} Table of weeks`, a line, and `:::`; the build and the copies put the table
there.
"""

import re
import tomllib
from functools import cache

import yaml

from .graded import EXERCISES, places
from .reading import minutes
from .references import BOOK, chapters, markdown_of

PLACE = places("Table of")


@cache
def plan():
    return tomllib.loads((BOOK / "teaching.toml").read_text(encoding="utf-8"))


def weeks():
    """(week, its pages, its exercises) of the plan, by the contents; a week begins at a page, or at
    the first page of a part."""
    listed, plans = list(chapters()), plan()["week"]
    parts = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))["parts"]
    first = {page: page for page in listed} | {part["caption"]: part["chapters"][0]["file"] for part in parts}
    names = [*(week["from"] for week in plans), plan()["end"]]
    if unknown := [name for name in names if name not in first]:
        raise SystemExit(f"teaching.toml: the contents have no page or part {unknown[0]!r}")
    starts = [listed.index(first[name]) for name in names]
    for week, start, end in zip(plans, starts, starts[1:]):
        pages = listed[start:end]
        own = [name for page in pages for name, exercise in EXERCISES.items() if exercise.page == page]
        if unknown := set(week["leave"]) - {*pages, *own}:
            raise SystemExit(f"teaching.toml, {week['title']!r}: nothing to leave out: {', '.join(sorted(unknown))}")
        kept = [page for page in pages if page not in week["leave"]]
        yield week, kept, [n for n in own if n not in week["leave"] and EXERCISES[n].page in kept]


@cache
def title(page):
    return re.search(r"^# (.+)$", markdown_of(page), re.MULTILINE)[1]


def link(page):
    if page not in chapters():
        raise SystemExit(f"teaching.toml: the contents have no page {page!r}")
    return f"[{title(page)}]({page}.{'md' if (BOOK / f'{page}.md').exists() else 'ipynb'})"


def row(*cells):
    return "| " + " | ".join(map(str, cells)) + " |"


def table(head, rows):
    return "\n".join(row(*cells) for cells in (head, ["---"] * len(head), *rows))


def spent(pages, exercises, together):
    """Minutes of reading, of exercises and in class."""
    return (
        sum(round(minutes(page)) for page in pages),
        sum(EXERCISES[name].minutes for name in exercises),
        sum(entry[0] for entry in together),
    )


def parameterize(pages, exercises, together):
    """A table of pages and exercises, the sum below it, and what is done in class."""
    rows = [
        [link(page), round(minutes(page)), ", ".join(told(name) for name in exercises if EXERCISES[name].page == page)]
        for page in pages
    ]
    reading, solving, meeting = spent(pages, exercises, together)
    rows.append(["in all", reading, f"{solving} minutes, {sum(EXERCISES[name].points for name in exercises)} points"])
    # A text says {page} where a link is to stand.
    linked = [(number, re.sub(r"\{(\w+)\}", lambda match: link(match[1]), text)) for number, text in together]
    done = [f"- {number} minutes. {text}" for number, text in linked]
    head = ["page", "minutes to read", "graded exercises (minutes)"]
    whole = divmod(reading + solving + meeting, 60)
    return "\n\n".join(
        [table(head, rows), "In class:", "\n".join(done), f"With the class this takes {whole[0]} h {whole[1]:02d} min."]
    )


def told(name):
    return f"`{name}` ({EXERCISES[name].minutes})"


def of_weeks():
    found = []
    for number, (week, pages, exercises) in enumerate(weeks(), 1):
        found += [f"### Week {number}: {week['title']}", parameterize(pages, exercises, week["class"])]
        if week["leave"]:
            found.append(f"For those who want more: {', '.join(map(left, week['leave']))}.")
    return "\n\n".join(found)


def left(name):
    return link(name) if name in chapters() else told(name)


def of_parts(name):
    """The tables of a plan whose parts name their pages; a title stands above those that have one."""
    found = []
    for own in plan()[name]:
        found += [f"### {own['title']}"] if "title" in own else []
        found.append(parameterize(own["pages"], own["exercises"], own["class"]))
    return "\n\n".join(found)


def put(text):
    """A page's text with its tables; KeyError for one that is not there."""
    return PLACE.sub(lambda match: of_weeks() if match[1] == "weeks" else of_parts(match[1]), text)
