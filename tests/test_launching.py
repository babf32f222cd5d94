"""The files that launch the book elsewhere say what pyproject.toml, constraints.txt and .ci/run say: an environment of
conda, a container for development, the workflow that tests and publishes."""

import json
import os
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from build_book import SITE  # of tools

ROOT = Path(__file__).resolve().parent.parent
CONDA, CONTAINER, WORKFLOW = "environment.yml", ".devcontainer/devcontainer.json", ".github/workflows/book.yml"
FILES = (CONDA, CONTAINER, WORKFLOW, "README.md", "Makefile", "pyproject.toml", "constraints.txt")
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in FILES}
INDEX = re.compile(r"https://download\.pytorch\.org/whl/\w+")


def installed(lines, extras):
    """What is wrong with conda's lines for pip: one constraints file, one installation, of an extra that there is."""
    if "-c constraints.txt" not in lines:
        yield f"{CONDA}: pip is not held to constraints.txt"
    wanted = [re.fullmatch(r"-e \.\[(\w+)\]", line) for line in lines]
    if [match[1] in extras for match in wanted if match] != [True]:
        yield f"{CONDA}: no '-e .[extra]' with an extra of pyproject.toml"


def commands(line, targets):
    """What is wrong with a shell command: a program of .ci that cannot be run, a target that the Makefile lacks."""
    for program in re.findall(r"\.ci/\w+", line):
        if not os.access(ROOT / program, os.X_OK):
            yield f"{program} cannot be run"
    for target in re.findall(r"\bmake (\S+)", line):
        if target not in targets:
            yield f"no target {target} in the Makefile"


def drifts(texts):
    """What the launching files say otherwise than the project's own, as sentences."""
    project = tomllib.loads(texts["pyproject.toml"])["project"]
    python = re.search(r"on CPython (\d+\.\d+)", texts["constraints.txt"])[1]
    torch = re.search(r"^torch(==.+)$", texts["constraints.txt"], re.MULTILINE)[1]
    conda = yaml.safe_load(texts[CONDA])["dependencies"]
    container, workflow = json.loads(texts[CONTAINER]), yaml.safe_load(texts[WORKFLOW])
    test, publish = workflow["jobs"]["test"], workflow["jobs"]["publish"]
    ran = [step["run"] for step in test["steps"] if "run" in step]
    (published,) = (step["with"]["path"] for step in test["steps"] if "path" in step.get("with", {}))
    targets = {*re.findall(r"^([\w-]+):", texts["Makefile"], re.MULTILINE), ".venv/installed"}
    said = {
        "requires-python": project["requires-python"].removeprefix(">="),
        CONDA: next(entry for entry in conda if str(entry).startswith("python=")).removeprefix("python="),
        CONTAINER: re.search(r":(\d+\.\d+)-", container["image"])[1],
        WORKFLOW: re.search(r"^python:(\d+\.\d+)-", test["container"])[1],
    }
    yield from (
        f"{name} has Python {found}, constraints.txt {python}" for name, found in said.items() if found != python
    )
    yield from installed(conda[-1]["pip"], project["optional-dependencies"])
    yield from commands("\n".join([container["postCreateCommand"], *ran]), targets)
    if ran[-1] != ".ci/run":
        yield f"{WORKFLOW} does not end with .ci/run"
    if ROOT / published != SITE / "html" or publish["needs"] != "test":
        yield f"{WORKFLOW} publishes {published}, the build writes {(SITE / 'html').relative_to(ROOT)}"
    if len(found := {index for text in texts.values() for index in INDEX.findall(text)}) != 1:
        yield f"more than one index of torch: {', '.join(sorted(found))}"
    pinned = {name: set(re.findall(r"torch(==[\w.+]+)", texts[name])) - {torch} for name in (*FILES[:4], "Makefile")}
    yield from (
        f"{name} has torch{', '.join(other)}, constraints.txt {torch}" for name, other in pinned.items() if other
    )


def test_launching_files_say_what_the_project_says():
    assert list(drifts(TEXTS)) == []


@pytest.mark.parametrize(
    "file, old, new, told",
    [
        (CONDA, "python=3.11", "python=3.12", "environment.yml has Python 3.12"),
        (CONDA, "- -c constraints.txt", "- tqdm", "pip is not held to constraints.txt"),
        (CONDA, ".[test]", ".[tests]", "no '-e .[extra]'"),
        (CONTAINER, "python:3.11-", "python:3.13-", "devcontainer.json has Python 3.13"),
        (CONTAINER, "make .venv/installed", "make install", "no target install in the Makefile"),
        (CONTAINER, "sudo .ci/packages", "sudo .ci/debian", ".ci/debian cannot be run"),
        (CONTAINER, "whl/cpu", "whl/cu130", "more than one index of torch"),
        (WORKFLOW, "python:3.11-", "python:3.12-", "book.yml has Python 3.12"),
        (WORKFLOW, "run: .ci/run", "run: make test", "does not end with .ci/run"),
        (WORKFLOW, "path: _build/html", "path: _build", "publishes _build, the build writes _build/html"),
        ("README.md", "torch==", "torch==1.", "README.md has torch==1."),
        ("constraints.txt", "CPython 3.11", "CPython 3.12", "requires-python has Python 3.11"),
    ],
)
def test_a_drift_is_found(file, old, new, told):
    assert old in TEXTS[file]
    assert any(told in line for line in drifts(TEXTS | {file: TEXTS[file].replace(old, new)}))
