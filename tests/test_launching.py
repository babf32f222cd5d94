"""The files that launch the book elsewhere say what pyproject.toml, constraints.txt and .ci/run say."""

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
FILES = (CONDA, CONTAINER, WORKFLOW, "book/installation.md", "Makefile", "pyproject.toml", "constraints.txt", CI, GUIDE)
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in FILES}


def drifts(texts):
    """What the launching files say otherwise than the project's own: name -> (said, wanted)."""
    project = tomllib.loads(texts["pyproject.toml"])["project"]
    python = re.search(r"on CPython (\d+\.\d+)", texts["constraints.txt"])[1]
    torch = re.search(r"^torch(==.+)$", texts["constraints.txt"], re.MULTILINE)[1]
    index = re.search(r"make book TORCH_INDEX=(\S+)", texts["Makefile"])[1]
    conda = yaml.safe_load(texts[CONDA])
    container, workflow = json.loads(texts[CONTAINER]), yaml.safe_load(texts[WORKFLOW])
    test, publish = workflow["jobs"]["test"], workflow["jobs"]["publish"]
    ran = [step["run"] for step in test["steps"] if "run" in step]
    commands = "\n".join([container["postCreateCommand"], *ran])
    conditions = " ".join({publish["if"], *(step["if"] for step in test["steps"] if "if" in step)})
    *others, by_pip = conda["dependencies"]
    extra = by_pip["pip"][-1].removeprefix("-e ")
    made = {
        name for pair in re.findall(r"^([\w-]+):|^INSTALLED := (\S+)", texts["Makefile"], re.MULTILINE) for name in pair
    }
    wheels = rf"-c constraints\.txt --extra-index-url {re.escape(index)} '{re.escape(extra)}' uv"
    settings = container["customizations"]["vscode"]["settings"]
    facts = {
        "requires-python": (project["requires-python"], f">={python}"),
        "conda": (conda["channels"], ["conda-forge"]),
        "conda's packages": (others, [f"python={python}", "pip"]),
        "conda's pip": (by_pip["pip"][:-1], [f"--extra-index-url {index}", "-c constraints.txt"]),
        "conda's extra": (extra.strip(".[]") in project["optional-dependencies"], True),
        "container's Python": (re.search(r":(\d+\.\d+)-", container["image"])[1], python),
        "container's index": (container["containerEnv"].get("TORCH_INDEX"), index),
        "container's interpreter": (settings["python.defaultInterpreterPath"][-17:], "/.venv/bin/python"),
        "workflow's Python": (re.search(r"^python:(\d+\.\d+)-", test["container"])[1], python),
        "workflow's index": (workflow.get("env", {}).get("TORCH_INDEX"), index),
        "workflow's last step": (ran[-1], ".ci/run"),
        "published": ([step["with"]["path"] for step in test["steps"] if "path" in step.get("with", {})],
                      [str((SITE / "html").relative_to(ROOT))]),
        "publishes after": (publish["needs"], "test"),
        "branches": ({*re.findall(r"refs/heads/(\w+)", conditions), *workflow[True]["push"]["branches"]}, {"main"}),
        "solutions": ("SOLUTIONS" in texts[WORKFLOW] + texts[CI], False),
        ".ci/run's end": (texts[CI].rstrip().splitlines()[-1], "exec make test"),
        "programs": ([one for one in re.findall(r"\.ci/\w+", commands) if not os.access(ROOT / one, os.X_OK)], []),
        "targets": ({*re.findall(r"\bmake (\S+)", commands)} - made, set()),
        "wheels to download": (bool(re.search(f"pip download .*{wheels}", texts[GUIDE])), True),
        "wheels to install": (f"-c constraints.txt -e '{extra}' uv" in texts[GUIDE], True),
        "indices": ({*re.findall(r"https://download\.pytorch\.org/whl/\w+", "".join(texts.values()))}, {index}),
        "torch": ({*re.findall(r"torch(==[\w.+]+)", "".join(map(texts.get, (*FILES[:4], "Makefile"))))}, {torch}),
    }  # fmt: skip
    return {name: pair for name, pair in facts.items() if pair[0] != pair[1]}


def test_launching_files_say_what_the_project_says():
    assert drifts(TEXTS) == {}


def test_a_drift_is_found():
    other = TEXTS | {WORKFLOW: TEXTS[WORKFLOW].replace("run: .ci/run", "run: make test")}
    assert drifts(other) == {"workflow's last step": ("make test", ".ci/run")}
