"""Surfaces in space: checked once, cut open, measured, mapped conformally to the disk."""

from ..interrupts import attach

TABLE = {
    "conformal": "ParameterizedSurface parameterize",
    "curvature": "CLOSING_CELL CLOSING_RADIUS AreaRadius area_radius grey_levels",
}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
