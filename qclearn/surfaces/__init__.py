"""Surfaces in space: checked once, cut open, measured, mapped conformally to the disk."""

import lazy_loader as lazy

TABLE = {
    "conformal": ["ParameterizedSurface", "parameterize"],
    "curvature": ["CLOSING_CELL", "CLOSING_RADIUS", "AreaRadius", "area_radius", "grey_levels"],
}

__getattr__, __dir__, __all__ = lazy.attach(__name__, submod_attrs=TABLE)
