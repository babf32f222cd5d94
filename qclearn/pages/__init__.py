"""What the pages of the book and the command line draw with: plots, scenes, widgets, and numbers for the prose."""

from ..lazy import offer

TABLE = {
    "canvas": ["Canvas"],
    "cells": ["keep", "kept", "num", "show_figure", "table"],
    "diagrams": ["block_diagram"],
    "examples": ["cortex_problem", "example_problems", "spread_vertices"],
    "explorables": ["Mobius", "Mu", "Tuner"],
    "explore_boundary": ["Boundary"],
    "explore_growth": ["Growth"],
    "explore_lbs": ["LBS"],
    "gaps": ["gap_bands", "gap_grid"],
    "live": ["explorable"],
    "livesurfaces": ["Landmarks", "Sulci"],
    "plot": [
        "CURVE_STYLES",
        "FLIPPED_COLOUR",
        "curve_legend",
        "curves_plot",
        "disk_axes",
        "disk_plot",
        "ellipse_field",
        "grid_plot",
        "lines_plot",
        "registration_disks",
    ],
    "scenes": ["Scene", "registration_scene", "require_renderer", "stacked_scene", "surface_picture", "surface_scene"],
    "traininglab": ["training_lab"],
    "widgets": ["RINGS", "fit_state", "network_fit"],
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
