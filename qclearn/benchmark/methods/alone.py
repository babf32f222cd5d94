"""A method once more, in a process of its own, for what the whole process costs: surfaces in, disk maps, the method.

    python -m qclearn.benchmark.methods.alone FOLDER

FOLDER holds `moving.npz` and `control.npz`, and `run.json`: {"method", "parameters", "curves"}.
"""

import json
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ...io.meshes import read_surface, write_surface
from ...plane.bijectivity import RepairWarning
from ...registration.landmarkfile import check_curves
from ...registration.preparation import Sides, laid_upon, sampled
from ...surfaces.conformal import laid_out
from ...surfaces.surface import Surface
from .process import measured
from .spheres import LIMIT, Sphere

NAMES = "moving", "control"


def costs_alone(run, pair):
    """The `Costs` of a process that runs a benchmark's run on a pair. Spheres are given, as programs are given them,
    where the run's method is one on spheres."""
    from . import ON_SPHERES

    with TemporaryDirectory() as folder:
        for name in NAMES:
            side = getattr(pair, name)
            write_surface(Path(folder, f"{name}.npz"), side.surface)
            if run.method in ON_SPHERES:
                np.savez(Path(folder, f"{name}_sphere.npz"), faces=side.sphere.whole.faces, points=side.sphere.points,
                         vertices=side.sphere.whole.vertices)  # fmt: skip
        curves = [{name: plain(value) for name, value in curve.items()} for curve in pair.curves]
        words = {"method": run.method, "parameters": run.parameters, "curves": curves}
        Path(folder, "run.json").write_text(json.dumps(words))
        return measured([sys.executable, "-m", __name__, folder], LIMIT)


def plain(value):
    return [int(vertex) for vertex in value] if isinstance(value, (list, tuple, np.ndarray)) else value


def main(folder):
    from . import METHODS

    run = json.loads(Path(folder, "run.json").read_text())
    moving, control = (laid_out(read_surface(Path(folder, f"{name}.npz"))) for name in NAMES)
    moving, control = (
        with_sphere(side, Path(folder, f"{name}_sphere.npz")) for side, name in zip((moving, control), NAMES)
    )
    sides = Sides(moving, control, check_curves(run["curves"], moving.surface, control.surface), [])
    problem = replace(sampled(laid_upon(sides)).problem, sides=sides)
    warnings.simplefilter("ignore", RepairWarning)
    METHODS[run["method"]](problem, **run["parameters"])


def with_sphere(side, path):
    if not path.exists():
        return side
    with np.load(path) as kept:
        whole = Surface(kept["vertices"], kept["faces"])
        return replace(side, sphere=Sphere(side.surface, (whole, kept["points"])))


if __name__ == "__main__":
    main(*sys.argv[1:])
