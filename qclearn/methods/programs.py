"""Methods that are programs: surfaces and spheres in, a sphere out; and what a process costs."""

import os
import pickle
import shlex
import sys
import time
from collections import namedtuple
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from signal import SIGKILL, Signals
from string import Formatter
from subprocess import DEVNULL, STDOUT
from tempfile import TemporaryDirectory, TemporaryFile

import numpy as np

from ..files.extras import require
from ..files.meshes import read_surface, write_surface
from ..registration.landmarkfile import check_curves
from ..registration.preparation import Sides, laid_upon, sampled
from ..surfaces.conformal import laid_out
from ..surfaces.surface import Surface
from .spheres import CATSURF, LIMIT, Sphere, sphere_of, unit_points

FILES = "moving", "moving_sphere", "control", "control_sphere", "out"
RADIUS = 100.0  # of the spheres that a program is given, mm
ANSWERS = {}  # of this process: problems that differ only in their curves are one to a program
PACKAGES = "OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "ITK_GLOBAL_DEFAULT_NUMBER_OF"
ONE_THREAD = {f"{package}_THREADS": "1" for package in PACKAGES}
PAUSE = 0.02  # seconds between two readings of a program's memory
# CPU seconds of a program and its children, peak memory of the largest of them (read every PAUSE:
# 0 of a program that ends before), time.
Costs = namedtuple("Costs", "cpu_seconds memory_mb seconds")
# points (V', 3) of the whole moving surface on the control's unit sphere, and the `Costs`.
Answer = namedtuple("Answer", "points costs")


class ProgramError(ValueError):
    """A program that cannot be started, fails, takes too long or writes no answer."""


def program(problem, command="", limit=LIMIT):
    """The `Answer` of a command line such as "tool {moving_sphere} {control_sphere} {out}".

    FILES, GIFTI: both whole surfaces in mm, their spheres (radius 100, around 0), and its answer,
    the moving sphere's faces with each vertex where it lies on the control's sphere. No shell;
    limit: seconds. ProgramError, SphereError; ImportError where a sphere cannot be made.
    """
    words = command_words(command)
    spheres = sphere_of(problem.sides.moving), sphere_of(problem.sides.control)
    key = tuple(words), limit, *(sphere.fingerprint for sphere in spheres)
    if key not in ANSWERS:
        ANSWERS[key] = answer_of(words, limit, *spheres)
    return ANSWERS[key]


def spherical_demons(problem, limit=LIMIT):
    """Spherical Demons as CAT12 has it, `cat_surf.spherical_demon`, `Answer`; extra `peers`.

    Source: Yeo, Sabuncu, Vercauteren, Ayache, Fischl, Golland (2010), Spherical Demons.
    """
    require("peers", "Spherical Demons")
    command = shlex.join([*CATSURF, "demons", *(f"{{{name}}}" for name in FILES)])
    return program(problem, command, limit)


def command_words(command):
    """The words of a command line, each placeholder checked, or ProgramError."""
    try:
        words = shlex.split(command)
        names = {name for word in words for _, name, _, _ in Formatter().parse(word)} - {None}
    except ValueError as error:
        raise ProgramError(f"{command!r} is no command line: {error}") from None
    unknown = sorted(names - set(FILES))
    if unknown or "out" not in names:
        fault = f"knows no {{{unknown[0]}}}" if unknown else "does not say where {out} goes"
        allowed = ", ".join(f"{{{name}}}" for name in FILES)
        raise ProgramError(f"{command!r} {fault}: write it with {allowed}")
    return words


def answer_of(words, limit, moving, control):
    whole, whose = moving.whole, "the sphere that the program wrote"
    with TemporaryDirectory() as folder:
        paths = {name: str(Path(folder, f"{name}.surf.gii")) for name in FILES}
        for name, sphere in (("moving", moving), ("control", control)):
            write_surface(paths[name], sphere.whole)
            ball = Surface(RADIUS * sphere.points, sphere.whole.faces)
            write_surface(paths[f"{name}_sphere"], ball)
        costs = measured([word.format(**paths) for word in words], limit, paths["out"])
        try:
            result = read_surface(paths["out"])
        except ValueError as error:
            message = str(error).replace(paths["out"], "{out}")
            raise ProgramError(f"its sphere cannot be read: {message}") from None
    points = unit_points(result.vertices, whole, whose)
    if not np.array_equal(result.faces, whole.faces):
        raise ProgramError(f"{whose} has other faces than the moving surface: keep its order")
    return Answer(points, costs)


def measured(command, limit, out=None):
    """Run a command (list of words) in one thread for at most `limit` seconds: its `Costs`.

    ProgramError where it cannot be started, fails, is not done by then, or has not written the
    file `out`. What it leaves running is killed. POSIX alone.
    """
    with require("benchmark", "measured programs"):
        import psutil
    name, start = Path(command[0]).name, time.monotonic()
    children, search, peak = [], 0.0, 0
    with TemporaryFile() as log:
        group = {"env": os.environ | ONE_THREAD, "start_new_session": True}
        try:
            process = psutil.Popen(command, stdin=DEVNULL, stdout=log, stderr=STDOUT, **group)
        except OSError as error:
            reason = f"{error.strerror}: {command[0]}"
            raise ProgramError(f"{name} cannot be started ({reason}); check the command") from None
        try:
            while process.status() != psutil.STATUS_ZOMBIE and time.monotonic() < start + limit:
                for member in [process, *children]:
                    with suppress(psutil.Error):
                        peak = max(peak, member.memory_info().rss)
                time.sleep(PAUSE)
                now = time.monotonic()
                if now > search:  # reads all the machine's processes: a tenth of the time at most
                    children = process.children(recursive=True)
                    search = now + 10 * (time.monotonic() - now)
            late = process.status() != psutil.STATUS_ZOMBIE
            cpu_seconds = sum(process.cpu_times()[:4])  # user's and system's, own and children's
            costs = Costs(cpu_seconds, peak / 2**20, time.monotonic() - start)
        finally:
            with suppress(OSError):
                os.killpg(process.pid, SIGKILL)
            status = process.wait()
        log.seek(0)
        lines = log.read()[-10_000:].decode(errors="replace").strip().splitlines() or ["none"]
    how = f"with the status {status}" if status >= 0 else f"by the signal {Signals(-status).name}"
    if late:
        advice = "give it more time with the limit"
        raise ProgramError(f"{name} was not done after {limit:g} s and was stopped; {advice}")
    if status:
        raise ProgramError(f"{name} ended {how}; its last words: {lines[-1][-300:]}")
    if out is not None and not Path(out).exists():
        raise ProgramError(f"{name} ended without an error and wrote no sphere to {{out}}")
    return costs


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
    sides = [replace(laid_out(one), sphere=sphere and Sphere(one, sphere)) for one, sphere in pairs]
    sides = Sides(*sides, check_curves(curves, pairs[0][0], pairs[1][0]), [])
    METHODS[method](replace(sampled(laid_upon(sides)).problem, sides=sides), **parameters)
