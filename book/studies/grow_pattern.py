"""Grow the template itself and keep where it folds: data_synth/pattern.json, to which subjects
lean.

    python -m book.studies.grow_pattern

Another pattern makes other subjects, and so another generation. Takes ten seconds.
"""

import json
from dataclasses import asdict

import numpy as np

from data_synth.correspondence import locate_on_sphere
from data_synth.cortex import grown
from data_synth.generations import Guidance
from data_synth.individual import Individual
from data_synth.pattern import COUNT, FILE
from data_synth.template import fibonacci_sphere
from qclearn.io.safe import write_whole
from qclearn.surfaces.curvature import sulcal_depth

VERTICES = 10_000
LEAST, MOST = (-0.5, 1.5)  # in standard deviations: crowns pushed out hard would be flat, the deepest folds too deep
OWN = {"variability": 0.0, "pattern": 0.0, "companions": (0.75, 0.75)}  # where the template differs from a subject


class Template(Individual):
    """The template as a subject: not deformed, its sulci without gaps and branches, with no short
    furrows between."""

    def __init__(self):
        super().__init__(0, "right", Guidance(**OWN))

    def _interrupted(self, count):
        return np.ones(count)

    def _branches(self, course):
        return []

    def _dimples(self, lines):
        return []


def template_depth(n_vertices=VERTICES):
    """Depth (COUNT,) of the folded template at even directions: standard deviations from its mean,
    LEAST to MOST."""
    surface, template = grown(Template(), n_vertices)
    depth, area = sulcal_depth(surface), surface.vertex_areas
    mean = np.average(depth, weights=area)
    depth = (depth - mean) / np.sqrt(np.average((depth - mean) ** 2, weights=area))
    face, weights = locate_on_sphere(template, surface.faces, fibonacci_sphere(COUNT))
    return np.clip(np.einsum("pk,pk->p", weights, depth[surface.faces[face]]), LEAST, MOST)


def main():
    percent = np.round(100 * template_depth()).astype(int).tolist()
    kept = {"of": "depth of the folded template, percent of its standard deviation", "guidance": asdict(Guidance())}
    text = json.dumps(kept | {"vertices": VERTICES, "percent": percent})
    write_whole(FILE, lambda place: place.write_text(text + "\n", encoding="utf-8"))


if __name__ == "__main__":
    main()
