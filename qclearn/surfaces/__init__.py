"""Surfaces in space: checked once, cut open, measured, mapped conformally to the disk."""

from ..lazy import offer

TABLE = {
    "curvature": [
        "CLOSING_CELL",
        "CLOSING_RADIUS",
        "AreaRadius",
        "area_radius",
        "area_under_pixels",
        "grey_levels",
        "resolved_share",
    ],
    "side": ["Side", "laid_out"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
