"""What others install: the wheel alone in an environment that holds nothing else, and an sdist that makes it."""

import json
import os
import re
import sys
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest

from book.builder.packages import build_packages, run_outside
from qcbook.live import MODULES
from test_imports import distributions

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NUMBER = re.compile(r"\d+\.\d+")


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    return build_packages(tmp_path_factory.mktemp("dist"))


def test_the_packages_carry_the_version(packages):
    name = f"qclearn-{PROJECT['version']}"
    assert [path.name for path in packages] == [f"{name}.tar.gz", f"{name}-py3-none-any.whl"]


def test_the_wheel_carries_what_explorables_and_reports_are_made_of(packages):
    with zipfile.ZipFile(packages[1]) as archive:
        carried = set(archive.namelist())
    modules = {f"qcbook/browser/{path.name}" for path in MODULES.iterdir() if path.suffix in (".js", ".wasm", ".css")}
    wanted = {path.relative_to(ROOT).as_posix() for path in (ROOT / "qclearn" / "reports" / "templates").iterdir()}
    assert {"qcbook/browser/lab.js", "qclearn/reports/templates/page.html"} < modules | wanted <= carried


def test_the_wheel_runs_the_readmes_example_as_printed_without_what_extras_bring(packages, tmp_path):
    """All that is hidden here stands in no core requirement: `qclearn` alone has to do."""
    project, readme = PROJECT["optional-dependencies"], (ROOT / "README.md").read_text(encoding="utf-8")
    brought = set().union(*map(distributions, project.values())) - distributions(PROJECT["dependencies"])
    brought -= {"platformdirs"}  # which pyvista brings, too
    with zipfile.ZipFile(packages[1]) as archive:
        archive.extractall(tmp_path / "wheel")
    hidden = f"import sys\nsys.path.insert(0, 'wheel')\nsys.modules |= dict.fromkeys({sorted(brought)})\n"
    hidden += "import qclearn.cli\n"
    (example,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    (printed,) = re.findall(r"It prints\n\n```text\n(.*?)```", readme, re.DOTALL)
    found = run_outside(sys.executable, "-c", f"{hidden}{example}\nassert 'wheel' in qc.__file__", cwd=tmp_path)
    assert NUMBER.split(found) == NUMBER.split(printed) and "bijective: True" in found
    assert [*map(float, NUMBER.findall(found))] == pytest.approx([*map(float, NUMBER.findall(printed))], abs=0.11)
    before, after = map(float, re.search(r"landmark error ([\d.]+) -> ([\d.]+)", found).groups())
    assert 0 < after < before / 4
    assert (tmp_path / "registered.ply").stat().st_size > 0


@pytest.mark.slow
def test_the_wheel_runs_the_demo_in_a_bare_environment(packages, tmp_path):
    venv.create(tmp_path / "bare")
    bare = tmp_path / "bare" / ("Scripts" if os.name == "nt" else "bin")
    pip = sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", bare / "python"
    wanted = "-c", ROOT / "constraints.txt", packages[1]
    run_outside(*pip, "install", "--quiet", "--no-compile", *wanted, cwd=tmp_path)
    installed = {row["name"].lower() for row in json.loads(run_outside(*pip, "list", "--format=json", cwd=tmp_path))}
    brought = {"torch", "numba", "scikit-image", "distributed", "jupyterlab", "pytest"}
    assert "qclearn" in installed and not installed & brought
    run_outside(bare / "qclearn", "demo", cwd=tmp_path)
    report = json.loads((tmp_path / "qclearn-demo" / "report.json").read_text(encoding="utf-8"))
    assert report["bijective"] and report["version"] == PROJECT["version"]
    assert report["landmark_error"] < report["landmark_error_before"] / 4
    assert all(after < before for before, after in report["held_out_mm"].values())


def test_the_version_stands_in_one_place_and_heads_the_changelog():
    (release,) = re.findall(r"\A# Changes\n+## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert release in ("unreleased", PROJECT["version"])
    others = ["CITATION.cff", "README.md", "_config.yml", *(str(path) for path in (ROOT / "qclearn").glob("*.py"))]
    assert [name for name in others if PROJECT["version"] in (ROOT / name).read_text(encoding="utf-8")] == []
