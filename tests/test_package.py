"""What others install: the wheel alone in an environment that holds nothing else,
and an sdist from which it can be built."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
BUILD = "import sys; from setuptools.build_meta import build_sdist, build_wheel; build_{}(sys.argv[1])"


def run(*words, cwd):
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONPATH"
    }  # this checkout may not help
    ran = subprocess.run(
        [str(word) for word in words], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stdout[-1000:] + ran.stderr[-3000:]
    return ran.stdout


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """The sdist, built from a copy of this tree, and the wheel, built from the sdist: (sdist, wheel)."""
    source, out = tmp_path_factory.mktemp("source") / "tree", tmp_path_factory.mktemp("dist")
    ignored = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "_build", "book", "dist")
    shutil.copytree(ROOT, source, ignore=ignored)
    run(sys.executable, "-c", BUILD.format("sdist"), out, cwd=source)
    (sdist,) = out.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        archive.extractall(out, filter="data")
    run(sys.executable, "-c", BUILD.format("wheel"), out, cwd=out / sdist.name.removesuffix(".tar.gz"))
    (wheel,) = out.glob("*.whl")
    return sdist, wheel


def test_the_packages_carry_the_version(packages):
    assert [path.name for path in packages] == [
        f"qclearn-{PROJECT['version']}.tar.gz",
        f"qclearn-{PROJECT['version']}-py3-none-any.whl",
    ]


def test_the_wheel_runs_the_demo_in_a_bare_environment(packages, tmp_path):
    venv.create(tmp_path / "bare", with_pip=True)
    bare = tmp_path / "bare" / ("Scripts" if os.name == "nt" else "bin")
    run(
        bare / "python",
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-compile",
        "--disable-pip-version-check",
        "-c",
        ROOT / "constraints.txt",
        packages[1],
        cwd=tmp_path,
    )
    installed = {
        row["name"].lower()
        for row in json.loads(run(bare / "python", "-m", "pip", "list", "--format=json", cwd=tmp_path))
    }
    assert "qclearn" in installed and not installed & {
        "torch",
        "numba",
        "scikit-image",
        "distributed",
        "jupyterlab",
        "pytest",
    }
    run(bare / "qclearn", "demo", cwd=tmp_path)
    report = json.loads((tmp_path / "qclearn-demo" / "report.json").read_text(encoding="utf-8"))
    assert report["bijective"] and report["version"] == PROJECT["version"]
    assert report["landmark_error"] < report["landmark_error_before"] / 10


def test_the_version_stands_in_one_place_and_heads_the_changelog():
    (release,) = re.findall(r"\A# Changes\n+## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert release in ("unreleased", PROJECT["version"])
    others = ["CITATION.cff", "README.md", "_config.yml", *(str(path) for path in (ROOT / "qclearn").glob("*.py"))]
    assert [name for name in others if PROJECT["version"] in (ROOT / name).read_text(encoding="utf-8")] == []
