"""The landmark problems that a reader changes in an explorable: as the browser and the library have
them."""

import json
from functools import cache

import numpy as np
from scipy import sparse

from qclearn.plane.grids import FINE, polar
from qclearn.plane.linear import face_areas
from qclearn.registration.features import log_density
from qclearn.registration.problem import Problem, Weights

from .examples import CORTICES, SUBJECTS, cortices, courses_problem, example_problems
from .live import as_pairs

LINE = 25  # points of a drawn sulcus
UNFOLDING = 150  # rounds of averaging over neighbours
# Where an explorable of a landmark problem starts.
START = {
    "problem": "cortex",
    "landmarks": "points",
    "alpha": Weights.alpha,
    "beta": Weights.beta,
    "gamma": Weights.gamma,
    "starts": {},
    "targets": {},
    "held": [],
}
DRAWN = ("twist", "anew", "neighbours")
FILES = """import json, qclearn as qc
for side in ('right', 'left'):
    qc.write_surface(side + '.npz', qc.fsaverage5(side))
json.dump(qc.demo_landmarks(), open('sulci.json', 'w'))"""
FSAVERAGE = {
    "before": [["python", "-c", FILES]],
    "register": ["right.npz", "left.npz", "--mirror", "--landmarks", "sulci.json"],
    "python": [
        'moving, control = qc.mirror(qc.fsaverage5("right")), qc.fsaverage5("left")',
        "curves = qc.demo_landmarks()",
    ],
}


def again(name):
    """How a reader registers the surfaces of `cortices(name)` outside the figure: shell commands before
    `qclearn register`, its own words without weights, and lines of Python."""
    if name == "cortex":
        return FSAVERAGE
    from qclearn.benchmark.pairs import CONTROL  # here: it brings the synthetic surfaces, an extra

    seeds = SUBJECTS[name], CONTROL
    files = "moving.npz", "control.npz"
    return {
        "before": [["qclearn", "synth", "--seed", str(seed), "--out", file] for seed, file in zip(seeds, files)],
        "register": [*files],
        "python": [
            "from data_synth import make_cortex",
            "",
            f"moving, control = (make_cortex(seed).surface for seed in {seeds})",
            "curves = [",
            '    {"name": name, "moving": path, "control": control.curves[name], "detect": False}',
            "    for name, path in moving.curves.items()",
            "    if name in control.curves",
            "]",
        ],
    }


def example(name):
    """The problem of a name: an `Example`."""
    return courses_problem(cortices(name)) if name in CORTICES else dict(zip(DRAWN, example_problems()))[name]


@cache
def problems_file():
    """All problems as the browser reads them, bytes."""
    cortex = {name: as_json(example(name), cortices(name), again(name)) for name in CORTICES}
    # The synthetic subjects have one control.
    for name, one in cortex.items():
        one["surface"] = f"control-{'cortex' if name == 'cortex' else 'subject'}.bin"
    return json.dumps(cortex | {name: as_json(example(name)) for name in DRAWN}).encode()


def as_json(example, pair=None, again=None):
    """An `Example` as the browser reads it; pair: its `Courses`, where it has surfaces."""
    problem, radius = example.problem, example.radius
    found = {
        "label": example.name,
        "moving": as_pairs(problem.moving),
        "target": as_pairs(problem.target),
        "curve": problem.curve.tolist(),
        "radius": None if radius is None else {"disk": radius.disk.tolist(), "image": radius.image.tolist()},
    }
    if pair is None:
        return found
    lines = ([as_pairs(line.round(5)) for line in side] for side in pair.sample_landmarks(LINE))
    disk, mesh = pair.moving.disk, polar(*FINE)
    density = disk.interpolate(density_of(pair.moving), disk.locate(mesh.z)).round(3)
    return found | {
        "names": list(pair.names),
        "lines": dict(zip(("moving", "target"), lines)),
        "density": density.tolist(),
        "again": again,
    }


def density_of(side):
    """log2 of the area in space per area of the disk, either as shares of the whole, at the vertices (V,)
    of a `ParameterizedSurface`."""
    return log_density(side.surface.vertex_areas / side.surface.area, side.disk) / np.log(2)


def as_moved(problem, state, mesh):
    """A `Problem` with the landmarks and targets that the reader has moved and without the curves held
    out, on a polar mesh of (rings, spokes)."""
    sides = problem.moving.copy(), problem.target.copy()
    for points, moves in zip(sides, (state["starts"], state["targets"])):
        for place, (x, y) in moves.items():
            points[int(place)] = complex(x, y)
    fitted = ~np.isin(problem.curve, state["held"])
    moving, target = (points[fitted] for points in sides)
    return Problem(polar(*mesh), moving, target, problem.curve[fitted], state["landmarks"] == "sliding")


def weights_of(state):
    """The `Weights` of a state."""
    return Weights(*(state[name] for name in ("alpha", "beta", "gamma")))


def unfolded(surface, rounds=UNFOLDING):
    """Positions (V, 3) after averaging over neighbours, scaled to the old area; the rim is averaged
    along itself."""
    count = len(surface.vertices)
    rim = np.isin(np.arange(count), np.concatenate(surface.boundary_loops))
    ends = np.concatenate([surface.edges, surface.edges[:, ::-1]])
    ends = ends[~rim[ends[:, 0]] | rim[ends[:, 1]]]  # what moves a vertex of the rim lies on the rim
    weights = 1 / np.bincount(ends[:, 0], minlength=count)[ends[:, 0]]
    means = sparse.csr_array((weights, tuple(ends.T)), shape=(count, count))
    x = surface.vertices
    for _ in range(rounds):
        x = (x + means @ x) / 2
    middle, area = x.mean(0), face_areas(x, surface.faces).sum()
    return middle + (x - middle) * np.sqrt(surface.area / area)
