"""Who may import whom: geometry knows nothing of networks, pictures and widgets; the arrows point one way."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("qclearn", "data_synth")
# The rooms of qclearn, floor by floor: each may import from its own and from those below.
FLOORS = ["plane", "surfaces", "files", "registration", "group", "nets", "methods", "benchmark", "pages", "reports"]
FLOORS += ["exercises", "cli", "__main__"]
# Modules that call networks from below, and load them only then.
CALLERS = {"qclearn.registration.register"}
# Who brings the synthetic surfaces, which know qclearn up to the registration, together with the rest.
HOSTS = {"cli", "benchmark"}
# The data that the networks are trained on are torch datasets.
DATASETS = {"data_synth.datasets"}
LEARNING = {"torch", "safetensors", "onnx", "onnxruntime"}
SHOWING = {"matplotlib", "ipywidgets", "IPython", "click"}
PATHS = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]


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


def room_of(module):
    """The room of a module of qclearn; "" for the package itself."""
    return module.split(".")[1] if "." in module else ""


def forbidden(module, name, at_top):
    """Why `module` may not import `name`; None if it may."""
    package, room = module.split(".")[0], room_of(module)
    if name.split(".")[0] == "data_synth":
        own = package == "data_synth" or room in HOSTS
        return None if own else "only the command line and the benchmark bring data_synth and qclearn together"
    if name.split(".")[0] != "qclearn":
        return foreign(module, package, room, name.split(".")[0])
    below = "registration" if package == "data_synth" else "group" if room == "" else room
    if room_of(name) in FLOORS and FLOORS.index(room_of(name)) > FLOORS.index(below):
        called = module in CALLERS and room_of(name) == "nets" and not at_top
        return None if called else f"{room_of(name)} stands above {below}"
    return None


def foreign(module, package, room, library):
    """Why a library may not be imported there."""
    if library in LEARNING and room != "nets" and module not in DATASETS:
        return "geometry is NumPy and SciPy"
    if library in SHOWING and room not in ("pages", "reports", "cli"):
        return "only pages, reports and the command line show something"
    return None


def offenders(paths, find):
    """module -> what a rule finds in it, of the files in which it finds something."""
    assert len(paths) > 100  # the files are there at all
    return {module_of(path): found for path in paths if (found := find(path))}


def refused(path):
    """The imports of a file that may not be, each with the reason."""
    found = {name: forbidden(module_of(path), name, at_top) for name, at_top in imports_of(path)}
    return {name: reason for name, reason in found.items() if reason}


def test_imports_point_one_way():
    assert offenders(PATHS, refused) == {}


@pytest.mark.parametrize(
    "module, name, at_top",
    [
        ("qclearn.plane.disk", "torch", True),
        ("qclearn.plane.disk", "qclearn.pages.plot", False),
        ("qclearn.surfaces.surface", "qclearn.files.meshes", False),
        ("qclearn.registration.register", "qclearn.nets", True),
        ("qclearn.plane.fourier", "data_synth", True),
        ("qclearn", "qclearn.nets", True),
        ("data_synth.cortex", "qclearn.pages.plot", True),
        ("data_synth.cortex", "torch", True),
        ("qclearn.nets.train", "data_synth", False),
        ("qclearn.registration.register", "qclearn.methods", False),
        ("qclearn.nets.layers", "matplotlib", False),
    ],
)
def test_the_rule_refuses(module, name, at_top):
    assert forbidden(module, name, at_top)


@pytest.mark.parametrize(
    "module, name",
    [
        ("qclearn.registration.register", "qclearn.nets"),
        ("qclearn.cli", "data_synth"),
        ("qclearn.nets.cpnet", "qclearn.plane.disk"),
        ("data_synth.cortex", "qclearn.surfaces.surface"),
        ("qclearn.pages.fitstates", "qclearn.pages.plot"),
    ],
)
def test_the_rule_allows(module, name):
    assert forbidden(module, name, at_top=False) is None


def test_importing_the_library_loads_nothing_and_its_doors_no_network_and_no_picture():
    """Time would depend on the machine: 800 modules take under half a second, scipy.optimize alone has a hundred."""
    heavy = (
        "torch",
        "matplotlib",
        "ipywidgets",
        "pyvista",
        "nilearn",
        "scipy.optimize",
        "scipy.spatial",
        "scipy.ndimage",
    )
    program = (
        "import sys, qclearn; print('numpy' in sys.modules)\n"
        "for name in qclearn.__all__: getattr(qclearn, name)\n"
        f"print([name for name in {heavy} if name in sys.modules], len(sys.modules) < 800)"
    )
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert loaded.stdout.split("\n", 1) == ["False", "[] True\n"]


# A distribution -> what it is imported as, where the two differ.
IMPORTED_AS = {"scikit-image": "skimage", "cat-surf": "cat_surf"}
# A program that runs in a process of its own, because of the licence of what it imports.
PROGRAM = "qclearn.methods.catsurf"
# Come with another package: with pyvista, and with distributed.
BROUGHT = {"vtkmodules", "dask"}
# Needed without an import there: fsaverage5's files.
UNIMPORTED = {"nilearn"}


def distributions(requirements):
    """What requirements of pyproject.toml are imported as, without other extras of qclearn."""
    names = {re.match(r"[\w-]+", text)[0] for text in requirements}
    return {IMPORTED_AS.get(name, name) for name in names - {"qclearn"}}


def libraries(paths):
    """What is imported from outside the standard library and this project."""
    names = {name.split(".")[0] for path in paths for name, _ in imports_of(path) if name}
    return names - set(sys.stdlib_module_names) - set(PACKAGES) - BROUGHT


def test_the_core_and_each_extra_require_what_they_import():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = {name: distributions(texts) for name, texts in project["optional-dependencies"].items()}
    core = distributions(project["dependencies"])
    rooms = {room: sorted((ROOT / "qclearn" / room).rglob("*.py")) for room in FLOORS}
    base = [
        path
        for room in FLOORS
        if room not in ("group", "nets", "methods", "benchmark", "pages")
        for path in rooms[room]
    ]
    rooms["benchmark"] += rooms["methods"]
    (program,) = (path for path in rooms["benchmark"] if module_of(path) == PROGRAM)
    rooms["benchmark"].remove(program)
    assert libraries([program]) == required["peers"]
    assert libraries([*base, *(ROOT / "qclearn").glob("*.py")]) == core - UNIMPORTED
    guest = [path for path in (ROOT / "data_synth").glob("*.py") if module_of(path) not in DATASETS]
    assert libraries(guest) - core == required["synth"]
    assert libraries(rooms["nets"]) - core == required["nets"]
    assert libraries(rooms["benchmark"]) - core == required["benchmark"]
    assert libraries(rooms["group"]) - core < required["benchmark"]  # the scheduler of several workers


def test_nothing_imports_the_program_under_another_licence():
    takers = {module_of(path): {name for name, _ in imports_of(path)} for path in PATHS}
    assert {module for module, names in takers.items() if "cat_surf" in names} == {PROGRAM}
    assert not any(name == PROGRAM or name.endswith(".catsurf") for names in takers.values() for name in names)


def circles(imports):
    """Modules that import themselves through others, given module -> set of imported modules."""
    reached = {module: set(names) for module, names in imports.items()}
    for through in imports:
        for names in reached.values():
            if through in names:
                names |= reached[through]
    return sorted(module for module, names in reached.items() if module in names)


def test_no_module_imports_itself_through_others():
    # A package's __init__ offers what its modules hold; that they pass through it is no circle of their own.
    modules = {module_of(path): path for path in PATHS if path.name != "__init__.py"}
    imports = {module: {name for name, _ in imports_of(path)} & set(modules) for module, path in modules.items()}
    assert sum(map(len, imports.values())) > 100  # the names are read at all
    assert circles(imports) == []


def test_a_circle_is_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == ["b", "c"]
