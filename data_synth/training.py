"""What each network is trained on, one function a network: (config, folder, quick) -> (training, validation) sets.

The sets are drawn once and kept in `folder`; `quick` draws a few items only, for a trial. Validation subjects
served for the logs and for two settings of use; held-out figures come from other seeds still.
"""

import warnings
from functools import cache

import numpy as np

from data_synth.cohort import hemispheres
from data_synth.datasets import CurveDataset, Seeded, cached
from data_synth.fields import KINDS, MAX_ABS, dead_leaves, image_coefficient, random_coefficient, smooth_coefficient
from data_synth.landmarks import DiskMaps, Perturbation
from data_synth.template import SULCI
from qclearn.plane.bijectivity import RepairWarning
from qclearn.plane.disk import BeltramiDiskSolver
from qclearn.plane.diskmesh import polar_disk, sampling_matrix, square_disk
from qclearn.plane.mobius import best_mobius, mobius
from qclearn.registration.fit import POWER
from qclearn.registration.landmarks import sample_curve
from qclearn.registration.problem import distinct
from qclearn.surfaces.conformal import disk_conformal_map


class Fields(Seeded):
    """Beltrami coefficients alone, (mu (F,),), on the faces of `polar_disk(rings, spokes)`;
    both kinds equally often."""

    def __init__(self, count, seed, rings=48, spokes=144, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, rings, spokes, max_abs, source)
        self.mesh = polar_disk(rings, spokes)
        self.options = {"max_abs": max_abs, "source": source}

    def draw(self, rng):
        return (random_coefficient(*self.mesh, rng, kind=rng.choice(KINDS), **self.options),)


class SquareFields(Seeded):
    """The same fields before they are resampled to a disk: complex images (mu (size, size),) of the square."""

    def __init__(self, count, seed, size=64, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, size, max_abs, source)
        self.size, self.max_abs, self.source = size, max_abs, source

    def draw(self, rng):
        image = rng.choice(KINDS) == "image"
        mu = image_coefficient(self.size, rng, self.source) if image else smooth_coefficient(self.size, rng)
        return (mu * rng.uniform(*self.max_abs) * np.exp(2j * np.pi * rng.random()),)


class SolvedFields(SquareFields):
    """Images mu (size, size) with their exact maps f (V,) on the mesh of the square."""

    def draw(self, rng):
        (mu,) = super().draw(rng)
        return mu, solved(self.size).solve(np.tile(mu.ravel(), 2))  # a pixel's two faces


@cache
def solved(size):
    """The exact solver of the square."""
    return BeltramiDiskSolver(*square_disk(size))


def dbsnet(config, folder, quick=False):
    """Coefficients for DBS-Net: on the polar mesh of preset `best`, on the square of preset `paper`.

    Exact maps for training are solved while it trains, so that two fields can be mixed; for the validation of preset
    `paper` they are in the set.
    """
    counts = (8, 4) if quick else (4000, 256)
    if config.preset == "paper":
        counts = (counts[0], min(counts[1], 48))
        sets = [kind(n, seed, config.size) for kind, n, seed in zip((SquareFields, SolvedFields), counts, (5201, 5202))]
    else:
        sets = [Fields(count, seed, config.rings, config.spokes) for count, seed in zip(counts, (5101, 5102))]
    names = (f"dbsnet-{config.preset}-{part}{'-quick' if quick else ''}.npz" for part in ("training", "validation"))
    training, validation = (cached(items, f"{folder}/{name}", progress=not quick) for items, name in zip(sets, names))
    return training, validation


DATA_POINTS = 37  # on each curve: every fourth of them are the ten of preset `paper`
TRAINING_SEEDS, VALIDATION_SEEDS = tuple(range(2001, 2097)), tuple(range(3001, 3013))  # none of the cohort's


def subjects(seeds, folder, quick=False):
    """Synthetic left hemispheres of 10,000 vertices, grown once and kept in `folder`; `quick`: coarse ones, at once."""
    return hemispheres(seeds, 1_000 if quick else 10_000, folder, progress=not quick)


def ldnet(config, folder, quick=False):
    """Images, endpoints and curves for LD-Net: 96 subjects, 15 times turned and distorted;
    the same for both presets."""
    seeds, counts = (((1,), (2,)), (8, 4)) if quick else ((TRAINING_SEEDS, VALIDATION_SEEDS), (1440, 96))
    names = (f"ldnet-{part}{'-quick' if quick else ''}.npz" for part in ("training", "validation"))
    training, validation = (
        cached(
            CurveDataset(count, 6001 + k, subjects(group, folder, quick), config.size, DATA_POINTS, names=tuple(SULCI)),
            f"{folder}/{name}",
            progress=not quick,
        )
        for k, (group, count, name) in enumerate(zip(seeds, counts, names))
    )
    return training, validation


class Pairs(Seeded):
    """For CP-Net: (moving (128,), target (128,), mask (128,), logs (2,)) from the curves of pairs of subjects.

    curves: (S, C, DATA_POINTS) complex, each subject in its own disk. `plain`: whole subjects, all curves, ten points a
    curve, aligned by the best Möbius map. Otherwise also subjects mixed of two, some of the curves, other numbers of
    points, pairs that are not aligned, targets moved by random maps, and now and then a subject and itself.
    logs: log10 of beta / alpha and gamma / alpha.
    """

    def __init__(self, count, seed, curves, ranges, plain=False, most=128):
        super().__init__(count, seed, curves, ranges, plain, most)
        turns = [np.exp(1j * best_mobius(curve.ravel(), curves[0].ravel())[1]) for curve in curves]
        self.curves, self.ranges, self.plain, self.most = curves * np.reshape(turns, (-1, 1, 1)), ranges, plain, most
        self.maps = DiskMaps(*polar_disk(32, 96, POWER))

    def draw(self, rng):
        kinds = rng.random(4)
        moving, target = (self.subject(rng) for _ in range(2))
        count = rng.choice([4, 5, 7, 13]) if kinds[0] < 0.3 and not self.plain else 10
        step = (DATA_POINTS - 1) // (count - 1)
        some = np.sort(rng.permutation(len(target))[: rng.integers(1, len(target) + 1)])
        some = some if kinds[1] < 0.3 and not self.plain else np.arange(len(target))
        p, q = (points[some, ::step].ravel() for points in (moving, target))
        if kinds[2] < 0.15 and not self.plain:
            mu = random_coefficient(self.maps.z, self.maps.faces, rng, kind=rng.choice(KINDS), max_abs=(0.05, 0.5))
            p = sampling_matrix(self.maps.z, self.maps.faces, q) @ self.maps.solve(mu)
        elif kinds[3] < 0.85 or self.plain:
            p = mobius(p, *best_mobius(p, q))
        once = distinct(p, q)
        padding = (0, self.most - len(once))
        logs = [rng.uniform(low, high) for low, high in self.ranges]
        return np.pad(p[once], padding), np.pad(q[once], padding), np.pad(np.ones(len(once)), padding), np.array(logs)

    def subject(self, rng):
        """A subject's curves (C, DATA_POINTS), or what lies between those of two."""
        first, second = self.curves[rng.permutation(len(self.curves))[:2]]
        share = 0 if self.plain or rng.random() < 0.5 else rng.uniform(0, 0.5)
        return (1 - share) * first + share * second


class ControlPairs(Seeded):
    """For the paper's CP-Net: (moving (M,), target (M,)) with the landmarks of one control as the targets.

    moving: the targets moved by a random map, as the paper does, or those of another subject (or of what lies between
    two), aligned by the best Möbius map. curves, control: (S, C, points) and (C, points) complex.
    """

    def __init__(self, count, seed, curves, control, moved=0.4):
        super().__init__(count, seed, curves, control, moved)
        self.targets, self.moved = control.ravel(), moved
        self.curves = np.array([mobius(p, *best_mobius(p, self.targets)) for p in curves.reshape(len(curves), -1)])
        self.perturbation = Perturbation(*polar_disk(32, 96, POWER), self.targets)

    def draw(self, rng):
        if rng.random() < self.moved:
            p, _, _ = self.perturbation.draw(rng, kind=rng.choice(KINDS), max_abs=(0.05, 0.4))
        else:
            first, second = rng.permutation(self.curves)[:2]
            p = first + rng.choice([0, rng.uniform(0, 0.5)]) * (second - first)
        return mobius(p, *best_mobius(p, self.targets)), self.targets


def cpnet(config, folder, quick=False):
    """Landmark problems for CP-Net: pairs among 96 synthetic subjects, mixed and thinned; validation on 12 others.

    Preset `paper`: those of the first of them as the control, the same examples for every gamma.
    """
    groups, counts = (((1, 2), (3, 4)), (8, 4)) if quick else ((TRAINING_SEEDS, VALIDATION_SEEDS), (3000, 192))
    counts = (1600, 96) if config.preset == "paper" and not quick else counts
    sets = []
    for k, (seeds, count) in enumerate(zip(groups, counts)):
        curves = disk_curves(seeds, folder, quick)
        if config.preset == "paper":
            step = (DATA_POINTS - 1) // (config.points - 1)
            control = disk_curves(groups[0][:1], folder, quick)[0]
            sets.append(ControlPairs(count, 7101 + k, curves[:, :, ::step], control[:, ::step], moved=0.4 * (k == 0)))
        else:
            sets.append(Pairs(count, 7001 + k, curves, (config.smooth, config.match), plain=k == 1))
    names = (f"cpnet-{config.preset}-{part}{'-quick' if quick else ''}.npz" for part in ("training", "validation"))
    training, validation = (cached(items, f"{folder}/{name}", progress=not quick) for items, name in zip(sets, names))
    return training, validation


def disk_curves(seeds, folder, quick=False):
    """Every sulcus of every subject as DATA_POINTS points of its disk, equally spaced by arc length: (S, C, points)."""
    curves = []
    for subject in subjects(seeds, folder, quick):
        surface = subject.surface
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RepairWarning)
            z = disk_conformal_map(surface)
        curves.append([sample_curve(surface, path, DATA_POINTS) @ z for path in surface.curves.values()])
    return np.array(curves)
