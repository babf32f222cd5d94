"""The landmark problems that a reader changes in an explorable: as the browser and the library have
them."""

import json
from functools import cache

from qclearn.plane.grids import polar
from qclearn.registration.problem import Problem, Weights

from .examples import CORTICES, cortices, courses_problem, example_problems
from .live import as_pairs

# Where an explorable of a landmark problem starts.
START = {
    "problem": "cortex",
    "landmarks": "points",
    "alpha": Weights.alpha,
    "beta": Weights.beta,
    "gamma": Weights.gamma,
    "starts": {},
    "targets": {},
}
DRAWN = ("twist", "anew", "neighbours")


def example(name):
    """The problem of a name: an `Example`."""
    return courses_problem(cortices(name)) if name in CORTICES else dict(zip(DRAWN, example_problems()))[name]


@cache
def problems_file():
    """All problems as the browser reads them, bytes."""
    return json.dumps({name: as_json(example(name)) for name in (*CORTICES, *DRAWN)}).encode()


def as_json(example):
    """An `Example` as the browser reads it."""
    problem, radius = example.problem, example.radius
    knots = None if radius is None else {"disk": radius.disk.tolist(), "image": radius.image.tolist()}
    sides = {"moving": as_pairs(problem.moving), "target": as_pairs(problem.target)}
    mm = None if example.mm is None else example.mm.tolist()
    return {"label": example.name, **sides, "curve": problem.curve.tolist(), "radius": knots, "mm": mm}


def as_moved(problem, state, mesh):
    """A `Problem` with the landmarks and targets that the reader has moved, on a polar mesh of
    (rings, spokes)."""
    sides = problem.moving.copy(), problem.target.copy()
    for points, moves in zip(sides, (state["starts"], state["targets"])):
        for place, (x, y) in moves.items():
            points[int(place)] = complex(x, y)
    return Problem(polar(*mesh), *sides, problem.curve, state["landmarks"] == "sliding")


def weights_of(state):
    """The `Weights` of a state."""
    return Weights(*(state[name] for name in ("alpha", "beta", "gamma")))
