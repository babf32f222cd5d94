"""Methods that are programs: surfaces and spheres in, a sphere out, each in a process of its own."""

import shlex
from pathlib import Path
from string import Formatter
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from ...io.extras import require
from ...io.meshes import read_surface, write_surface
from ...surfaces.surface import Surface
from .process import Costs, ProgramError, measured
from .spheres import CATSURF, LIMIT, sphere_of, unit_points

FILES = "moving", "moving_sphere", "control", "control_sphere", "out"
RADIUS = 100.0  # of the spheres that a program is given, mm
ANSWERS = {}  # of this process: problems that differ in their curves alone are one to a program


class Answer(NamedTuple):
    """A program's map: `points` (V', 3), where each vertex of the whole moving surface lies on the control's unit
    sphere, and its `costs`."""

    points: np.ndarray
    costs: Costs


def program(problem, command="", limit=LIMIT):
    """The map of a command line such as "tool --in {moving_sphere} --ref {control_sphere} --out {out}", an `Answer`.

    FILES name what it is given, GIFTI: both whole surfaces in mm, both spheres (radius 100, around 0); and where its
    own goes: the moving sphere's faces, each vertex where it lies on the control's sphere. No shell; limit: seconds.
    ProgramError, SphereError, for what it does not do; ImportError where a surface has no sphere and none can be made.
    """
    return by_program(problem, words_of(command), limit)


def spherical_demons(problem, limit=LIMIT):
    """Spherical Demons as CAT12 has it, `cat_surf.spherical_demon` with its defaults, `Answer`; extra `peers`.

    Source: Yeo, Sabuncu, Vercauteren, Ayache, Fischl, Golland (2010), Spherical Demons.
    """
    require("peers", "Spherical Demons")
    return by_program(problem, [*CATSURF, "demons", *(f"{{{name}}}" for name in FILES)], limit)


def words_of(command):
    """The words of a command line, each placeholder checked, or ProgramError."""
    try:
        words = shlex.split(command)
        asked = [name for word in words for _, name, _, _ in Formatter().parse(word) if name is not None]
    except ValueError as error:
        raise ProgramError(f"{command!r} is no command line: {error}") from None
    unknown = sorted(set(asked) - set(FILES))
    if unknown or "out" not in asked:
        what = f"knows no {{{unknown[0]}}}" if unknown else "does not say where {out} goes"
        raise ProgramError(f"{command!r} {what}: write it with {', '.join(f'{{{name}}}' for name in FILES)}")
    return words


def by_program(problem, words, limit):
    """The `Answer` of a command; one that was found in this process is not asked for again for the same surfaces."""
    sides = sphere_of(problem.sides.moving), sphere_of(problem.sides.control)
    asked = tuple(words), limit, *(sphere.fingerprint for sphere in sides)
    if asked not in ANSWERS:
        ANSWERS[asked] = answer_of(words, limit, *sides)
    return ANSWERS[asked]


def answer_of(words, limit, *sides):
    with TemporaryDirectory() as folder:
        paths = {name: str(Path(folder, f"{name}.surf.gii")) for name in FILES}
        for name, sphere in zip(("moving", "control"), sides):
            write_surface(paths[name], sphere.whole)
            write_surface(paths[f"{name}_sphere"], Surface(RADIUS * sphere.points, sphere.whole.faces))
        costs = measured([word.format(**paths) for word in words], limit, paths["out"])
        try:
            found = read_surface(paths["out"])
        except ValueError as error:
            raise ProgramError(f"its sphere cannot be read: {str(error).replace(paths['out'], '{out}')}") from None
    points = unit_points(found.vertices, sides[0].whole, "the sphere that the program wrote")
    if not np.array_equal(found.faces, sides[0].whole.faces):
        raise ProgramError("the sphere that the program wrote has other faces than the moving surface: keep its order")
    return Answer(points, costs)
