"""Measure whole chains of registration at three sizes: fsaverage5 as it is, and with its faces
split once and twice.

    python -m book.studies.sizes --out sizes.json

CPU seconds of one thread, the least of the repetitions. All chains begin with the two disk maps and
LD-Net's landmarks. Then come the paper's networks; in DBS-Net's place conjugate gradients on the
polar mesh, stopped at an error no larger, and the exact solver; and the harmonic map at two
weights. The paper's CP-Net knows its own control alone: it is given that control's landmarks, moved
as far as fsaverage5's lie apart. All landmarks are vertices of fsaverage5, the same at each size.

Folds alone stand in a list of their own: `register` without landmarks, each pair in a process of
its own, which reads the two surfaces. The synthetic ones are grown first where they are missing,
which is not measured and takes about three minutes for one of 80,000 vertices.
"""

import argparse
import sys
import time
import warnings
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from data_synth import hemispheres
from qclearn.benchmark.measured import write_measured
from qclearn.benchmark.methods.harmonic import unfold
from qclearn.benchmark.methods.solver import LandmarkSolver
from qclearn.io.fsaverage import fsaverage5, named_sulci
from qclearn.io.meshes import write_surface
from qclearn.io.provenance import provenance
from qclearn.nets import load
from qclearn.nets.layers import PolarFunction
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import Disk
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.plane.solver import DiskSolver
from qclearn.registration.curves import fundus_metric, fundus_path
from qclearn.registration.fit import exact_map, moved_map
from qclearn.registration.problem import Problem, Weights
from qclearn.surfaces.conformal import parameterize
from qclearn.surfaces.surface import Surface, mirror

from .evaluation.dbsnet import displacement
from .peers import measured

REPETITIONS = {0: 5, 1: 3, 2: 2}  # by the number of splits
PAPER, WEIGHTS = Weights(1.0, 1.0, 2e5), (0.1, 5.0)  # of the paper's CP-Net, and lambda of the harmonic maps
STEPS = 100  # of conjugate gradients, at most
POINTS = 10  # of a curve
GROWN, SUBJECTS = (20_000, 80_000), (1001, 1002)  # vertices of the synthetic surfaces of folds alone
FOLDS_ALONE = """
import sys
import qclearn as qc
result = qc.register(*map(qc.read_surface, sys.argv[1:]), [])
sys.exit(result.report["stopped"])  # None, or why nothing was fitted: then the process fails
"""
SULCI = (  # in the order that the paper's networks were trained on
    *("central sulcus", "sylvian fissure", "superior temporal sulcus", "calcarine sulcus"),
    *("parieto-occipital sulcus", "intraparietal sulcus", "cingulate sulcus", "superior frontal sulcus"),
)


def read_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="JSON file to write")
    return parser.parse_args()


def main():
    out = read_options().out
    torch.set_num_threads(1)
    surfaces = mirror(fsaverage5("right")), fsaverage5("left")
    marks = [landmarks(*pair) for pair in zip(surfaces, ("right", "left"))]
    rows, maps, repetitions = [], [], {}
    with threadpool_limits(1), torch.no_grad():
        chains(surfaces, marks, Clock())  # not counted: loads weights and code
        for cuts, count in REPETITIONS.items():
            sides, clock, found = [cut(surface, cuts) for surface in surfaces], Clock(), {}
            for _ in range(count):
                found = chains(sides, marks, clock)
                clock.keep_the_least()
            vertices = len(sides[0].vertices)
            repetitions[vertices] = count
            rows += [
                {"vertices": vertices, "chain": chain, "stage": stage, "seconds": seconds}
                for (chain, stage), seconds in clock.least.items()
            ]
            maps += [{"vertices": vertices, "chain": chain, **figures} for chain, figures in found.items()]
    figures = {"rows": rows, "maps": maps, "landmarks": POINTS * len(SULCI), "repetitions": repetitions, "threads": 1}
    figures["folds"] = folds({"fsaverage5": sides})
    write_measured("sizes", out, figures | {"provenance": provenance()})


def landmarks(surface, hemisphere):
    """Vertices (curves, points) of a side of fsaverage5 along its shortest fundus paths."""
    ends, metric = named_sulci(hemisphere, surface.original_vertices), fundus_metric(surface)
    paths = [fundus_path(surface, *ends[name], metric) for name in SULCI]
    return np.array([path[np.linspace(0, len(path) - 1, POINTS).round().astype(int)] for path in paths])


def cut(surface, times):
    """A surface with each face cut into four, so many times; its vertices keep their numbers."""
    for _ in range(times):
        n, edges = len(surface.vertices), surface.edges
        keys = edges[:, 0] * n + edges[:, 1]
        ends = np.sort(np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=-1), axis=-1)
        middle = n + np.searchsorted(keys, ends[..., 0] * n + ends[..., 1])
        a, b, c = surface.faces.T
        ab, bc, ca = middle.T
        faces = np.concatenate([np.stack(f, axis=1) for f in ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))])
        surface = Surface(np.concatenate([surface.vertices, surface.vertices[edges].mean(1)]), faces)
    return surface


def folds(pairs):
    """Rows of folds alone for the synthetic pairs and pairs (dict name -> two surfaces)."""
    rows = []
    grown = [("synthetic", [one.surface for one in hemispheres(SUBJECTS, count)]) for count in GROWN]
    for name, pair in [*grown, *pairs.items()]:
        with TemporaryDirectory() as place:
            paths = [str(Path(place, f"{side}.npz")) for side in ("moving", "control")]
            for path, surface in zip(paths, pair):
                write_surface(path, surface)
            took = measured([sys.executable, "-W", "ignore", "-c", FOLDS_ALONE, *paths])
        costs = {"seconds": took["cpu_seconds"], "peak_memory_mb": took["memory_mb"]}
        rows.append({"vertices": len(pair[0].vertices), "surfaces": name, **costs})
    return rows


class Clock:
    """Seconds of the stages of chains, the least of several repetitions; parts of one stage add up."""

    def __init__(self):
        self.least, self.now = {}, {}

    def __call__(self, chains, stage, task, *arguments):
        """What task(*arguments) returns; its time goes to the stage of each of the chains."""
        start = time.process_time()
        found = task(*arguments)
        passed = time.process_time() - start
        for chain in chains:
            self.now[chain, stage] = self.now.get((chain, stage), 0.0) + passed
        return found

    def keep_the_least(self):
        self.least = {key: min(seconds, self.least.get(key, np.inf)) for key, seconds in self.now.items()}
        self.now = {}


NETWORKS, GRADIENTS, EXACT = "networks", "conjugate gradients", "exact solver"
HARMONIC = {f"harmonic {weight:g}": weight for weight in WEIGHTS}
EVERY = NETWORKS, GRADIENTS, EXACT, *HARMONIC


def chains(surfaces, marks, clock):
    """All chains on two surfaces once: chain -> figures of its map."""
    sides = [clock(EVERY, "disk maps", parameterize, surface) for surface in surfaces]
    detect = load("ldnet", "paper").detect
    for side, vertices in zip(sides, marks):
        clock(EVERY, "landmarks", detect, side.surface, side.disk.z, vertices[:, [0, -1]])
    moving, control = (side.disk.z[vertices.ravel()] for side, vertices in zip(sides, marks))
    curve, disk = np.repeat(np.arange(len(SULCI)), POINTS), sides[0].disk
    predict = load("cpnet", "paper", PAPER.gamma)
    known = predict.targets.numpy().astype(complex)
    apart = mobius(moving, *best_mobius(moving, control)) - control
    asked = Problem(disk, known + apart, known, curve)
    # In DBS-Net's place the fewest steps that come as near to the exact map.
    wanted = DiskSolver(disk).solve(predict.answer(asked, PAPER))
    paper, polar = load("dbsnet", "paper"), load("dbsnet", "best")
    chain = partial(resampled, asked, wanted, predict)
    found = {NETWORKS: chain(NETWORKS, ("DBS-Net", paper.pixels, paper.run), clock)}
    solvers = ((GRADIENTS, polar.pixels, partial(stopped, polar, steps)) for steps in range(1, STEPS + 1))
    goal = found[NETWORKS]["error"]
    steps, rival = next(one for one in enumerate(solvers, 1) if chain(GRADIENTS, one[1], Clock())["error"] <= goal)
    found[GRADIENTS] = chain(GRADIENTS, rival, clock) | {"steps": steps}
    found[EXACT] = exact(asked, predict, clock)
    problem = Problem(disk, moving, control, curve)
    return found | {chain: harmonic(problem, chain, weight, clock) for chain, weight in HARMONIC.items()}


def fresh(problem):
    """The problem on a mesh of which nothing is known yet."""
    return Problem(Disk(problem.disk.z, problem.disk.faces), problem.moving, problem.target, problem.curve)


def resampled(problem, wanted, predict, chain, solver, clock):
    """CP-Net, a solver (stage, pixels, function of mu there) between two resamplings, the
    certificate, and the exact solver's map where that refuses. "error": of the map as it comes,
    from `wanted`."""
    problem, own, (stage, pixels, run) = fresh(problem), [chain], solver
    mu = clock(own, "CP-Net", predict.answer, problem, PAPER)
    image = clock(own, "resampling", lambda: mu[problem.disk.locate(pixels)[0]])
    picture = clock(own, stage, run, image)
    f = clock(own, "resampling", picture, problem.disk.z)
    first = clock(own, "certificate", moved_map, problem, f)
    last = clock(own, "correction", lambda: first if first.bijective else exact_map(problem, mu))
    error = abs(f - wanted).mean() / displacement(wanted[None], problem.disk.z)[0]
    return figures(problem, first.f, last.f) | {"error": error}


def stopped(net, steps, mu):
    """The map of mu (F,) on the network's polar mesh after steps of conjugate gradients alone, as a
    function of points."""
    f = net.solver.solve(torch.from_numpy(mu).to(net.z)[None], 0.0, steps)
    return PolarFunction((f[:, 1:].view(net.z.shape) / net.z)[0].numpy())


def exact(problem, predict, clock):
    """The same with the exact solver in DBS-Net's place; certificate and correction are its own."""
    problem, own = fresh(problem), [EXACT]
    mu = clock(own, "CP-Net", predict.answer, problem, PAPER)
    found = clock(own, "exact solver", exact_map, problem, mu)
    return figures(problem, found.f, found.f)


def harmonic(problem, chain, weight, clock):
    """The harmonic map with soft landmarks, its overlap correction and the certificate."""
    problem, own = fresh(problem), [chain]
    solver = clock(own, "harmonic map", LandmarkSolver, problem)
    first = clock(own, "harmonic map", solver.solve, np.zeros(len(problem.disk.faces), complex), weight)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RepairWarning)
        last = clock(own, "correction", unfold, solver, first, np.exp(-np.sqrt(weight) / 4))
    clock(own, "certificate", problem.disk.certify, last)
    return figures(problem, first, last)


def figures(problem, first, last):
    """Folds of a map before and after its correction, and its landmark error."""
    flipped = [len(problem.disk.at(f).maybe_flipped) for f in (first, last)]
    error = abs(problem.samples @ last - problem.target).mean()
    return {"flipped_before": flipped[0], "flipped": flipped[1], "landmark_error": error}


if __name__ == "__main__":
    main()
