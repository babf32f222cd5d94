"""Measure Spherical Demons and the best rotation of spheres beside our fits, and what each costs as a whole process.

    python -m book.studies.peers --out FILE.json [--set heldout --set folder:DIR ...]

Needs the extra `peers`. cat-surf is under the GPL: a program in a process of its own. First come the rows of the
benchmark, then the CPU seconds and the memory of each as a process that reads two surfaces and ends with the map;
methods of spheres are given these. A stopped run goes on at the commit that it began with.
"""

import hashlib
import os
import pickle
import shutil
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from subprocess import DEVNULL, STDOUT
from tempfile import TemporaryDirectory, TemporaryFile

import click
import psutil
from tqdm import tqdm

from data_synth.cohort import GENERATION
from qclearn.benchmark.measured import BenchmarkError, read_json, write_measured
from qclearn.benchmark.methods import METHODS
from qclearn.benchmark.methods.spheres import Sphere, unit_points
from qclearn.benchmark.pairs import mapped_subject
from qclearn.benchmark.problems import problems
from qclearn.benchmark.run import benchmark
from qclearn.benchmark.runs import FOLDED, RUNS, Run
from qclearn.io.extras import require
from qclearn.io.meshes import read_surface, write_surface
from qclearn.io.provenance import commit
from qclearn.registration.curves import check_curves
from qclearn.registration.start import SurfacePair, align_disks, sample_landmarks
from qclearn.surfaces.conformal import parameterize
from qclearn.surfaces.surface import Surface

from .parts import Parts

LIMIT = 3600.0  # seconds that a program may take
VERTICES = 10_000  # of a synthetic subject
RADIUS = 100.0  # of the spheres that a program is given, mm
PAUSE = 0.02  # seconds between two readings of a program's memory
PACKAGES = "OMP_NUM", "OPENBLAS_NUM", "MKL_NUM", "ITK_GLOBAL_DEFAULT_NUMBER_OF"
ONE_THREAD = {f"{package}_THREADS": "1" for package in PACKAGES}
PEER = "Spherical Demons"
OURS = "Möbius", "Gauss-Newton", "hybrid", "landmark-free"
DEMONS = """
import sys
import cat_surf
*given, out = sys.argv[1:]
# Its defaults, its own search for a rotation among them.
cat_surf.write_surface(out, *cat_surf.spherical_demon(*map(cat_surf.read_surface, given)))
"""


def measured(command, limit=LIMIT):
    """Run a command (list) in one thread for at most `limit` seconds: what it took, dict.

    "cpu_seconds", user's and system's, with its children's; "memory_mb", the peak of the largest of its processes,
    read every PAUSE; "seconds". BenchmarkError where it fails or is not done by then. What it leaves running is killed.
    """
    start, children, search, peak = time.monotonic(), [], 0.0, 0
    with TemporaryFile() as log:
        group = {"env": os.environ | ONE_THREAD, "start_new_session": True}
        process = psutil.Popen(command, stdin=DEVNULL, stdout=log, stderr=STDOUT, **group)
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
            cpu_seconds = sum(process.cpu_times()[:4])  # user's and system's, own and children's
            seconds = time.monotonic() - start
        finally:
            with suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)
            status = process.wait()
        log.seek(0)
        last = log.read()[-300:].decode(errors="replace").strip().rpartition("\n")[2]
    if status:
        raise BenchmarkError(f"{Path(command[0]).name} ended with {status} after {seconds:.0f} s: {last}")
    return {"cpu_seconds": cpu_seconds, "memory_mb": peak / 2**20, "seconds": seconds}


def spherical_demons(folder, problem):
    """Spherical Demons as CAT12 has it, `cat_surf.spherical_demon`: points (V', 3) on the control's sphere.

    folder: keeps its answers, as problems that differ only in their curves are one to it. Source: Yeo, Sabuncu,
    Vercauteren, Ayache, Fischl, Golland (2010), Spherical Demons.
    """
    return answer_of(folder, problem.pair.moving.sphere, problem.pair.control.sphere)["points"]


def answer_of(folder, moving, control):
    """The program's answer for two `Sphere`s, kept in the folder: its points and what it took, dict."""
    meshes = []
    for sphere in (moving, control):
        meshes += [sphere.whole, Surface(RADIUS * sphere.points, sphere.whole.faces)]
    key = hashlib.sha256("".join(mesh.fingerprint["sha256"] for mesh in meshes).encode()).hexdigest()
    kept = Path(folder, f"{key}.pickle")
    if not kept.exists():
        with TemporaryDirectory() as place:
            paths = [str(Path(place, f"{k}.surf.gii")) for k in range(5)]
            for path, mesh in zip(paths, meshes):
                write_surface(path, mesh)
            costs = measured([sys.executable, "-P", "-c", DEMONS, *paths])
            points = unit_points(read_surface(paths[4]).vertices, moving.whole, "the sphere of Spherical Demons")
        kept.write_bytes(pickle.dumps({"points": points, "costs": costs}))
    return pickle.loads(kept.read_bytes())


def costs_of(run, pair, folder):
    """What the program takes, or a process that makes both disk maps and runs our run on a pair, dict."""
    if run.name == PEER:
        return answer_of(folder, pair.moving.sphere, pair.control.sphere)["costs"]
    sides = []
    for side in (pair.moving, pair.control):
        sphere = (side.sphere.whole, side.sphere.points) if run.method == "rotation" else None
        sides.append((Surface(side.surface.vertices, side.surface.faces), sphere))
    with TemporaryDirectory() as place:
        task = Path(place, "task.pickle")
        task.write_bytes(pickle.dumps((run.method, run.parameters, pair.curves, sides)))
        code = "import sys; from book.studies.peers import run_task; run_task(sys.argv[1])"
        return measured([sys.executable, "-W", "ignore", "-c", code, str(task)])


def run_task(path):
    """What the process of `costs_of` does: surfaces in, disk maps, the method."""
    method, parameters, curves, pairs = pickle.loads(Path(path).read_bytes())
    sides = [replace(parameterize(one), sphere=sphere and Sphere(one, sphere)) for one, sphere in pairs]
    entries = check_curves(curves, *(side.surface for side in sides))
    sides = SurfacePair(*sides, entries, [])
    METHODS[method](replace(sample_landmarks(align_disks(sides)), pair=sides), **parameters)


@click.command(help=__doc__)
@click.option("--out", required=True)
@click.option("--set", "sets", multiple=True, default=["heldout", "conte69", "fsaverage5", "warp", "cohort"])
@click.option("--subjects", default=12, show_default=True, help="Of the cohort.")
@click.option("--workers", default=2, show_default=True)
def main(out, sets, subjects, workers):
    require("peers", "Spherical Demons")
    settings = {"sets": sets, "subjects": subjects, "commit": commit()}
    parts = Parts(f"{out}.parts", settings, BenchmarkError)
    folder = parts.path.absolute()
    runs = {run.name: run for run in RUNS if run.name in OURS}
    runs["rotation"] = Run("rotation", "rotation", sets=FOLDED)
    runs[PEER] = Run(PEER, "spherical_demons", sets=FOLDED)
    first, methods = folder / "rows.json", METHODS | {"spherical_demons": partial(spherical_demons, folder)}
    if not first.exists():
        limits = {"workers": workers, "limit": 3 * LIMIT}  # a row has a way back, too
        benchmark(first, subjects, VERTICES, sets, runs.values(), methods, **limits)
    figures = read_json(first, "peers")
    side_of = cache(lambda make, *given: make(*given))
    for spec in tqdm(problems(subjects, sets), disable=None):
        grown = VERTICES, None, GENERATION
        sides = [side_of(*one, *(grown if one[0] is mapped_subject else ())) for one in spec.sides]
        pair = spec.make(*sides, *spec.options)
        for row in figures["rows"]:
            if (row["pair"], row["status"]) == (spec.pair, "done") and row["set"] == spec.set:
                name = f"{row['set']}, {row['pair']}, {row['run']}.json"
                costs = parts.json(name, partial(costs_of, runs[row["run"]], pair, folder))
                row |= {key: costs[key] for key in ("cpu_seconds", "memory_mb")}
                if row["run"] == PEER:
                    row["seconds"]["map"] = costs["seconds"]
    figures["provenance"]["versions"]["cat-surf"] = version("cat-surf")
    write_measured("peers", out, figures)
    shutil.rmtree(folder)


if __name__ == "__main__":
    main()
