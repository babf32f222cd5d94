"""The files that launch the book elsewhere say what pyproject.toml, constraints.txt and .ci/run
say: an environment of conda, a container for development, the workflow that tests and publishes."""

import json
import os
import re
import tomllib
from pathlib import Path

import yaml

from book.builder.build_book import SITE

ROOT = Path(__file__).resolve().parent.parent
CONDA, CONTAINER, WORKFLOW = ("environment.yml", ".devcontainer/devcontainer.json", ".github/workflows/book.yml")
CI, GUIDE = ".ci/run", "book/teaching.md"
INTERPRETER = "${containerWorkspaceFolder}/.venv/bin/python"
FILES = (CONDA, CONTAINER, WORKFLOW, "book/installation.md", "Makefile", "pyproject.toml", "constraints.txt", CI, GUIDE)
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in FILES}
INDEX = re.compile(r"https://download\.pytorch\.org/whl/\w+")


def environment(conda, index, extras):
    """What is wrong with conda's environment: Python and pip, and all else by pip as
    constraints.txt has it."""
    if conda["channels"] != ["conda-forge"]:
        yield f"{CONDA}: its channel is not conda-forge alone"
    *names, by_pip = conda["dependencies"]
    if [re.split("[<>=]", name)[0] for name in names] != ["python", "pip"]:
        yield f"{CONDA}: conda brings {', '.join(names)}, and not python and pip"
    lines = by_pip["pip"]
    extra = re.fullmatch(r"-e \.\[(\w+)\]", lines[-1])
    if not extra or extra[1] not in extras:
        yield f"{CONDA}: no '-e .[extra]' with an extra of pyproject.toml at the end"
    if lines[:-1] != [f"--extra-index-url {index}", "-c constraints.txt"]:
        yield f"{CONDA}: pip is not given the index of torch and constraints.txt, and nothing else"


def commands(line, targets):
    """What is wrong with a shell command: a program of .ci that cannot be run, a target that the
    Makefile lacks."""
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
    index = re.search(r"make book TORCH_INDEX=(\S+)", texts["Makefile"])[1]
    conda = yaml.safe_load(texts[CONDA])
    container, workflow = json.loads(texts[CONTAINER]), yaml.safe_load(texts[WORKFLOW])
    test, publish = workflow["jobs"]["test"], workflow["jobs"]["publish"]
    ran = [step["run"] for step in test["steps"] if "run" in step]
    (published,) = (step["with"]["path"] for step in test["steps"] if "path" in step.get("with", {}))
    targets = {*re.findall(r"^([\w-]+):|^INSTALLED := (\S+)", texts["Makefile"], re.MULTILINE)}
    targets = {name for pair in targets for name in pair}
    said = {
        "requires-python": project["requires-python"].removeprefix(">="),
        CONDA: str(conda["dependencies"][0]).removeprefix("python="),
        CONTAINER: re.search(r":(\d+\.\d+)-", container["image"])[1],
        WORKFLOW: re.search(r"^python:(\d+\.\d+)-", test["container"])[1],
    }
    yield from (
        f"{name} has Python {found}, constraints.txt {python}" for name, found in said.items() if found != python
    )
    yield from environment(conda, index, project["optional-dependencies"])
    yield from commands("\n".join([container["postCreateCommand"], *ran]), targets)
    if ran[-1] != ".ci/run":
        yield f"{WORKFLOW} does not end with .ci/run"
    if ROOT / published != SITE / "html" or publish["needs"] != "test":
        yield f"{WORKFLOW} publishes {published}, the build writes {(SITE / 'html').relative_to(ROOT)}"
    for name, given in ((CONTAINER, container["containerEnv"]), (WORKFLOW, workflow.get("env", {}))):
        if given.get("TORCH_INDEX") != index:
            yield f"{name}: TORCH_INDEX is not {index}"
    if container["customizations"]["vscode"]["settings"]["python.defaultInterpreterPath"] != INTERPRETER:
        yield f"{CONTAINER}: the interpreter is not {INTERPRETER}, as the Makefile has it"
    if "SOLUTIONS" in texts[WORKFLOW] + texts[CI]:
        yield f"{WORKFLOW}, {CI}: the site would show solutions"
    conditions = {publish["if"], *(step["if"] for step in test["steps"] if "if" in step)}
    if set(re.findall(r"refs/heads/(\w+)", " ".join(conditions))) | {*workflow[True]["push"]["branches"]} != {"main"}:
        yield f"{WORKFLOW}: not main alone is tested and published"
    if texts[CI].rstrip().splitlines()[-1] != "exec make test":
        yield f"{CI} does not end in make test"
    extra = re.escape(conda["dependencies"][-1]["pip"][-1].removeprefix("-e "))
    if not re.search(
        rf"pip download .*-c constraints\.txt --extra-index-url {re.escape(index)} '{extra}' uv", texts[GUIDE]
    ):
        yield f"{GUIDE}: the wheels to download are not those of {CONDA}"
    if not re.search(rf"pip install --no-index .*-c constraints\.txt -e '{extra}' uv", texts[GUIDE]):
        yield f"{GUIDE}: the wheels to install are not those of {CONDA}"
    if len(found := {index for text in texts.values() for index in INDEX.findall(text)}) != 1:
        yield f"more than one index of torch: {', '.join(sorted(found))}"
    pinned = {name: set(re.findall(r"torch(==[\w.+]+)", texts[name])) - {torch} for name in (*FILES[:4], "Makefile")}
    yield from (
        f"{name} has torch{', '.join(other)}, constraints.txt {torch}" for name, other in pinned.items() if other
    )


def test_launching_files_say_what_the_project_says():
    assert list(drifts(TEXTS)) == []


def test_a_drift_is_found():
    drifted = TEXTS | {CONDA: TEXTS[CONDA].replace("python=3.11", "python=3.12")}
    assert any("environment.yml has Python 3.12" in line for line in drifts(drifted))
