"""Weights as safetensors files that say in their header what they are: network, configuration,
recipe and figures."""

import hashlib
import json
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from ..io.meshes import write_whole
from .networks import NETWORKS, WeightsError, gamma_fault, network

# Raise it when a header's meaning or a network's layers change, so that old weights are refused.
FORMAT = 2
FOLDER = Path(__file__).parent / "weights"
GONE = {
    "inverse": True,
    "carry": True,
    "eta": 1.0,
}  # options of old files, with the value that is left
NEEDED = {"format", "network", "config", "training", "data", "steps", "commit", "figures", "digest"}


def build(name, config):
    """An untrained network: `build("dbsnet", {"preset": "best", ...})`, or with the preset's name
    alone."""
    presets = network(name).presets
    given = {"preset": config} if isinstance(config, str) else dict(config)
    preset = given.pop("preset", None)
    if preset not in presets:
        raise WeightsError(f"{name} has no preset {preset!r}; there are {', '.join(presets)}")
    network_class, default = presets[preset]
    given = {
        field: value for field, value in given.items() if field not in GONE or value != GONE[field]
    }
    plain = {
        field: tuple(value) if isinstance(value, list) else value for field, value in given.items()
    }
    return network_class(replace(default, **plain))


def stem(name, preset, gamma=None):
    """File name of a network's weights without its suffix, "cpnet-paper-g1e4"."""
    return f"{name}-{preset}" + ("" if gamma is None else f"-g{gamma:.0e}".replace("e+0", "e"))


def load(name, preset="best", gamma=None):
    """The shipped network `name` ("ldnet", "cpnet", "dbsnet") in evaluation mode, as NumPy
    callables.

    preset: "best", or "paper" for the paper's, mended; that CP-Net has weights for one gamma each
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
        raise WeightsError(
            f"no weights are shipped for {name!r} with preset {preset!r}; there are "
            f"{shipped or 'none'}"
        )
    return load_file(path)


def load_file(path, name=None):
    """The network of a weights file, of your own training say, in evaluation mode.

    WeightsError if the file is damaged, not one of this program, of another version, or of another
    network than named.
    """
    header, state = read_weights(path)
    if name is not None and header["network"] != name:
        raise WeightsError(
            f"{path}: holds weights of {header['network']}, not of {name}; give another file"
        )
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
    """(header, state dict) of a weights file; WeightsError if it is not whole, not ours or of
    another version."""
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}

            state = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except OSError as error:
        raise WeightsError(
            f"{path}: cannot be read ({error.strerror or error}); check the name"
        ) from None
    except (SafetensorError, UnicodeDecodeError) as error:
        raise WeightsError(
            f"{path}: not a whole safetensors file ({error}); get it again"
        ) from None
    try:
        header = dict(json.loads(metadata["qclearn"]))
        missing = NEEDED - set(header)
    except (KeyError, TypeError, ValueError):
        raise WeightsError(
            f"{path}: has no qclearn header; give a file that `qclearn train` wrote"
        ) from None
    if header.get("format") != FORMAT:
        raise WeightsError(
            f"{path}: weights of format {header.get('format')}, this version reads {FORMAT}; "
            "train them "
            "again, or install the version that wrote them"
        )
    if missing:
        raise WeightsError(
            f"{path}: its header lacks {', '.join(sorted(missing))}; get the file again"
        )
    if header["digest"] != digest_of_state(state):
        raise WeightsError(f"{path}: its numbers do not match its checksum; get the file again")
    return header, state


def save_weights(path, model, header):
    """Write a network's parameters with `header` (dict for JSON) as one file, whole or not at all."""
    state = {
        name: tensor.detach().cpu().contiguous() for name, tensor in model.state_dict().items()
    }
    header = {
        "format": FORMAT,
        "config": asdict(model.config),
        **header,
        "digest": digest_of_state(state),
    }
    missing = NEEDED - set(header)
    if missing:
        raise WeightsError(f"{path}: the header lacks {', '.join(sorted(missing))}")
    write_whole(Path(path), lambda place: save_file(state, place, {"qclearn": json.dumps(header)}))


def digest_of_state(state):
    """`digest` of a state dict, whose order in a file is not the one it was written in."""
    return digest(state[name] for name in sorted(state))


def digest(tensors):
    """SHA-256 of tensors: shapes, types and numbers, in order."""
    total = hashlib.sha256()
    for tensor in tensors:
        tensor = tensor.detach().cpu().contiguous()
        total.update(f"{tuple(tensor.shape)} {tensor.dtype}".encode())
        total.update(
            torch.view_as_real(tensor).numpy().tobytes()
            if tensor.is_complex()
            else tensor.numpy().tobytes()
        )
    return total.hexdigest()
