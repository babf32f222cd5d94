"""Who may import whom: geometry knows nothing of networks, pictures and widgets; the arrows point one way."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("qclearn", "data_synth")
# Every module of qclearn that is not named here is geometry.
NETWORKS = {"qclearn.nets"}
LEAVES = {"qclearn.plot", "qclearn.canvas", "qclearn.diagrams", "qclearn.widgets", "qclearn.scenes", "qclearn.pages"}
BENCHMARK = {"qclearn.benchmark", "qclearn.problems", "qclearn.trial"}
TOP = {"qclearn.cli", "qclearn.training", *BENCHMARK, "qclearn.__main__", "qclearn"}
REGISTER = {"qclearn.register"}
# Modules that call networks, and load them only then.
CALLERS = {*REGISTER, "qclearn.methods.networks"}
# The data that the networks are trained on are torch datasets.
DATASETS = {"data_synth.datasets"}
LEARNING = {"torch", "safetensors", "onnx", "onnxruntime"}
SHOWING = {"matplotlib", "ipywidgets", "IPython", "click"}


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_of(path):
    """Pairs (imported module, whether at the top of the file), relative names resolved."""
    package = path.relative_to(ROOT).parent.parts
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            names = [".".join(base), *(".".join([*base, alias.name]) for alias in node.names)]
        else:
            continue
        yield from ((name, node in tree.body) for name in names)


def belongs(name, group):
    return any(name == member or name.startswith(member + ".") for member in group)


def forbidden(module, name, at_top):
    """Why `module` may not import `name`; None if it may."""
    own = name.split(".")[0] in PACKAGES
    synthetic, top = module.startswith("data_synth"), module in TOP
    if name.startswith("data_synth") and not synthetic and not (top and module != "qclearn"):
        return "only the command line and the benchmark bring data_synth and qclearn together"
    if top:
        return "import qclearn stays light" if module == "qclearn" and belongs(name, LEAVES | NETWORKS) else None
    if belongs(name, LEAVES) and module not in LEAVES:
        return "plot, diagrams, widgets, scenes and pages are leaves"
    if belongs(name, {"qclearn.cli", "qclearn.training", *BENCHMARK}):
        return "nothing stands above the command line and the benchmark"
    if belongs(name, REGISTER) and not synthetic and module not in LEAVES:
        return "register stands above the geometry"
    if belongs(module, NETWORKS):
        return "networks show nothing" if not own and belongs(name, SHOWING) else None
    if belongs(name, NETWORKS):
        return None if (module in CALLERS and not at_top) or module in LEAVES else "geometry knows no networks"
    if not own and belongs(name, LEARNING) and module not in DATASETS:
        return "geometry is NumPy and SciPy"
    if not own and belongs(name, SHOWING) and module not in LEAVES:
        return "geometry shows nothing"
    return None


@pytest.mark.parametrize(
    "path", [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))], ids=module_of
)
def test_imports_point_one_way(path):
    module = module_of(path)
    found = {name: forbidden(module, name, at_top) for name, at_top in imports_of(path)}
    assert {name: reason for name, reason in found.items() if reason} == {}


@pytest.mark.parametrize(
    "module, name, at_top",
    [
        ("qclearn.disk", "torch", True),
        ("qclearn.disk", "qclearn.plot", False),
        ("qclearn.fit", "qclearn.register", True),
        ("qclearn.register", "qclearn.nets", True),
        ("qclearn.fourier", "data_synth", True),
        ("qclearn", "qclearn.nets", True),
        ("data_synth.cortex", "qclearn.plot", True),
        ("data_synth.cortex", "torch", True),
        ("qclearn.nets.train", "data_synth", False),
    ],
)
def test_the_rule_refuses(module, name, at_top):
    assert forbidden(module, name, at_top)


@pytest.mark.parametrize(
    "module, name",
    [
        ("qclearn.register", "qclearn.nets"),
        ("qclearn.cli", "data_synth"),
        ("qclearn.nets.cpnet", "qclearn.disk"),
        ("data_synth.cortex", "qclearn.surface"),
        ("qclearn.widgets", "qclearn.plot"),
    ],
)
def test_the_rule_allows(module, name):
    assert forbidden(module, name, at_top=False) is None


def test_importing_the_library_loads_no_network_and_no_picture():
    heavy = ("torch", "matplotlib", "ipywidgets", "pyvista", "nilearn")
    program = f"import sys, qclearn; print([name for name in {heavy} if name in sys.modules])"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == "[]"
