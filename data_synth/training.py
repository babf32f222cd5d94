"""Training sets, one function per network: (config, folder, quick) -> (training, validation).

The sets are drawn once and stored in `folder`; `quick` draws a few items only, for a trial.
Validation subjects served for the logs and for two settings of use; held-out figures come from
other seeds still.
"""

from functools import cache

import numpy as np

from qclearn.nets.refinement import CoefficientRefinement
from qclearn.plane.disk import Disk
from qclearn.plane.grids import FINE, Spectrum, polar, polar_disk, square_disk
from qclearn.plane.mobius import best_mobius, mobius, mobius_inverse
from qclearn.plane.solver import CoefficientMesh, DiskSolver
from qclearn.registration.curves import sample_curve
from qclearn.registration.problem import distinct

from .cohort import hemispheres
from .datasets import CurveDataset, Seeded, cached, quiet_disk_map
from .fields import (
    KINDS,
    MAX_ABS,
    dead_leaves,
    image_coefficient,
    random_coefficient,
    smooth_coefficient,
)
from .landmarks import DiskMaps, Perturbation
from .template import SULCI


class Fields(Seeded):
    """Beltrami coefficients alone, (mu (F,),), on `polar_disk(rings, spokes)`; of both kinds."""

    def __init__(self, count, seed, rings=48, spokes=144, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, rings, spokes, max_abs, source)
        self.disk = Disk(*polar_disk(rings, spokes))
        self.options = {"max_abs": max_abs, "source": source}

    def draw(self, rng):
        return (random_coefficient(self.disk, rng, kind=rng.choice(KINDS), **self.options),)


class SquareFields(Seeded):
    """The same fields before resampling to a disk: complex images (mu (size, size),)."""

    def __init__(self, count, seed, size=64, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, size, max_abs, source)
        self.size, self.max_abs, self.source = size, max_abs, source

    def draw(self, rng):
        image = rng.choice(KINDS) == "image"
        mu = (
            image_coefficient(self.size, rng, self.source)
            if image
            else smooth_coefficient(self.size, rng)
        )
        return (mu * rng.uniform(*self.max_abs) * np.exp(2j * np.pi * rng.random()),)


class SolvedFields(SquareFields):
    """Images mu (size, size) with their exact maps f (V,) on the mesh of the square."""

    def draw(self, rng):
        (mu,) = super().draw(rng)
        return mu, solved(self.size).solve(np.tile(mu.ravel(), 2))  # a pixel's two faces


@cache
def solved(size):
    """The exact solver of the square."""
    return DiskSolver(Disk(*square_disk(size)))


def dbsnet(config, folder, quick=False):
    """Coefficients for DBS-Net: on the polar mesh of preset `best`, on the square of preset
    `paper`.

    Exact maps for training are solved while it trains, so that two fields can be mixed; for the
    validation of preset `paper` they are in the set.
    """
    counts = (8, 4) if quick else (4000, 256)
    if config.preset == "paper":
        counts = (counts[0], min(counts[1], 48))
        sets = [
            kind(n, seed, config.size)
            for kind, n, seed in zip((SquareFields, SolvedFields), counts, (5201, 5202))
        ]
    else:
        sets = [
            Fields(count, seed, config.rings, config.spokes)
            for count, seed in zip(counts, (5101, 5102))
        ]
    return stored(sets, f"{folder}/dbsnet-{config.preset}", quick)


def stored(sets, start, quick):
    """The training and the validation set, each drawn once and stored in a file named by `start`."""
    end = "-quick.npz" if quick else ".npz"
    names = (f"{start}-{part}{end}" for part in ("training", "validation"))
    return tuple(cached(items, name, progress=not quick) for items, name in zip(sets, names))


DATA_POINTS = 37  # on each curve: every fourth of them are the ten of preset `paper`
LOOKS = 2  # on the network's own mesh, where the fields that CP-Net imitates come from
STIFF = 1e-2, 1e5  # beta / alpha and gamma / alpha of the stiffest fit that is usual
SHARE, WILD = 0.3, 1.6  # of examples that have these; |nu| beyond which one is drawn again
# None of the cohort's.
TRAINING_SEEDS = tuple(range(2001, 2097))
VALIDATION_SEEDS = tuple(range(3001, 3013))


def subjects(seeds, folder, quick=False):
    """Synthetic left hemispheres of 10,000 vertices, stored in `folder`; `quick`: coarse ones."""
    return hemispheres(seeds, 1_000 if quick else 10_000, folder, progress=not quick)


def ldnet(config, folder, quick=False):
    """Images, endpoints and curves for LD-Net: 96 subjects, 15 times turned and distorted;
    the same for both presets."""
    seeds, counts = (
        (((1,), (2,)), (8, 4)) if quick else ((TRAINING_SEEDS, VALIDATION_SEEDS), (1440, 96))
    )
    sets = (
        CurveDataset(
            count,
            6001 + k,
            subjects(group, folder, quick),
            config.size,
            DATA_POINTS,
            names=tuple(SULCI),
        )
        for k, (group, count) in enumerate(zip(seeds, counts))
    )
    return stored(sets, f"{folder}/ldnet", quick)


class Pairs(Seeded):
    """For CP-Net: (moving, wanted, left, mask (128,), logs (2,), born, nu (rings, spokes)).

    Targets are the curves of a subject, some of them or what lies between those of two, at several
    numbers of points, or points scattered over the disk. They are moved to another subject's
    curves, by a random map or by twists, now and then left unaligned. curves: (S, C, DATA_POINTS)
    complex, each subject in its own disk. logs: log10 of beta / alpha and gamma / alpha, uniform
    over the ranges of the `BestCPNetConfig`, often those of STIFF. nu: the answer, after LOOKS
    iterations on the network's own mesh, from the Born step on.
    """

    def __init__(self, count, seed, curves, config):
        ranges, self.most = (config.smooth, config.match), config.most
        super().__init__(count, seed, curves, config.rings, config.spokes, ranges, self.most)
        turns = [np.exp(1j * best_mobius(curve.ravel(), curves[0].ravel())[1]) for curve in curves]
        self.curves, self.ranges = curves * np.reshape(turns, (-1, 1, 1)), ranges
        self.spectrum, self.maps = Spectrum(config.rings, config.spokes), DiskMaps(polar(*FINE))
        self.coefficient_mesh = CoefficientMesh(self.spectrum.mesh, self.spectrum.mesh)

    def draw(self, rng):
        while True:
            p, q = self.landmarks(rng)
            once = distinct(p, q)[: self.most]
            p, q = p[once], q[once]
            logs = np.array([rng.uniform(*limits) for limits in self.ranges])
            if rng.random() < SHARE:
                logs = np.log10(STIFF)
            refinement = CoefficientRefinement(
                self.coefficient_mesh, self.spectrum, (p, q), *10**logs
            )
            born, *changes = refinement.born()
            *_, (proposal, best) = refinement.run(born, LOOKS)
            # A step that was cut is not tried.
            nu = best.proposal.nu if proposal.cut else proposal.nu
            if np.isfinite(nu).all() and abs(nu).max() < WILD:
                break
        padding, shape = (0, self.most - len(p)), (self.spectrum.rings, -1)
        points = [np.pad(x, padding) for x in (p, *changes, np.ones(len(p)))]
        return *points, logs, born[1:].reshape(shape), nu[1:].reshape(shape)

    def landmarks(self, rng):
        """Moving and target landmarks of one problem."""
        kind, most = rng.random(), round(2 ** rng.uniform(2, np.log2(self.most)))
        count = rng.choice([4, 5, 7, 10, 13])
        some = np.sort(rng.permutation(self.curves.shape[1])[: max(1, most // count)])
        moving, q = (
            self.subject(rng)[some, :: (DATA_POINTS - 1) // (count - 1)].ravel() for _ in range(2)
        )
        if kind > 0.65:
            q = 0.95 * np.sqrt(rng.random(most)) * np.exp(2j * np.pi * rng.random(most))
        if kind < 0.4:
            p = moving
        elif rng.random() < 0.25:
            p = twisted(q, rng)
        else:
            # Images take longer than all the rest.
            kind = "image" if rng.random() < 0.2 else "smooth"
            mu = random_coefficient(self.maps.disk, rng, kind, max_abs=(0.05, 0.8))
            p = self.maps.disk.interpolation(q) @ self.maps.solve(mu)
        return (mobius(p, *best_mobius(p, q)) if rng.random() < 0.85 else p), q

    def subject(self, rng):
        """A subject's curves (C, DATA_POINTS), or what lies between those of two."""
        first, second = self.curves[rng.permutation(len(self.curves))[:2]]
        share = 0 if rng.random() < 0.5 else rng.uniform(0, 0.5)
        return (1 - share) * first + share * second


def twisted(z, rng):
    """Points of the disk after a twist `w exp(i c (1 - |w|^2))` about a random centre, moved by up
    to 0.3."""
    a = 0.5 * np.sqrt(rng.random()) * np.exp(2j * np.pi * rng.random())
    w = mobius(z, a)
    return mobius_inverse(w * np.exp(1j * rng.uniform(-0.8, 0.8) * (1 - abs(w) ** 2)), a)


class ControlPairs(Seeded):
    """For the paper's CP-Net: (moving (M,), target (M,)), targets of one control.

    moving: the targets moved by a random map, as the paper does, or those of another subject (or of
    what lies between two), aligned by the best Möbius map. curves, control: (S, C, points) and (C,
    points) complex.
    """

    def __init__(self, count, seed, curves, control, moved=0.4):
        super().__init__(count, seed, curves, control, moved)
        self.targets, self.moved = control.ravel(), moved
        self.curves = np.array(
            [mobius(p, *best_mobius(p, self.targets)) for p in curves.reshape(len(curves), -1)]
        )
        self.perturbation = Perturbation(polar(*FINE), self.targets)

    def draw(self, rng):
        if rng.random() < self.moved:
            p, _, _ = self.perturbation.draw(rng, kind=rng.choice(KINDS), max_abs=(0.05, 0.4))
        else:
            first, second = rng.permutation(self.curves)[:2]
            p = first + rng.choice([0, rng.uniform(0, 0.5)]) * (second - first)
        return mobius(p, *best_mobius(p, self.targets)), self.targets


def cpnet(config, folder, quick=False):
    """Landmark problems for CP-Net: curves of synthetic subjects and scattered points, with the
    fields of fits.

    Preset `paper`: pairs with the first of 96 subjects, the control, validated on 12 others, the
    same examples for every gamma; `best`: curves of 32 of them, moved in many ways, validated on
    six.
    """
    groups, counts = ((1, 2), (3, 4)), (8, 4)
    if not quick:
        few = config.preset == "best"
        groups = TRAINING_SEEDS[: 32 if few else None], VALIDATION_SEEDS[: 6 if few else None]
        counts = (1000, 48) if few else (1600, 96)
    sets = []
    for k, (seeds, count) in enumerate(zip(groups, counts)):
        curves = disk_curves(seeds, folder, quick)
        if config.preset == "paper":
            step = (DATA_POINTS - 1) // (config.points - 1)
            control = disk_curves(groups[0][:1], folder, quick)[0]
            sets.append(
                ControlPairs(
                    count, 7101 + k, curves[:, :, ::step], control[:, ::step], moved=0.4 * (k == 0)
                )
            )
        else:
            sets.append(Pairs(count, 7001 + k, curves, config))
    return stored(sets, f"{folder}/cpnet-{config.preset}", quick)


def disk_curves(seeds, folder, quick=False):
    """All sulci as DATA_POINTS points on the subjects' disks, by arc length: (S, C, points)."""
    curves = []
    for subject in subjects(seeds, folder, quick):
        surface = subject.surface
        z = quiet_disk_map(surface)
        curves.append(
            [sample_curve(surface, path, DATA_POINTS) @ z for path in surface.curves.values()]
        )
    return np.array(curves)
