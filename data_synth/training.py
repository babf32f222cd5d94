"""What each network is trained on, one function a network: (config, folder, quick) -> (training, validation) sets.

The sets are drawn once and kept in `folder`; `quick` draws a few items only, for a trial. Validation sets choose
nothing but what the log shows; held-out figures come from other seeds still.
"""

import numpy as np

from qclearn.diskmesh import polar_disk

from .cohort import hemispheres
from .datasets import CurveDataset, _Seeded, cached
from .fields import KINDS, MAX_ABS, dead_leaves, image_coefficient, random_coefficient, smooth_coefficient
from .template import SULCI


class Fields(_Seeded):
    """Beltrami coefficients alone, (mu (F,),), on the faces of `polar_disk(rings, spokes)`; both kinds equally often."""

    def __init__(self, count, seed, rings=48, spokes=144, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, rings, spokes, max_abs, source)
        self.mesh = polar_disk(rings, spokes)
        self.options = {"max_abs": max_abs, "source": source}

    def draw(self, rng):
        return (random_coefficient(*self.mesh, rng, kind=rng.choice(KINDS), **self.options),)


class SquareFields(_Seeded):
    """The same fields before they are resampled to a disk: complex images (mu (size, size),) of the square."""

    def __init__(self, count, seed, size=64, max_abs=MAX_ABS, source=dead_leaves):
        super().__init__(count, seed, size, max_abs, source)
        self.size, self.max_abs, self.source = size, max_abs, source

    def draw(self, rng):
        image = rng.choice(KINDS) == "image"
        mu = image_coefficient(self.size, rng, self.source) if image else smooth_coefficient(self.size, rng)
        return (mu * rng.uniform(*self.max_abs) * np.exp(2j * np.pi * rng.random()),)


def dbsnet(config, folder, quick=False):
    """Coefficients for DBS-Net: on the polar mesh of preset `best`, on the square of preset `paper`.

    The exact maps of preset `best` are solved while it trains, so that two fields can be mixed.
    """
    counts = (8, 4) if quick else (4000, 256)
    if config.preset == "paper":
        sets = [SquareFields(count, seed, config.size) for count, seed in zip(counts, (5201, 5202))]
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
    """Images, endpoints and curves for LD-Net: 96 subjects, 15 times turned and distorted; the same for both presets."""
    seeds, counts = (((1,), (2,)), (8, 4)) if quick else ((TRAINING_SEEDS, VALIDATION_SEEDS), (1440, 96))
    names = (f"ldnet-{part}{'-quick' if quick else ''}.npz" for part in ("training", "validation"))
    training, validation = (
        cached(CurveDataset(count, 6001 + k, subjects(group, folder, quick), config.size,
                            DATA_POINTS, names=tuple(SULCI)), f"{folder}/{name}", progress=not quick)
        for k, (group, count, name) in enumerate(zip(seeds, counts, names)))
    return training, validation
