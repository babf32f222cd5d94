"""One individual: the deformed template, its size, its growth and its sulci."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from .generations import GENERATION, GENERATIONS
from .pattern import pattern
from .template import (
    CENTRE,
    COMPANIONS,
    LOBES,
    SULCI,
    AreaKeeping,
    Diffeomorphism,
    hull_radius,
    sulcus_course,
    unit,
    wall_level,
)

AREA, AREA_SPREAD = 95_000.0, 0.06  # folded area in mm^2, its relative deviation
FOSSA_DEPTH, FOSSA_WIDTH = 0.26, 0.13
HOLD_WIDTH, BAND_WIDTH = (
    0.02,
    0.05,
)  # of the force that stays on furrows, and of the strip that grows less along them
SPACING = 0.21  # least distance of tertiary furrows from others


def smooth_field(rng, directions, width, count):
    """A random field (k,) of unit variance on the sphere, smooth over `width` radians."""
    centres, weights = unit(rng.normal(size=(count, 3))), rng.normal(size=count)
    field = np.exp((directions @ centres.T - 1) / width**2) @ weights
    return field / field.std()


class Furrows(NamedTuple):
    """Furrows at points of the unfolded surface: strengths (V,) of three widths, and direction.

    pull: of the early inward force; hold: of the one that stays; band: where the sheet grows less
    along the furrow; along (V, 3): unit, zero at short furrows.
    """

    pull: np.ndarray
    hold: np.ndarray
    band: np.ndarray
    along: np.ndarray


class Individual:
    """The random traits of a hemisphere; a seed's sides share two thirds of the deformation."""

    def __init__(self, seed, hemisphere, guidance=GENERATIONS[GENERATION]):
        self.hemisphere, self.guidance = hemisphere, guidance
        shared = np.random.default_rng([seed, 0])
        self.rng = np.random.default_rng([seed, 1 + ("left", "right").index(hemisphere)])
        kind = AreaKeeping if guidance.keeps_area else Diffeomorphism
        self._shared = kind(shared, guidance.variability * np.sqrt(2 / 3), guidance.smoothness)
        self._own = kind(self.rng, guidance.variability * np.sqrt(1 / 3), guidance.smoothness)
        self._lobe_scale = 1 + 0.02 * np.clip(shared.normal(size=len(LOBES)), -2, 2)
        self.area = AREA * np.exp(AREA_SPREAD * np.clip(shared.normal(), -2, 2))
        self.courses = {name: self.deform(sulcus_course(points)) for name, points in SULCI.items()}
        self.interrupted, self.branched = (
            [],
            [],
        )  # names of the sulci for which `furrows` drew a gap or side branches
        fossa = self._on_hull(self.courses["sylvian fissure"])
        self._fossa = cKDTree(fossa)
        self._fossa_width = FOSSA_WIDTH * np.interp(
            np.linspace(0, 1, len(fossa)), [0, 0.15, 0.5, 1], [0.7, 1, 1, 0.4]
        )
        if guidance.keeps_area:  # a strip that keeps its area is as much narrower as it is longer
            drawn = self._on_hull(sulcus_course(SULCI["sylvian fissure"]))
            longer = [np.linalg.norm(np.gradient(path, axis=0), axis=1) for path in (fossa, drawn)]
            self._fossa_width *= longer[1] / longer[0]

    def deform(self, template):
        """Directions (k, 3) on this individual's hull of template points (k, 3)."""
        return self._own(self._shared(template))

    def template(self, directions):
        """Template points (k, 3) of directions on this individual's hull: the inverse of `deform`."""
        return self._shared(self._own(directions, inverse=True), inverse=True)

    def hull(self, directions):
        """Hull radius (k,) in the directions (k, 3)."""
        return hull_radius(directions, self._lobe_scale)

    def _on_hull(self, directions):
        return CENTRE + directions * self.hull(directions)[:, None]

    def position(self, directions):
        """The surface before folding (k, 3): the hull with the open Sylvian fossa."""
        radius = self.hull(directions)
        distance, nearest = self._fossa.query(CENTRE + directions * radius[:, None])
        width = self._fossa_width[nearest]
        slope = np.clip((width - distance) / (0.6 * width), 0, 1)
        sunk = FOSSA_DEPTH * np.minimum(1, width / FOSSA_WIDTH + 0.3) * slope**2 * (3 - 2 * slope)
        return CENTRE + directions * (radius - sunk)[:, None]

    def furrows(self, rest):
        """The `Furrows` of all sulci at points of the unfolded surface (V, 3)."""
        lines = self._lines()
        straight = len(lines)
        lines += [
            (course, np.full(len(course), self.rng.uniform(0.3, 0.7)))
            for course in self._dimples(lines)
        ]
        widths = self.guidance.width, HOLD_WIDTH, BAND_WIDTH
        pull, hold, band = np.zeros((3, len(rest)))
        along = np.zeros((len(rest), 3))
        for k, (course, strength) in enumerate(lines):
            path = self.position(course)
            distance, nearest = cKDTree(path).query(rest)
            early, lasting, wide = (
                strength[nearest] * np.exp(-0.5 * (distance / width) ** 2) for width in widths
            )
            stronger = wide > band
            along[stronger] = (
                unit(np.gradient(path, axis=0))[nearest[stronger]] if k < straight else 0
            )
            pull = np.maximum(pull, early)
            hold = np.maximum(hold, lasting)
            band = np.maximum(band, wide)
        return Furrows(pull, hold, band, along)

    def presence(self, directions):
        """How much of the template's own folds (k,) this individual has at directions (k, 3)."""
        mean, deviation, most = self.guidance.presence
        return np.clip(mean + deviation * smooth_field(self.rng, directions, 0.35, 80), 0, most)

    def _lines(self):
        """Courses (k, 3) of the sulci, their branches and companions, each with its strength (k,)."""
        lines = []
        for name, course in self.courses.items():
            strength, branches = self._interrupted(len(course)), self._branches(course)
            self.interrupted += [name] if strength.min() < 1 else []
            self.branched += [name] if branches else []
            lines.append((course, strength))
            lines += [(branch, np.full(len(branch), 0.7)) for branch in branches]
        for points in COMPANIONS.values():
            course = self.deform(sulcus_course(points))
            lines.append(
                (
                    course,
                    self.rng.uniform(*self.guidance.companions) * self._interrupted(len(course)),
                )
            )
        return lines

    def _interrupted(self, count):
        """Strength (count,) along a course: one, but for gaps in about every third sulcus."""
        strength = np.ones(count)
        if self.rng.random() < 0.35:
            place = self.rng.uniform(0.25, 0.75)
            strength -= 0.9 * np.exp(-0.5 * ((np.linspace(0, 1, count) - place) / 0.05) ** 2)
        return strength

    def _branches(self, course):
        """Side branches of a course, each (k, 3) directions, which leave it at 45 to 80 degrees."""
        branches = []
        for _ in range(self.rng.poisson(0.8)):
            k = self.rng.integers(len(course) // 6, len(course) - len(course) // 6)
            angle = self.rng.uniform(0.8, 1.4) * self.rng.choice([-1, 1])
            branch = self._segment(
                course[k], unit(course[k + 1] - course[k - 1]), angle, self.rng.uniform(0.2, 0.4)
            )
            if (wall_level(branch) > 1.2).all():
                branches.append(branch)
        return branches

    def _dimples(self, lines):
        """Short furrows, each (30, 3) directions, where the others leave room: tertiary sulci."""
        trees = [cKDTree(self.position(np.vstack([course for course, _ in lines])))]
        dimples = []
        for start in unit(self.rng.normal(size=(300, 3))):
            heading = unit(np.cross(start, self.rng.normal(size=3)))
            dimple = self._segment(start, heading, 0.0, self.rng.uniform(0.12, 0.35))
            path = self.position(dimple)
            near = min(tree.query(path)[0].min() for tree in trees)
            if near > SPACING and (wall_level(dimple) > 1.2).all() and self._suits(dimple):
                dimples.append(dimple)
                trees.append(cKDTree(path))
        return dimples

    def _suits(self, dimple):
        """Whether a short furrow (k, 3) lies where the template folds."""
        return pattern(self.template(dimple)).mean() > 0

    def _segment(self, start, along, angle, length):
        """Directions (30, 3) of a slightly bent segment from `start`, at an angle to `along`."""
        heading = np.cos(angle) * along + np.sin(angle) * np.cross(start, along)
        step = np.linspace(0, length, 30)[:, None]
        return unit(start + step * heading + self.rng.normal() * step**2 * np.cross(start, heading))
