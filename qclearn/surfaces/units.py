"""The unit of a surface's coordinates by its length, and what a millimetre is on it."""

from typing import NamedTuple

import numpy as np

UNITS = {"mm": 1.0, "m": 1e3, "um": 1e-3}  # in mm
# Lengths of hemispheres in mm, from a small monkey's to a person's inflated one. In centimetres no
# hemisphere is so long. Other units allow a third of the shortest to three times a person's.
IN_MM = 40.0, 300.0
IN_OTHERS = 40 / 3, 3 * 230.0
TYPICAL = 165.0  # mm


class Size(NamedTuple):
    """Of a surface: its length and a millimetre, in its coordinates, and the unit in which a
    hemisphere is so long: "mm", "m", "um", or None, where mm is length / TYPICAL."""

    length: float
    unit: str | None
    mm: float


def size_of(surface):
    """The `Size` of a surface."""
    points = surface.vertices[np.isfinite(surface.vertices).all(axis=1)]
    length = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    for unit, (least, most) in (("mm", IN_MM), ("m", IN_OTHERS), ("um", IN_OTHERS)):
        if least <= UNITS[unit] * length <= most:
            return Size(length, unit, 1 / UNITS[unit])
    return Size(length, None, length / TYPICAL)


def other_units(**surfaces):
    """`units:` for each named surface as long as a hemisphere in metres or micrometres."""
    for name, surface in surfaces.items():
        length, unit, _ = size_of(surface)
        if unit in ("m", "um"):
            yield (
                f"units: the {name} surface is {length:.3g} long, as a hemisphere is in {unit}; "
                f"give --units {unit} (library: read_surface(..., units={unit!r}))"
            )


def relative_units(control):
    """What the report says of lengths in mm on a control of no hemisphere's length, or None."""
    length, unit, mm = size_of(control)
    if unit:
        return None
    return (
        f"the control surface is {length:.3g} long, a hemisphere's length in no unit: lengths and "
        f"limits in mm are relative to it, 1 mm is {mm:.3g}, 1/{TYPICAL:g} of it"
    )
