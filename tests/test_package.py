"""What others install: the wheel alone in an environment that holds nothing else,
and an sdist from which it can be built."""

import json
import re
import sys
import tomllib
import venv
import zipfile
from email import message_from_bytes
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packages import build_packages, run_outside  # of tools
from packaging.requirements import Requirement

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


def asked_by(wheel):
    """The requirements that a wheel's metadata list."""
    with zipfile.ZipFile(wheel) as archive:
        (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return message_from_bytes(archive.read(metadata)).get_all("Requires-Dist")


def needed(requirements):
    """The distributions installed here that requirements ask for, and those that these ask for in turn, whatever
    extras they name included; {(name, extra): distribution}."""
    waiting, found = [(line, "") for line in requirements], {}
    while waiting:
        line, extra = waiting.pop()
        requirement = Requirement(line)
        if requirement.marker and not requirement.marker.evaluate({"extra": extra}):
            continue
        for asked in {(requirement.name, wanted) for wanted in ("", *requirement.extras)} - set(found):
            found[asked] = distribution(requirement.name)
            assert found[asked].version in requirement.specifier, line
            waiting += [(line, asked[1]) for line in found[asked].requires or ()]
    return found


def lend(distributions, folder):
    """Links in a folder to all that belongs to distributions that are installed here."""
    for lent in distributions:
        for top in {file.parts[0] for file in lent.files} - {"..", "__pycache__"}:
            if not (folder / top).exists():
                (folder / top).symlink_to(lent.locate_file(top))


def test_the_wheel_runs_the_demo_in_a_bare_environment(packages, tmp_path):
    """The wheel, and of what is installed here only what its own list asks for."""
    bare = tmp_path / "bare"
    venv.create(bare, with_pip=False)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--python", bare / "bin" / "python")
    run_outside(*pip, "install", "--quiet", "--no-index", "--no-deps", packages[1], cwd=tmp_path)
    (site,) = bare.glob("lib/python*/site-packages")
    lend(needed(asked_by(packages[1])).values(), site)
    installed = {row["name"].lower() for row in json.loads(run_outside(*pip, "list", "--format=json", cwd=tmp_path))}
    assert {"qclearn", "numpy", "pyvista"} <= installed
    assert not installed & {"torch", "numba", "scikit-image", "distributed", "jupyterlab", "pytest"}
    run_outside(bare / "bin" / "qclearn", "demo", cwd=tmp_path)
    report = json.loads((tmp_path / "qclearn-demo" / "report.json").read_text(encoding="utf-8"))
    assert report["bijective"] and report["version"] == PROJECT["version"]
    assert report["landmark_error"] < report["landmark_error_before"] / 10


def test_the_version_stands_in_one_place_and_heads_the_changelog():
    (release,) = re.findall(r"\A# Changes\n+## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert release in ("unreleased", PROJECT["version"])
    others = ["CITATION.cff", "README.md", "_config.yml", *(str(path) for path in (ROOT / "qclearn").glob("*.py"))]
    assert [name for name in others if PROJECT["version"] in (ROOT / name).read_text(encoding="utf-8")] == []
