"""Surfaces in space: checked once, cut open, measured, mapped conformally to the disk."""

from ..lazy import offer

TABLE = {
    "conformal": ["Side", "laid_out"],
    "curvature": [
        "CLOSING_CELL",
        "CLOSING_RADIUS",
        "AreaRadius",
        "area_radius",
        "area_under_pixels",
        "grey_levels",
        "resolved_share",
    ],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
