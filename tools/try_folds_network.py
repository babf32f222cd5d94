"""Try a network that sees the folds as the start of the hybrid fit: is time saved at equal held-out error?

    python tools/try_folds_network.py --out qclearn/benchmark/kept/foldsnet.json

What it sees, on a polar mesh: depth and curvature of the moving surface at two scales, and the control's where the
present map takes the nodes. What it gives is the change of nu that is still to come. After each answer it may look
again, at the residual of the exact map. Trained by imitation: half of the examples are fits by folds of pairs of
synthetic subjects, stopped anywhere on the way, half are subjects and their own images under random maps. Judged on
real pairs: the fit without its coarse levels, from there and from the Möbius map. Examples are kept beside the cohort.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from platformdirs import user_cache_path
from threadpoolctl import threadpool_limits
from torch import nn
from tqdm import tqdm

from data_synth.fields import KINDS, random_coefficient
from qclearn.benchmark.cortex import HALVES, fsaverage_side, heldout_pair, warp_pair
from qclearn.benchmark.pairs import cohort_pair, mapped_subject, prepare
from qclearn.benchmark.trial import map_figures
from qclearn.files.meshes import write_whole
from qclearn.files.provenance import provenance
from qclearn.methods.folds import features_of
from qclearn.nets.layers import PolarUNet
from qclearn.nets.polargrid import PolarGrid
from qclearn.plane.beltrami import face_mean
from qclearn.plane.disk import BeltramiDiskSolver
from qclearn.plane.diskmesh import Lookup, interpolate, polar_disk, sampling_matrix
from qclearn.plane.fields import bounded
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.registration.fit import POWER, start_field
from qclearn.registration.hybrid import LEVELS, fit_registration
from qclearn.registration.problem import DELTA, Problem, Weights

RINGS, SPOKES = 24, 72
SCALES = 16.0, 8.0  # mm
GRID, MESH = polar_disk(RINGS, SPOKES, POWER), polar_disk(32, 96, POWER)  # of nu, and of the maps on the way
CHANNELS, BLOCKS = (24, 48, 96), 3
SUBJECTS, VALIDATION, VERTICES = range(2001, 2041), range(2041, 2047), 10_000
BATCH, RATE, WEIGHT_DECAY = 16, 2e-3, 1e-3
FLOOR = 1e-3
KEPT = "held_out_mm", "correspondence_mm", "r_depth", "landmark_error_mm", "log2_area", "flipped"


class FoldsNet(nn.Module):
    """The change of nu (B, rings, spokes) from folds (B, 8, rings, spokes), both in the frame of each spoke."""

    def __init__(self):
        super().__init__()
        self.grid = PolarGrid(RINGS, SPOKES, modes=8)
        self.unet = PolarUNet(2 * 2 * len(SCALES) + 1, 2, CHANNELS, BLOCKS)
        self.register_buffer("spoke", self.grid.z / self.grid.z.abs(), persistent=False)

    def forward(self, folds):
        radius = self.grid.radius[1:, None].expand(len(folds), 1, RINGS, SPOKES)
        return torch.complex(*self.unet(torch.cat([folds, radius], 1)).unbind(1))

    def error(self, folds, change):
        """Share of the squared change that the answer leaves, (B,)."""
        left, whole = (self.grid.terms(x)[0] for x in (self(folds) - change, change))
        return left / (whole + FLOOR)


NODES = GRID[0][1:]
FRAME = (NODES / abs(NODES)) ** 2
INNER = 0.999 * NODES  # within every polygon whose corners are on the circle


class Folds:
    """Features of a pair of sides at the nodes, those of the control where a map takes them."""

    def __init__(self, problem, features):
        self.features = features
        at = sampling_matrix(problem.z, problem.faces, INNER)
        self.there = [features.at(sigma)[1] for sigma in SCALES]
        self.here = np.concatenate([at @ features.at(sigma)[0] for sigma in SCALES], axis=1)

    def seen(self, images):
        """(8, rings, spokes) for images (N,) of the nodes."""
        places = self.features.lookup(images)
        there = [interpolate(values, self.features.faces, *places) for values in self.there]
        return as_images(self.here, np.concatenate(there, axis=1))


class Maps:
    """Where the exact map of nu (N + 1,), at the grid's vertices, takes its nodes."""

    def __init__(self):
        self.solver, self.at = BeltramiDiskSolver(*MESH), sampling_matrix(*MESH, INNER)
        self.to_faces = face_mean(MESH[1], len(MESH[0])) @ sampling_matrix(*GRID, MESH[0])

    def __call__(self, nu):
        return self.at @ self.solver.solve(bounded(self.to_faces @ nu))


def examples(count, subjects, seed):
    """(folds (n, 8, rings, spokes), changes of nu (n, rings, spokes) in the frame): fits of pairs and known maps."""
    rng, maps, found = np.random.default_rng(seed), Maps(), []
    for _ in tqdm(range(count)):
        moving, control = (mapped_subject(int(one), VERTICES) for one in rng.choice(subjects, 2, replace=False))
        problem = prepare(cohort_pair(moving, control)).problem
        folds = Folds(problem, features_of(problem))
        found += [*fitted(problem, folds, maps, rng), *known(folds, maps, rng)]
    return [np.stack(part) for part in zip(*found)]


def fitted(problem, folds, maps, rng):
    """Two examples of a fit by folds: from its beginning, and from somewhere on the way."""
    alone = Problem(problem.z, problem.faces, [], [], fewest=0)
    fit = fit_registration(alone, Weights(delta=DELTA), folds.features)
    end = start_field(problem.z, problem.faces, fit.mu, GRID[0])
    images = sampling_matrix(problem.z, problem.faces, INNER) @ fit.f
    for share in (0.0, rng.uniform(0, 0.9)):
        f = maps(share * end)
        yield folds.seen(within(mobius(f, *best_mobius(f, images)))), turned((1 - share) * end)


def known(folds, maps, rng):
    """Two of a moving surface and its own image under a random map, which is what a fit should find."""
    mu = random_coefficient(*MESH, rng, kind=rng.choice(KINDS), max_abs=(0.1, 0.5))
    end, f = start_field(*MESH, mu, GRID[0]), maps.solver.solve(mu).copy()
    values, back = np.concatenate([folds.here[:SPOKES].mean(0)[None], folds.here]), Lookup(f, MESH[1])
    for share in (0.0, rng.uniform(0, 0.9)):
        places = interpolate(*MESH, *back(within(maps(share * end))))
        there = sampling_matrix(*GRID, within(places)) @ values
        yield as_images(folds.here, there), turned((1 - share) * end)


def as_images(here, there):
    return np.concatenate([here, there], axis=1).T.reshape(-1, RINGS, SPOKES).astype(np.float32)


def turned(nu):
    """nu (N + 1,) at the nodes in the frame of each spoke."""
    return (nu[1:] * FRAME.conj()).reshape(RINGS, SPOKES).astype(np.complex64)


def within(points):
    return points * np.minimum(1, 0.999 / np.maximum(abs(points), 1e-12))


def kept_examples(options):
    """Those to learn from and those to judge by, drawn once and kept."""
    folder, sets = user_cache_path("qclearn") / "training" / "folds", []
    folder.mkdir(parents=True, exist_ok=True)
    for subjects, count in ((SUBJECTS, options.pairs), (VALIDATION, max(1, options.pairs // 16))):
        file = folder / f"{min(subjects)}-{count}.npz"
        if not file.exists():
            folds, changes = examples(count, list(subjects), count)
            write_whole(file, lambda place, x=folds, y=changes: np.savez(place, x=x, y=y))
        kept = np.load(file)
        sets.append(tuple(torch.from_numpy(kept[name]) for name in "xy"))
    return sets


def trained(sets, steps):
    """(network, [[step, error of the validation examples]], seconds): cosine schedule, spokes turned and mirrored."""
    torch.manual_seed(0)
    (folds, changes), fresh = sets
    net, curve, start = FoldsNet(), [], time.process_time()
    optimiser = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in tqdm(range(1, steps + 1)):
        some, by = torch.randint(len(folds), (BATCH,)), int(torch.randint(SPOKES, (1,)))
        x, y = folds[some].roll(by, -1), changes[some].roll(by, -1)
        if torch.rand(()) < 0.5:
            x, y = x.flip(-1), y.flip(-1).conj()
        loss = (net.error(x, y) + FLOOR).log().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % (steps // 20 or 1) == 0:
            with torch.inference_mode():
                curve.append([step, net.error(*fresh).sqrt().mean().item()])
            tqdm.write(json.dumps(curve[-1]))
    return net.eval(), curve, time.process_time() - start


@torch.inference_mode()
def answer(net, problem, features, looks):
    """mu (F,) after a first answer and so many looks at the residual of its exact map."""
    folds, maps, nu = Folds(problem, features), Maps(), np.zeros(len(NODES) + 1, complex)
    at = problem.moving if len(problem.moving) else None
    for _ in range(looks + 1):
        f = maps.solver.solve(bounded(maps.to_faces @ nu))
        if at is not None:
            f = mobius(f, *best_mobius(sampling_matrix(*MESH, at) @ f, problem.target))
        change = net(torch.from_numpy(folds.seen(within(maps.at @ f)))[None])[0].numpy().ravel() * FRAME
        nu = nu + np.concatenate([[change[:SPOKES].mean()], change])
    return bounded(sampling_matrix(*GRID, problem.z[problem.faces].mean(1)) @ nu)


def real_pairs():
    """(name, Pair): fsaverage5's sides with half of the curves held out, and warped in space."""
    left, right = fsaverage_side("left"), fsaverage_side("right")
    for name, moving, control in (("right to left", right, left), ("left to right", left, right)):
        for part in HALVES:
            yield f"{name}, {part}", heldout_pair(moving, control, part)
    for amplitude in (6.0, 9.0):
        yield f"warp of {amplitude:g} mm", warp_pair(left, amplitude)


def judged(net):
    """A row for each way on each pair. The levels that are left out are the coarsest."""
    rows = []
    for name, pair in real_pairs():
        prepared, lookup = prepare(pair), Lookup(pair.control.z, pair.control.surface.faces)
        problem = prepared.problem
        for skipped in (0, 2, 3):
            for looks in (None,) if skipped == 0 else (None, 0, 1, 2):
                start = time.process_time()
                features = features_of(problem)
                mu = None if looks is None else answer(net, problem, features, looks)
                fit = fit_registration(problem, Weights(delta=DELTA), features, mu, levels=LEVELS[skipped:])
                seconds = time.process_time() - start
                figures = map_figures(pair, prepared, fit.f, lookup, False)
                row = {"pair": name, "skipped": skipped, "looks": looks, "seconds": seconds, "steps": fit.steps}
                rows.append(row | {key: figures[key] for key in KEPT})
                print(json.dumps(rows[-1]), flush=True)
    return rows


def main():
    options, made = read_options(), provenance()
    torch.set_num_threads(1)
    with threadpool_limits(1):
        net, curve, seconds = trained(kept_examples(options), options.steps)
        figures = {"curve": curve, "seconds": seconds, "pairs": options.pairs, "rows": judged(net), "provenance": made}
    if options.out:
        text = json.dumps(figures, indent=1) + "\n"
        write_whole(options.out, lambda place: place.write_text(text, encoding="utf-8"))


def read_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=400, help="pairs of subjects, four examples each")
    parser.add_argument("--steps", type=int, default=4000)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    return parser.parse_args()


if __name__ == "__main__":
    main()
