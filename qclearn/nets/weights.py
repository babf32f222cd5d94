"""Weights as safetensors files; the header has network, configuration, recipe and figures."""

import json
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from ..io.safe import write_whole
from .networks import NETWORKS, WeightsError, gamma_fault, network

# Raise it when a header's meaning or a network's layers change, so that old weights are refused.
FORMAT = 2
FOLDER = Path(__file__).parent / "weights"
# Options of old files, with the value that is left; and a value's old name.
GONE = {"inverse": True, "carry": True, "eta": 1.0}
RENAMED = {"mended": "corrected"}
NEEDED = {"format", "network", "config", "training", "data", "steps", "commit", "figures"}


def build(name, config):
    """An untrained network: `build("dbsnet", {"preset": "best", ...})`, or with a preset's name."""
    presets = network(name).presets
    given = {"preset": config} if isinstance(config, str) else dict(config)
    preset = given.pop("preset", None)
    if preset not in presets:
        raise WeightsError(f"{name} has no preset {preset!r}; there are {', '.join(presets)}")
    network_class, default = presets[preset]
    options = {}
    for field, value in given.items():
        if field not in GONE or value != GONE[field]:
            value = RENAMED.get(value, value) if isinstance(value, str) else value
            options[field] = tuple(value) if isinstance(value, list) else value
    return network_class(replace(default, **options))


def stem(name, preset, gamma=None):
    """File name of a network's weights without its suffix, "cpnet-paper-g1e4"."""
    return f"{name}-{preset}" + ("" if gamma is None else f"-g{gamma:.0e}".replace("e+0", "e"))


def load(name, preset="best", gamma=None):
    """The shipped network `name` ("ldnet", "cpnet", "dbsnet"), as NumPy callables.

    preset: "best", or "paper" for the paper's, corrected; that CP-Net has weights for one gamma each
    (1e4, 1e5, 2e5), others pass over gamma. `load("dbsnet").solve(z, faces, mu)`,
    `load("cpnet").predict(z, faces, moving, target, alpha=, beta=, gamma=)`,
    `load("ldnet").detect(surface, z, endpoints)`. WeightsError for an unknown name, preset or
    gamma.
    """
    gamma = gamma if name in NETWORKS and preset in NETWORKS[name].gammas else None
    if fault := gamma_fault(name, preset, gamma):
        raise WeightsError(f"{fault}: name one of them")
    return _shipped(stem(name, preset, gamma), name, preset)


@cache
def _shipped(stem, name, preset):
    path = FOLDER / f"{stem}.safetensors"
    if name not in NETWORKS or not path.is_file():
        shipped = ", ".join(sorted(path.stem for path in FOLDER.glob("*.safetensors")))
        missing = f"{name!r} with preset {preset!r}"
        raise WeightsError(f"no weights are shipped for {missing}; there are {shipped or 'none'}")
    return load_file(path)


def load_file(path, name=None):
    """The network of a weights file, of your own training say, in evaluation mode.

    WeightsError if the file is not whole, not one of this program, of another version, or of
    another network than named.
    """
    header, state = read_weights(path)
    if name is not None and header["network"] != name:
        content = f"weights of {header['network']}, not of {name}"
        raise WeightsError(f"{path}: holds {content}; give another file")
    model = build(header["network"], header["config"])
    try:
        model.load_state_dict(state, strict=True)
    except RuntimeError as error:
        raise WeightsError(
            f"{path}: does not fit {header['network']} as this version builds it "
            f"({' '.join(str(error).split())[:200]}); train it again with this version"
        ) from None
    model.header = header
    return model.eval().requires_grad_(False)


def read_weights(path):
    """(header, state dict) of a weights file; WeightsError if it is not whole or too old."""
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        reason = error.strerror or error
        raise WeightsError(f"{path}: cannot be read ({reason}); check the name") from None
    except (SafetensorError, UnicodeDecodeError) as error:
        message = f"not a whole safetensors file ({error}); get it again"
        raise WeightsError(f"{path}: {message}") from None
    try:
        header = dict(json.loads(metadata["qclearn"]))
    except (KeyError, TypeError, ValueError):
        message = "has no qclearn header; give a file that `qclearn train` wrote"
        raise WeightsError(f"{path}: {message}") from None
    if header.get("format") != FORMAT:
        raise WeightsError(
            f"{path}: weights of format {header.get('format')}, this version reads {FORMAT}; "
            "train them again, or install the version that wrote them"
        )
    return header, state


def save_weights(path, model, header):
    """Write a network's parameters with `header` (dict for JSON), whole or not at all."""
    state = {name: value.detach().cpu().contiguous() for name, value in model.state_dict().items()}
    header = {"format": FORMAT, "config": asdict(model.config), **header}
    if missing := ", ".join(sorted(NEEDED - set(header))):
        raise WeightsError(f"{path}: the header lacks {missing}")
    write_whole(Path(path), lambda place: save_file(state, place, {"qclearn": json.dumps(header)}))
