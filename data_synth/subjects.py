"""Synthetic hemispheres in npz files, whole or not at all."""

import zipfile
import zlib
from pathlib import Path

import numpy as np

from qclearn.io.safe import npz_arrays, npz_bytes, write_whole
from qclearn.surfaces.surface import Surface, SurfaceError

from .cortex import HEMISPHERES, Cortex, CortexError

TRAITS = ("interrupted", "branched")
REQUIRED = ("vertices", "faces", "template", "seed", "hemisphere", "generation", *TRAITS)


def save_cortex(path, cortex):
    """Write a hemisphere to an npz file: vertices, faces, curve_<name>, template, seed, hemisphere,
    generation, and the names of the sulci that are interrupted and branched.

    The same hemisphere gives the same bytes. SurfaceError where the folder cannot be written;
    nothing partial stays.
    """
    arrays = {
        "vertices": cortex.surface.vertices, "faces": cortex.surface.faces, "template": cortex.template,
        "seed": np.array(cortex.seed), "hemisphere": np.array(cortex.hemisphere),
        "generation": np.array(cortex.generation),
        **{trait: np.array(getattr(cortex, trait), dtype=str) for trait in TRAITS},
        **{f"curve_{name}": curve for name, curve in cortex.curves.items()},
    }  # fmt: skip
    write_whole(Path(path), lambda place: place.write_bytes(npz_bytes(arrays)))


def load_cortex(path):
    """Read a hemisphere that save_cortex wrote; CortexError where that is impossible."""
    try:
        arrays = npz_arrays(Path(path).read_bytes())
    except FileNotFoundError:
        raise CortexError(
            f"{path} does not exist; make it with `qclearn synth --seed 1 --out {path}`."
        ) from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise CortexError(
            f"{path} is no readable npz file ({error}); make it again with `qclearn synth`."
        ) from None
    if missing := [name for name in REQUIRED if name not in arrays]:
        raise CortexError(
            f"{path} is not a synthetic hemisphere: it lacks {', '.join(missing)}. Use "
            "read_surface for others."
        )
    hemisphere = str(arrays["hemisphere"])
    if hemisphere not in HEMISPHERES or arrays["template"].shape != arrays["vertices"].shape:
        raise CortexError(
            f"{path} is damaged: hemisphere {hemisphere!r}, template {arrays['template'].shape}; "
            "make it again."
        )
    curves = {name[6:]: path_ for name, path_ in arrays.items() if name.startswith("curve_")}
    try:
        surface = Surface(arrays["vertices"], arrays["faces"], curves)
    except SurfaceError as error:
        raise CortexError(f"{path} is damaged: {error}") from None
    seed, generation = (int(arrays[name]) for name in ("seed", "generation"))
    traits = (tuple(map(str, arrays[trait])) for trait in TRAITS)
    return Cortex(surface, arrays["template"], seed, hemisphere, generation, *traits)
