"""The generations of synthetic subjects: numbered constants that tie folds to the template.

A subject's seed, size and side make the same surface for ever within a generation; another set of
constants is another generation. Files and results carry the number, and subjects of two generations
are not mixed.
"""

from dataclasses import dataclass

GENERATION = 3  # of all subjects that are made without asking for another


@dataclass(frozen=True)
class Guidance:
    """What leads folds to the furrows of the template. Lengths on the unfolded surface, in half the
    hemisphere; forces as in `cortex.Mechanics`."""

    variability: float = 0.11  # root mean square displacement of the template, radians ...
    smoothness: float = 0.6  # ... by a field that is smooth over so much
    keeps_area: bool = False  # whether that keeps areas on the hull
    pull: float = 0.010  # inward force on furrows, released after mid-growth ...
    width: float = 0.03  # ... and its standard deviation across them
    anisotropy: float = 1.0  # share of the growth that is missing along furrows
    companions: tuple[float, float] = (0.5, 0.9)  # least and largest strength of unnamed furrows
    corridor: float = 0.06  # how far beside its course a fundus is traced
    aside: float = 0.02  # the distance there at which a poor valley costs twice as much ...
    aside_cost: float = 0.1  # ... and what it adds in the best one, whose own cost is 0.02
    # Narrow inward force on furrows that stays, so that the fold cannot slide off.
    hold: float = 0.003
    # Force towards the folds that the template grows by itself, which stays.
    pattern: float = 0.0016
    presence: tuple[float, float, float] = (0.7, 0.5, 1.2)  # in a subject: mean, deviation, most


GENERATIONS = {3: Guidance(), 4: Guidance(keeps_area=True)}
