"""What others install: the wheel alone in an environment that holds nothing else,
and an sdist from which it can be built."""

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


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    return build_packages(tmp_path_factory.mktemp("dist"))


def test_the_packages_carry_the_version(packages):
    assert [path.name for path in packages] == [
        f"qclearn-{PROJECT['version']}.tar.gz",
        f"qclearn-{PROJECT['version']}-py3-none-any.whl",
    ]


def test_the_wheel_carries_the_browser_modules_of_the_book(packages):
    """A notebook downloaded from the site finds its explorables in the package."""
    with zipfile.ZipFile(packages[1]) as archive:
        carried = {Path(name).name for name in archive.namelist() if name.startswith("qcbook/browser/")}
    wanted = {path.name for path in MODULES.iterdir() if path.suffix in (".js", ".wasm", ".css")}
    assert "lab.js" in wanted and wanted <= carried


def test_the_wheel_carries_what_reports_are_made_of(packages):
    with zipfile.ZipFile(packages[1]) as archive:
        carried = {name for name in archive.namelist() if name.startswith("qclearn/reports/templates/")}
    wanted = {path.relative_to(ROOT).as_posix() for path in (ROOT / "qclearn" / "reports" / "templates").iterdir()}
    assert "qclearn/reports/templates/page.html" in wanted and wanted == carried


def test_the_wheel_registers_without_what_extras_bring(packages, tmp_path):
    """All that is hidden here stands in no core requirement: `qclearn` alone has to do."""
    project = PROJECT["optional-dependencies"]
    brought = set().union(*map(distributions, project.values())) - distributions(PROJECT["dependencies"])
    brought -= {"platformdirs"}  # which pyvista brings, too
    with zipfile.ZipFile(packages[1]) as archive:
        archive.extractall(tmp_path / "wheel")
    program = f"""import sys
sys.path.insert(0, "wheel")
sys.modules |= dict.fromkeys({sorted(brought)})
import qclearn as qc
moving = qc.mirror(qc.fsaverage5("right"))
found = qc.register(moving, qc.fsaverage5("left"), qc.demo_landmarks(), features=None).report
print("wheel" in qc.__file__, found["bijective"], found["landmark_error"] < found["landmark_error_before"] / 4)"""
    assert run_outside(sys.executable, "-c", program, cwd=tmp_path).split() == ["True"] * 3


@pytest.mark.slow
def test_the_wheel_runs_the_demo_in_a_bare_environment(packages, tmp_path):
    venv.create(tmp_path / "bare")
    bare = tmp_path / "bare" / ("Scripts" if os.name == "nt" else "bin")
    pip = sys.executable, "-m", "pip", "--python", bare / "python"
    run_outside(
        *pip,
        "install",
        "--quiet",
        "--no-compile",
        "--disable-pip-version-check",
        "-c",
        ROOT / "constraints.txt",
        packages[1],
        cwd=tmp_path,
    )
    installed = {row["name"].lower() for row in json.loads(run_outside(*pip, "list", "--format=json", cwd=tmp_path))}
    assert "qclearn" in installed and not installed & {
        "torch",
        "numba",
        "scikit-image",
        "distributed",
        "jupyterlab",
        "pytest",
    }
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
