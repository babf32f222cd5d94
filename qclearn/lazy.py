"""Doors: what a package offers of its modules, loaded when it is first asked for."""

import sys
from importlib import import_module


def offer(package, table):
    """`__getattr__`, `__dir__` and `__all__` for the `__init__` of a package (PEP 562).

    table: module -> names that it holds, the module by its address inside the package ("plane.disk"). A name that is
    its module's own is loaded at once: once that module is loaded, Python finds the module under the name.
    """
    modules = {name: f"{package}.{module}" for module, names in table.items() for name in names}

    def load(name):
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(modules[name]), name)

    def directory():
        return sorted({*vars(sys.modules[package]), *modules})

    for name, module in modules.items():
        if module == f"{package}.{name}":
            setattr(sys.modules[package], name, load(name))
    return load, directory, sorted(modules)
