"""Imports point one way, as the contracts in pyproject.toml say; an extra requires what is imported for it."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = "qclearn", "data_synth", "qcbook"


def lint(folder, *more):
    """What lint-imports says of the packages in a folder."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--config", folder / "pyproject.toml"]
    paths = f"{folder}:{folder / 'book'}"
    return subprocess.run(command, cwd=folder, env={"PYTHONPATH": paths}, capture_output=True, text=True, check=False)


def test_imports_point_one_way():
    told = lint(ROOT)
    assert told.returncode == 0, told.stdout


def test_an_import_that_points_back_is_found(tmp_path):
    for package in ("qclearn", "data_synth", "book/qcbook", "book/builder", "book/studies"):
        code = shutil.ignore_patterns("*.json", "*.safetensors", "browser", "__pycache__")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=code)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    with open(tmp_path / "qclearn" / "plane" / "disk.py", "a", encoding="utf-8") as file:
        file.write("\n\ndef draw():\n    import qcbook\n    from .. import plot\n")
    told = lint(tmp_path)
    assert told.returncode == 1
    assert "qclearn.plane.disk -> qcbook" in told.stdout and "qclearn.plane.disk -> qclearn.plot" in told.stdout


def test_importing_the_library_loads_nothing_and_its_names_no_network_and_no_picture():
    """Time would depend on the machine: 800 modules take under half a second, scipy.optimize alone has a hundred."""
    heavy = ["torch", "matplotlib", "ipywidgets", "pyvista", "nilearn"]
    heavy += [f"scipy.{part}" for part in ("optimize", "spatial", "ndimage")]
    program = (
        "import sys, qclearn; print('numpy' in sys.modules)\n"
        "for name in qclearn.__all__: getattr(qclearn, name)\n"
        f"print([name for name in {heavy} if name in sys.modules], len(sys.modules) < 800)"
    )
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert loaded.stdout.split("\n", 1) == ["False", "[] True\n"]


# A distribution -> what it is imported as, where the two differ.
IMPORTED_AS = {"scikit-image": "skimage", "cat-surf": "cat_surf", "lazy-loader": "lazy_loader"}
# Come with another package: with pyvista, two with distributed, and with matplotlib.
BROUGHT = {"vtkmodules", "dask", "cloudpickle", "PIL"}
# Needed without an import: fsaverage5's files, and the loop over a cohort.
UNIMPORTED = {"nilearn", "joblib"}


@pytest.fixture(scope="module")
def graph():
    return grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)


def distributions(requirements):
    """What requirements of pyproject.toml are imported as, without other extras of qclearn."""
    names = {re.match(r"[\w-]+", text)[0] for text in requirements}
    return {IMPORTED_AS.get(name, name) for name in names - {"qclearn"}}


def libraries(graph, package, without=()):
    """What a package imports from outside the standard library and this project."""
    left_out = {module for name in without for module in graph.find_descendants(name) | {name}}
    modules = (graph.find_descendants(package) | {package}) - left_out
    names = {name.split(".")[0] for module in modules for name in graph.find_modules_directly_imported_by(module)}
    return names - set(sys.stdlib_module_names) - set(PACKAGES) - BROUGHT


def test_the_core_and_each_extra_require_what_they_import(graph):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = {name: distributions(texts) for name, texts in project["optional-dependencies"].items()}
    core = distributions(project["dependencies"])
    of_extras = ["qclearn.nets", "qclearn.benchmark"]
    found = libraries(graph, "qclearn", without=of_extras)
    assert found - required["fast"] == core - UNIMPORTED and required["fast"] < found
    assert required["peers"] == {"cat_surf"}
    assert libraries(graph, "data_synth", without=["data_synth.datasets"]) - core == required["synth"]
    assert libraries(graph, "qclearn.nets") - core == required["nets"]
    assert libraries(graph, "qclearn.benchmark") - core == required["benchmark"]
    assert "cat_surf" not in graph.modules  # under another licence
