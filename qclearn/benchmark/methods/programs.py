"""Methods that are programs: surfaces and spheres in, a sphere out; and what a process costs."""

import pickle
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from string import Formatter
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ...io.extras import require
from ...io.meshes import read_surface, write_surface
from ...registration.curves import check_curves
from ...registration.pair import SurfacePair, align_disks, sample_landmarks
from ...surfaces.conformal import parameterize
from ...surfaces.surface import Surface
from .process import Costs, ProgramError, measured
from .spheres import CATSURF, LIMIT, Sphere, sphere_of, unit_points

FILES = "moving", "moving_sphere", "control", "control_sphere", "out"
RADIUS = 100.0  # of the spheres that a program is given, mm
ANSWERS = {}  # of this process: problems that differ only in their curves are one to a program


class Answer(NamedTuple):
    """A program's map: where each vertex of the whole moving surface lies, and its `costs`.

    points: (V', 3), on the control's unit sphere.
    """

    points: np.ndarray
    costs: Costs


def program(problem, command="", limit=LIMIT):
    """The `Answer` of a command line such as "tool {moving_sphere} {control_sphere} {out}".

    FILES, GIFTI: both whole surfaces in mm, their spheres (radius 100, around 0), and its answer,
    the moving sphere's faces with each vertex where it lies on the control's sphere. No shell;
    limit: seconds. ProgramError, SphereError; ImportError where a sphere cannot be made.
    """
    parts = command_parts(command)
    spheres = sphere_of(problem.pair.moving), sphere_of(problem.pair.control)
    key = tuple(parts), limit, *(sphere.fingerprint for sphere in spheres)
    if key not in ANSWERS:
        ANSWERS[key] = answer_of(parts, limit, *spheres)
    return ANSWERS[key]


def spherical_demons(problem, limit=LIMIT):
    """Spherical Demons as CAT12 has it, `cat_surf.spherical_demon`, `Answer`; extra `peers`.

    Source: Yeo, Sabuncu, Vercauteren, Ayache, Fischl, Golland (2010), Spherical Demons.
    """
    require("peers", "Spherical Demons")
    command = shlex.join([*CATSURF, "demons", *(f"{{{name}}}" for name in FILES)])
    return program(problem, command, limit)


def command_parts(command):
    """A command line split into parts, each placeholder checked, or ProgramError."""
    try:
        parts = shlex.split(command)
        names = {name for part in parts for _, name, _, _ in Formatter().parse(part)} - {None}
    except ValueError as error:
        raise ProgramError(f"{command!r} is no command line: {error}") from None
    unknown = sorted(names - set(FILES))
    if unknown or "out" not in names:
        fault = f"knows no {{{unknown[0]}}}" if unknown else "does not say where {out} goes"
        allowed = ", ".join(f"{{{name}}}" for name in FILES)
        raise ProgramError(f"{command!r} {fault}: write it with {allowed}")
    return parts


def answer_of(parts, limit, moving, control):
    whole, whose = moving.whole, "the sphere that the program wrote"
    with TemporaryDirectory() as folder:
        paths = {name: str(Path(folder, f"{name}.surf.gii")) for name in FILES}
        for name, sphere in (("moving", moving), ("control", control)):
            write_surface(paths[name], sphere.whole)
            ball = Surface(RADIUS * sphere.points, sphere.whole.faces)
            write_surface(paths[f"{name}_sphere"], ball)
        costs = measured([part.format(**paths) for part in parts], limit, paths["out"])
        try:
            result = read_surface(paths["out"])
        except ValueError as error:
            message = str(error).replace(paths["out"], "{out}")
            raise ProgramError(f"its sphere cannot be read: {message}") from None
    points = unit_points(result.vertices, whole, whose)
    if not np.array_equal(result.faces, whole.faces):
        raise ProgramError(f"{whose} has other faces than the moving surface: keep its order")
    return Answer(points, costs)


def costs_alone(run, pair):
    """The `Costs` of a process that makes both disk maps and runs a benchmark's run on a pair.

    Methods on spheres are given these, as programs are.
    """
    from . import ON_SPHERES

    sides = []
    for side in (pair.moving, pair.control):
        sphere = (side.sphere.whole, side.sphere.points) if run.method in ON_SPHERES else None
        sides.append((Surface(side.surface.vertices, side.surface.faces), sphere))
    with TemporaryDirectory() as folder:
        task = Path(folder, "task.pickle")
        task.write_bytes(pickle.dumps((run.method, run.parameters, pair.curves, sides)))
        code = f"import sys, {__name__}; {__name__}.run_task(sys.argv[1])"
        return measured([sys.executable, "-W", "ignore", "-c", code, str(task)], LIMIT)


def run_task(path):
    """What the process of `costs_alone` does: surfaces in, disk maps, the method."""
    from . import METHODS

    method, parameters, curves, pairs = pickle.loads(Path(path).read_bytes())
    spheres = [sphere and Sphere(one, sphere) for one, sphere in pairs]
    moving, control = (one for one, _ in pairs)
    surfaces = [replace(parameterize(pairs[k][0]), sphere=spheres[k]) for k in range(2)]
    sides = SurfacePair(*surfaces, check_curves(curves, moving, control), [])
    problem = replace(sample_landmarks(align_disks(sides)).problem, pair=sides)
    METHODS[method](problem, **parameters)
