"""Train a network that sees the folds of both sides, and measure what its map spares the fit with folds.

    python tools/folds_network.py --out qclearn/benchmark/kept/foldsnetwork.json

The network looks at images of depth and curvature of both sides on a polar mesh and says where each node should move.
The Beltrami coefficient of that, smoothed, has an exact map, at which it looks again. It learns from cortices moved by
random maps, some of them mixed with another one's folds, and from pairs of synthetic subjects, whose true map is known.
Judged on real cortex: half of fsaverage5's curves held out, or all but one, and its left side warped in space. The same
levels of the fit are run from the network's map and from the Möbius map. It goes on where it was stopped; one thread;
about half an hour of one core. The page 'Folds as features' reads the file.
"""

import argparse
import csv
import json
import os
import time
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import numpy as np
import torch
from platformdirs import user_cache_path
from threadpoolctl import threadpool_limits
from torch import nn

from data_synth.correspondence import locate_on_sphere
from data_synth.datasets import Seeded, cached, quiet_disk_map
from data_synth.fields import random_coefficient
from data_synth.generations import GENERATION
from data_synth.landmarks import DiskMaps
from data_synth.training import TRAINING_SEEDS, VALIDATION_SEEDS, subjects
from qclearn.benchmark.cortex import AMPLITUDES, HALVES, fsaverage_side, heldout_pair, warp_pair
from qclearn.benchmark.pairs import prepare
from qclearn.benchmark.trial import map_figures
from qclearn.files.meshes import write_whole
from qclearn.files.provenance import provenance
from qclearn.methods.folds import features_of
from qclearn.nets.layers import PolarUNet, inference
from qclearn.nets.polargrid import PolarGrid, random_turns
from qclearn.nets.train import TrainConfig, train
from qclearn.plane.beltrami import beltrami_coefficient, corner_average, signed_areas
from qclearn.plane.disk import BeltramiDiskSolver
from qclearn.plane.diskmesh import Lookup, interpolate, polar_disk, sampling_matrix
from qclearn.plane.fields import bounded, unbounded
from qclearn.plane.mobius import mobius
from qclearn.plane.spectrum import Spectrum
from qclearn.registration.certified import exact_map
from qclearn.registration.features import FOLDS, Smoothing, standardised
from qclearn.registration.fit import POWER
from qclearn.registration.hybrid import LEVELS, fit_registration
from qclearn.registration.looks import refit
from qclearn.registration.problem import DELTA, Weights
from qclearn.surfaces.curvature import mean_curvature, sulcal_depth

FOLDER = user_cache_path("qclearn") / "training"
SCALES = (16.0, 8.0)  # mm, of the folds that it sees
SLOPE = 0.1  # a length in the disk: of errors that differ from node to node over less, the difference counts
FLOOR = 1e-4  # mean squared displacement below which there is nothing to learn
ASTRAY = 0.3  # of a random map's displacement: by how much a look is off the way, in training
LARGEST = 0.8  # |mu| of the coefficient that is read off its displacements
SMOOTHER = 1e-3  # by 1 + SMOOTHER Laplace it is divided
RECIPE = TrainConfig(steps=20_000, batch=8, rate=2e-3, weight_decay=1e-2, validate_every=1_000)
REPETITIONS = 3
SUBJECTS, ITEMS = (96, 12), (12_000, 192)  # for training and for validation
KEPT = (
    "held_out_mm",
    "worst_held_out_mm",
    "correspondence_mm",
    "landmark_error_mm",
    "r_depth",
    "flipped",
)


@dataclass(frozen=True)
class FoldsConfig:
    """Sizes of the network."""

    rings: int = 24
    spokes: int = 72
    channels: tuple = (16, 32, 64)
    blocks: int = 2
    looks: int = 2


class FoldsNet(nn.Module):
    """Displacements (B, rings, spokes) of a polar mesh's nodes from images (B, C, rings, spokes) of both sides."""

    def __init__(self, config=FoldsConfig()):
        super().__init__()
        self.config, self.grid = config, PolarGrid(config.rings, config.spokes)
        self.unet = PolarUNet(2 * len(SCALES) * len(FOLDS) + 1, 2, config.channels, config.blocks)
        self.register_buffer("spoke", self.grid.z / self.grid.z.abs(), persistent=False)

    def forward(self, here, there):
        radius = self.grid.radius[1:, None].expand_as(here[:, :1])
        change = self.unet(torch.cat([here, there, radius], 1)).float()
        return 0.1 * torch.complex(*change.unbind(1)) * self.spoke

    def loss(self, batch, generator):
        """Mean of the squared error and of its slope over those of the displacement."""
        with torch.autocast(batch[0].device.type, enabled=False):
            *images, wanted = self.turned(batch, generator)
        found = self(*images)
        sizes, slopes = zip(*(self.grid.terms(field) for field in (found - wanted, wanted)))
        error, before = (size + SLOPE**2 * slope for size, slope in zip(sizes, slopes))
        share = error / (before + FLOOR)
        return share.mean(), {"error": (sizes[0].sum() / sizes[1].sum()).sqrt().item()}

    def turned(self, batch, generator):
        """The batch; with a generator turned by whole spokes, and mirrored."""
        here, there, wanted = batch
        if generator is None:
            return batch
        turn, mirror, places = random_turns(len(here), self.config.spokes, generator)
        places = places[:, None].expand(wanted.shape)
        here, there = (x.gather(3, places[:, None].expand(x.shape)) for x in (here, there))
        wanted = torch.where(mirror[:, None, None], wanted.conj(), wanted).gather(2, places)
        return here, there, wanted * turn.to(wanted)[:, None, None]

    @inference
    def displacements(self, here, there):
        """(N,) complex at the mesh's nodes but the centre, from images (N, C)."""
        shape = self.grid.z.shape
        images = (torch.from_numpy(x.T.reshape(1, -1, *shape).astype(np.float32)) for x in (here, there))
        return self(*images).numpy().ravel().astype(complex)

    def predict(self, problem, features):
        """mu (F,) on the faces of a problem, whose disk was laid upon the control's, after the configured looks."""
        nodes = self.nodes
        sides = [np.concatenate(side, 1) for side in zip(*(features.at(sigma) for sigma in SCALES))]
        here, f = sampling_matrix(problem.z, problem.faces, nodes.z[1:]) @ sides[0], mobius(nodes.z, *problem.mobius)
        for _ in range(self.config.looks):
            there = interpolate(sides[1], features.faces, *features.lookup(f[1:]))
            wanted = f[1:] + self.displacements(here, there)
            nu, f = nodes.map_near(np.concatenate([[wanted[: self.config.spokes].mean()], wanted]))
        return bounded(sampling_matrix(nodes.z, nodes.faces, problem.z[problem.faces].mean(1)) @ nu)

    @cached_property
    def nodes(self):
        return Nodes(self.config.rings, self.config.spokes)


class Nodes:
    """The polar mesh of the network's nodes, z (N,) and faces (F, 3), with its exact maps."""

    def __init__(self, rings, spokes):
        self.spectrum = Spectrum(rings, spokes)
        self.z, self.faces = self.spectrum.mesh
        self.solver = BeltramiDiskSolver(self.z, self.faces)
        self.average = corner_average(self.faces, len(self.z), signed_areas(self.z, self.faces))

    def map_near(self, wanted):
        """(nu, f), each (N,): a smooth field and its exact map, nearest to the points `wanted` up to a Möbius map."""
        mu = np.nan_to_num(beltrami_coefficient(self.z, self.faces, wanted), posinf=0, neginf=0)
        mu *= np.minimum(1, LARGEST / np.maximum(abs(mu), LARGEST))
        coefficients = self.spectrum.coefficients(self.average @ unbounded(mu))
        nu = self.spectrum.field(coefficients / (1 + SMOOTHER * self.spectrum.values))
        f = self.solver.solve(bounded(nu[self.faces].mean(1)))
        return nu, mobius(f, *refit(f[1:], wanted[1:]))


class Pairs(Seeded):
    """(here, there (C, rings, spokes), wanted (rings, spokes)): images of both sides, and where the nodes belong.

    Half of them: a subject's folds moved by a random map, mixed with another one's; the others: two subjects, and the
    map that their growth defines. Seen from the best Möbius map, as at first, or from a part of the way, as later.
    """

    def __init__(self, count, seed, seeds, config, quick=False):
        super().__init__(count, seed, seeds, GENERATION, SCALES, config.rings, config.spokes, quick)
        self.seeds, self.quick, self.shape = seeds, quick, (config.rings, config.spokes)
        self.maps = DiskMaps(*polar_disk(*self.shape, POWER))
        self.nodes = self.maps.z[1:]

    @cached_property
    def subjects(self):
        return [Side(subject) for subject in subjects(self.seeds, FOLDER, self.quick)]

    def draw(self, rng):
        here, control, away, f = self.pair(rng)
        images = (x.T.reshape(-1, *self.shape) for x in (here, control.at(f)))
        return *images, (away - f).reshape(self.shape)

    def pair(self, rng):
        """The moving folds at the nodes (P, C), the control, where the nodes belong on it, and where they are seen."""
        first, second = (self.subjects[k] for k in rng.permutation(len(self.subjects))[:2])
        by_growth = rng.random() < 0.5
        away = first.partners(second, self.nodes) if by_growth else self.random_map(rng)
        f = mobius(self.nodes, *refit(self.nodes, away, (0j, 0.0)))
        f = mobius(f, 0.03 * rng.normal() * np.exp(2j * np.pi * rng.random()), 0.03 * rng.normal())
        if rng.random() < 0.5:
            f = f + rng.random() * (away - f + ASTRAY * (self.random_map(rng) - self.nodes))
        if by_growth:
            return first.at(self.nodes), second, away, f
        return mixed(first.at(away), second.at(self.nodes), rng.uniform(0, 0.5)), first, away, f

    def random_map(self, rng):
        """Where a random map takes the nodes."""
        return self.maps.solve(random_coefficient(self.maps.z, self.maps.faces, rng, max_abs=(0.05, 0.7)))[1:]


class Side:
    """A subject's folds at both scales in its disk, and the template points of its vertices."""

    def __init__(self, subject):
        surface = subject.surface
        self.z, self.faces, self.template = quiet_disk_map(surface), surface.faces, subject.template
        smoothing = Smoothing(surface, np.stack([sulcal_depth(surface), mean_curvature(surface)], axis=1))
        self.values = np.concatenate([smoothing.at(sigma) for sigma in SCALES], 1)
        self.lookup = Lookup(self.z, self.faces)

    def at(self, points):
        """The folds (P, C) at points of the disk."""
        return interpolate(self.values, self.faces, *self.lookup(points))

    def partners(self, other, points):
        """Where points (P,) of this disk belong in the other's."""
        there = interpolate(self.template, self.faces, *self.lookup(points))
        return interpolate(other.z, other.faces, *locate_on_sphere(other.template, other.faces, there))


def mixed(one, other, share):
    """(1 - share) of one side's folds and so much of the other's, (P, C), standardised over the nodes."""
    return standardised((1 - share) * one + share * other, np.full(len(one), 1 / len(one)))


def main():
    options = read_options()
    torch.set_num_threads(1)
    made, recipe = provenance(), replace(RECIPE, steps=2, validate_every=1) if options.quick else RECIPE
    torch.manual_seed(recipe.seed)
    net = FoldsNet()
    data = datasets(net.config, options.quick)
    with threadpool_limits(1):
        folder = FOLDER / "runs" / f"folds-try{'-quick' * options.quick}"
        train(net, *data, recipe, folder)
        rows = [row for problem in pairs(options.quick) for row in judged(net.eval(), *problem)]
    log = list(csv.DictReader((folder / "log.csv").read_text().splitlines()))
    result = {
        "network": asdict(net.config) | {"parameters": sum(x.numel() for x in net.parameters())},
        "training": asdict(recipe) | {"items": len(data[0]), "subjects": SUBJECTS[0], "generation": GENERATION},
        "log": {name: [float(row[name]) for row in log] for name in log[0]},
        "rows": rows,
        "provenance": made,
    }
    show(rows)
    if options.out:
        write_whole(options.out, lambda place: place.write_text(json.dumps(result) + "\n"))


def read_options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--quick", action="store_true", help="two steps on a few items, to see that all works")
    return parser.parse_args()


def datasets(config, quick):
    """The training and the validation set, kept between runs."""
    groups = zip((TRAINING_SEEDS, VALIDATION_SEEDS), (2, 2) if quick else SUBJECTS, (8, 8) if quick else ITEMS)
    return [
        cached(Pairs(count, 9101 + k, seeds[:few], config, quick), FOLDER / f"folds-try-{k}{'-quick' * quick}.npz")
        for k, (seeds, few, count) in enumerate(groups)
    ]


def pairs(quick):
    """(kind, name, pair) of the problems on real cortex by which the network is judged."""
    right, left = fsaverage_side("right"), fsaverage_side("left")
    for way, sides in (("right to left", (right, left)), ("left to right", (left, right))):
        for part in HALVES:
            yield "half", f"{way}, {part} fitted", heldout_pair(*sides, part)
        whole = heldout_pair(*sides, "all")
        yield "one", f"{way}, one curve fitted", replace(whole, curves=whole.curves[:1], held=whole.curves[1:])
        if quick:
            return
    for amplitude in AMPLITUDES:
        yield "warp", f"warped by {amplitude:g} mm", warp_pair(left, amplitude)


def judged(net, kind, name, pair):
    """Rows of one pair: how the map was found, what is measured of it, and the processor's seconds for it, features
    apart."""
    prepared, weights = prepare(pair), Weights(delta=DELTA)
    problem, lookup = prepared.problem, Lookup(pair.control.z, pair.control.surface.faces)
    features = features_of(problem)
    net.predict(problem, features)  # features at its scales, and its mesh, are there from now on
    fit_registration(problem, weights, features)
    before, mu = timed(net.predict, problem, features)
    starts = {"Möbius map": (None, 0.0), "network": (mu, before)}
    for start, (given, passed) in starts.items():
        alone = mobius(problem.z, *problem.mobius) if given is None else exact_map(problem, given).f
        answers = {"none": (0.0, alone)}
        for level in range(given is not None, len(LEVELS) - 1):
            some = partial(fit_registration, problem, weights, features, given, levels=LEVELS[level:])
            seconds, fit = timed(some)
            answers[f"from {LEVELS[level].sigma:g} mm on"] = seconds, fit.f
        for levels, (seconds, f) in answers.items():
            figures = map_figures(pair, prepared, f, lookup, False)
            found = {key: figures[key] for key in KEPT}
            yield {"kind": kind, "pair": name, "start": start, "levels": levels, "seconds": passed + seconds, **found}


def timed(call, *arguments):
    """(the processor's seconds, median of REPETITIONS, and the answer) of a call."""
    passed = []
    for _ in range(REPETITIONS):
        start = time.process_time()
        answer = call(*arguments)
        passed.append(time.process_time() - start)
    return float(np.median(passed)), answer


def show(rows):
    for row in rows:
        figures = (f"{row[key]:8.3f}" if row[key] is not None else "       -" for key in ("seconds", *KEPT))
        print(f"{row['pair']:34} {row['start']:11} {row['levels']:18}", *figures)


if __name__ == "__main__":
    main()
