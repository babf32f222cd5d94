"""What the pages of the book and the command line draw with: plots, scenes, explorables, and numbers for the prose."""

from qclearn.lazy import offer

EXPLORABLES = ("Mobius", "Mu", "Tuner", "Sulci", "Landmarks", "LBS", "Boundary", "Growth", "HowSure")
TABLE = {
    "cells": ["keep", "num", "show_figure", "table"],
    "diagrams": ["block_diagram"],
    "examples": ["cortex_problem", "example_problems", "spread_vertices"],
    **{f"explore_{name.lower()}": [name] for name in EXPLORABLES},
    "fitstates": ["RINGS", "describe", "exact_fit", "fit_state", "network_fit", "states_figure"],
    "gaps": ["gap_bands", "gap_grid"],
    "live": ["explorable"],
    "needs": ["needs_figure"],
    "picker": ["LandmarkPicker"],
    "paperlines": ["paper_lines", "paper_table"],
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
}

__getattr__, __dir__, __all__ = offer(__name__, TABLE)
