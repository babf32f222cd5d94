"""How far CP-Net stays behind the exact fit, over a grid of weights."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from .fitstates import exact_fit, fit_state, network_fit


@dataclass(frozen=True)
class Gap:
    """`ratio`: L_CP of CP-Net's map over the exact fit's, NaN where one has no map; trained:
    weights in its range."""

    weights: tuple
    ratio: float
    trained: bool

    @property
    def stiffness(self):
        """log10(gamma / beta)."""
        return np.log10(self.weights[2] / self.weights[1])


def gap_grid(example, ranges, alphas, betas, gammas):
    """A `Gap` for each of the weights alphas x betas x gammas, list; weights that differ by a
    factor share one map.

    ranges: exponents (low, high) of beta / alpha and of gamma / alpha of the network's training.
    """
    known, found = {}, []
    for weights in product(alphas, betas, gammas):
        logs = [float(np.log10(weight / weights[0])) for weight in weights[1:]]
        key = tuple(round(value, 6) for value in logs)
        if key not in known:
            fitted, passed = (fit_state(example, weights, solver=solver) for solver in (exact_fit, network_fit))
            known[key] = passed.loss / fitted.loss
        trained = all(low - 1e-9 <= value <= high + 1e-9 for value, (low, high) in zip(logs, ranges))
        found.append(Gap(weights, known[key], trained))
    return found


def gap_bands(gaps, bands):
    """Rows (from, to, count, median, worst, measured median) of the trained gaps, by the exponent
    of gamma / beta.

    bands: of networks.json, dicts with the exponents "from" and "to", and the measured median
    "CP-Net".
    """
    rows = []
    for band in bands:
        low, high = band["from"], band["to"]
        inside = [gap.ratio for gap in gaps if gap.trained and low - 1e-9 <= gap.stiffness < high - 1e-9]
        if inside:
            rows.append((low, high, len(inside), float(np.median(inside)), max(inside), band["CP-Net"]))
    return rows
