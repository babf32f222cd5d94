"""What the pages of the book import: figures, tables, numbers for the prose, explorables, and
graded exercises."""

from qclearn.interrupts import attach

EXPLORABLES = ("Mobius", "Mu", "Tuner", "Landmarks", "LBS", "Boundary", "Growth", "HowSure")
TABLE = {
    "cells": "keep num show_figure slide table",
    "comparisons": "among_people chain_seconds compare_fronts compare_runs doubtful_curves homologous dbsnet_saves "
    "noted saving",
    "diagrams": "block_diagram",
    "dots": "dot_lines plain_ticks run_dots setting",
    "examples": "cortex_problem example_problems spread_vertices",
    **{f"explore_{name.lower()}": name for name in EXPLORABLES},
    "fitstates": "fit_state states_figure",
    "gliding": "Gliding View view_figure",
    "live": "explorable",
    "picker": "LandmarkPicker",
    "paperlines": "paper_lines paper_table",
    "traininglab": "training_lab",
    "verdicts": "FACTOR compared judge_ratio side",
}

__getattr__, __dir__, __all__ = attach(__name__, TABLE)
