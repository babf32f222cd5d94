"""What is not installed with the core: extras, and the one line that says how to get them."""

from contextlib import nullcontext
from importlib.util import find_spec

# Extra of pyproject.toml -> what its packages are imported as.
EXTRAS = {
    "synth": ("numba", "skimage"),
    "nets": ("torch", "safetensors"),
    "benchmark": ("distributed", "jsonschema"),
    "conte69": ("brainspace",),
}


def require(extra, what):
    """ImportError with the command that installs an extra, where a package of it is missing.

    what: who needs it, in the plural, "the networks". Nothing is imported. Returns an empty context,
    for the imports that follow: `with require("nets", "the networks"): import torch`.
    """
    missing = [package for package in EXTRAS[extra] if find_spec(package) is None]
    if missing:
        raise ImportError(f"{what} need {missing[0]}, which is not installed: pip install 'qclearn[{extra}]'")
    return nullcontext()
