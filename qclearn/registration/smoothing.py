"""Per-vertex values of one surface at any scale, standardised, and its density: its area over that of its disk."""

from functools import cached_property

import numpy as np
from scipy import sparse

from ..plane.grids import thinned
from ..plane.linear import LARGE, heat_flow

OUTLIERS, SMOOTH_OUTLIERS = 2.5, 3.0  # standard deviations to which a map is clipped, before and after it is smoothed
TAIL = 0.01  # of the vertices at either end, which do not count in these
HEAT_STEPS = 4  # implicit steps of the heat flow to one scale
COARSE = 12_000  # vertices of a large surface on which coarser scales are smoothed
HEMISPHERE = 9e4  # mm^2: of a surface on which a scale is in mm; on others in proportion, whatever their unit
FINEST = 4.0  # the scale at which features are compared in reports


class Smoothing:
    """Named per-vertex values (V, C) of one surface at any scale sigma: the standard deviation of the smoothing kernel,
    in mm on a surface with the area of a HEMISPHERE; with its `Disk`, if known, also the density there.

    Scales above FINEST are smoothed on a coarse mesh of the disk of a large surface.
    """

    def __init__(self, surface, names, values, disk=None):
        self.names, self.values, self.disk = names, values, disk
        self.mass, self.stiffness = sparse.diags_array(surface.vertex_areas), surface.stiffness
        self.areas, self.unit = surface.vertex_areas / surface.area, np.sqrt(surface.area / HEMISPHERE)
        self.levels, self.densities = {}, {}

    def at(self, sigma):
        """The smoothed values, outliers clipped, standardised; kept in `levels`."""
        if sigma not in self.levels:
            values = self.heat(sigma)
            self.levels[sigma] = standardised(clipped(values, self.areas, SMOOTH_OUTLIERS), self.areas)
        return self.levels[sigma]

    def density(self, sigma, disk):
        """log of the share of the surface's area over that of the disk's (V,), smoothed, on any of its `Disk`s.

        What two of its disk maps differ by, a Möbius map's slope say, is smooth and is not smoothed again.
        """
        if sigma not in self.densities:
            self.heat(sigma)
        return self.densities[sigma] + log_density(self.areas, disk) - log_density(self.areas, self.disk)

    def heat(self, sigma):
        """The values after the heat flow `A u' = -K u` for the time sigma^2 / 2; the density's are kept."""
        columns = [clipped(scaled(self.values), self.areas, OUTLIERS)] if len(self.names) else []
        if self.disk is not None:
            columns.append(log_density(self.areas, self.disk)[:, None])
        smooth = self.flow(sigma, self.mass @ np.hstack(columns))
        if self.disk is not None:
            smooth, self.densities[sigma] = smooth[:, :-1], smooth[:, -1]
        return smooth

    def flow(self, sigma, load):
        time = (self.unit * sigma) ** 2 / (2 * HEAT_STEPS)
        if self.disk is None or len(load) <= LARGE or sigma <= FINEST:
            return heat_flow(self.mass, time * self.stiffness, load, HEAT_STEPS)
        spread, mass, stiffness = self.coarse
        return spread @ heat_flow(mass, time * stiffness, spread.T @ load, HEAT_STEPS)

    @cached_property
    def coarse(self):
        """Functions linear on the triangles of few vertices: (V, N) to values at all, mass and stiffness."""
        spread = thinned(self.disk, self.areas, COARSE)[1].sampling(self.disk.z)
        spread = spread[:, spread.sum(0) > 0]  # a point on the rim may be in no triangle
        return spread, spread.T @ self.mass @ spread, spread.T @ self.stiffness @ spread


def log_density(areas, disk):
    """log of the vertices' shares of the surface's area (V,) over their shares of the `Disk`'s."""
    around = np.bincount(disk.faces.ravel(), np.repeat(disk.areas, 3))
    return np.log(areas) - np.log(around / around.sum())


def standardised(values, areas):
    """Values (V, C) with mean 0 and variance 1 over shares of the area (V,); 0 where they are constant."""
    values = values - areas @ values
    deviation = np.sqrt(areas @ values**2)
    return np.divide(values, deviation, out=np.zeros_like(values), where=deviation > 0)


def scaled(values):
    """Values (V, C), not all 0, with 1 as each map's largest size, so that squares neither vanish nor overflow."""
    return values / abs(values).max(0)


def clipped(values, areas, limit):
    """Values (V, C) cut to `limit` standard deviations from the mean, both over the area of all but the TAIL."""
    core = np.clip(values, *np.quantile(values, [TAIL, 1 - TAIL], axis=0))
    mean = areas @ core
    reach = limit * np.sqrt(areas @ (core - mean) ** 2)
    return np.clip(values, mean - reach, mean + reach)
