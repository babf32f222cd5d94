"""The folds that the template grows by itself, to which subjects lean.

They are stored in `pattern.json`, which `book/studies/grow_pattern.py` writes: a subject that is the
template itself is grown once, and the depth of its folds stored: growing it anew could give
another subject for the same seed on another machine.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from .template import fibonacci_sphere

FILE = Path(__file__).with_name("pattern.json")
COUNT = 6000  # directions, at which the depth is stored
NEAREST = 4  # of them, between which it is interpolated


@cache
def template_folds():
    """A tree of the template's directions, and its folds' depth (COUNT,) there, in SD."""
    depth = json.loads(FILE.read_text(encoding="utf-8"))["percent"]
    return cKDTree(fibonacci_sphere(len(depth))), np.array(depth) / 100


def pattern(template):
    """Depth (k,) of the template's own folds at points (k, 3), in SD: negative on crowns."""
    tree, depth = template_folds()
    distance, near = tree.query(template, k=NEAREST)
    weight = 1 / (distance + 1e-6) ** 2
    return (weight * depth[near]).sum(1) / weight.sum(1)
