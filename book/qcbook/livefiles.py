"""Files as the browser reads them: networks with weights in half precision and tables, and
surfaces."""

import json
import struct

import numpy as np

from qclearn.plane.disk import pairs
from qclearn.surfaces.curvature import area_radius, grey_levels, mean_curvature

STEPS = 2**16 - 1  # of a number that travels in two bytes
KINDS = {"float16": "half", "float32": "single", "uint16": "short", "uint8": "byte"}


def packed(config, arrays):
    """A file for `readNetwork` of unet.js: uint32 length of a JSON header, the header, the arrays'
    numbers.

    arrays: name -> array, made float32 if not of `KINDS`; complex ones get a last axis of two.
    """
    listed, parts = [], []
    for name, array in arrays.items():
        array = np.asarray(array)
        if np.iscomplexobj(array):
            array = pairs(array)
        array = array if array.dtype.name in KINDS else array.astype(np.float32)
        listed.append([name, list(array.shape), KINDS[array.dtype.name]])
        parts.append(array.tobytes())
    header = json.dumps({"config": config, "arrays": listed}).encode()
    header += b" " * (-len(header) % 4)
    return struct.pack("<I", len(header)) + header + b"".join(parts)


def half_weights(module):
    """The parameters of a U-Net in half precision, "unet.<name>" -> array. Convolutions lie as
    layers.wasm reads them, (outputs / 8, kernel, kernel, inputs, 8), made up with zeros to
    multiples of 8 outputs and 4 inputs."""
    values, found = {name: value.half().numpy() for name, value in module.state_dict().items()}, {}
    for name, value in values.items():
        layer, kind = name.rsplit(".", 1)
        if values[f"{layer}.weight"].ndim == 4:
            value = np.pad(value, [(0, -length % step) for length, step in zip(value.shape, (8, 4, 1, 1))])
            if kind == "weight":
                value = value.reshape(-1, 8, *value.shape[1:]).transpose(0, 3, 4, 2, 1)
        found[f"unet.{name}"] = value
    return found


def cpnet_file(network):
    """CP-Net `best` with its tables. The browser carries nu on the network's own mesh, however
    close landmarks are."""
    config, born = network.config, network.born
    sizes = {name: getattr(config, name) for name in ("rings", "spokes", "looks", "most", "smooth", "match", "stiff")}
    spectrum, _ = network.carrier(config.rings)
    tables = {
        "one": born.one.conj().resolve_conj().numpy(),
        "two": born.two.numpy(),
        "kept": network.grid.selected.numpy(),
        "area": network.grid.area.numpy(),
        "radial": spectrum.radial,
        "eigenvalues": spectrum.values,
    }
    return packed(sizes | {"power": network.grid.power}, tables | half_weights(network.unet))


def hemisphere_file(side, **values):
    """A `ParameterizedSurface` as `Hemisphere` of hemisphere.js reads it; values: (V,) arrays or
    plain numbers.

    Positions in mm, places in the disk with a radius by area, and values per vertex are rounded to
    1/65,535 of their range. shade: grey levels from 0 (sulci) to 255 (gyri).
    """
    surface, z = side.surface, side.disk.z
    radius = area_radius(surface, z)
    plain = {name: value for name, value in values.items() if np.ndim(value) == 0}
    numbers = {"vertices": surface.vertices, "places": pairs(radius.to_image(z))} | values
    ranges, arrays = {}, {}
    for name, array in numbers.items():
        if name in plain:
            continue
        low, step = array.min(), np.ptp(array) / STEPS or 1.0
        ranges[name], arrays[name] = ([float(low), float(step)], np.round((array - low) / step).astype(np.uint16))
    boundary = surface.vertices[np.concatenate(surface.boundary_loops)]
    config = {
        **plain,
        "ranges": ranges,
        "radius": {"disk": radius.disk.tolist(), "image": radius.image.tolist()},
        "away": (surface.vertices.mean(0) - boundary.mean(0)).tolist(),  # from the opening
    }
    shade = grey_levels(mean_curvature(surface), surface.vertex_areas).round().astype(np.uint8)
    return packed(config, arrays | {"faces": surface.faces.astype(np.uint16), "shade": shade})
