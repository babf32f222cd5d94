"""The generations of synthetic subjects: what ties their folds to the template, one set of constants each.

A subject's seed, size and side make the same surface for ever within a generation; another set of constants is another
generation. Files and results carry the number, and subjects of two generations are not mixed.
"""

from dataclasses import dataclass

GENERATION = 3  # of all subjects that are made without asking for another


@dataclass(frozen=True)
class Guidance:
    """What leads folds to the furrows of the template. Lengths on the unfolded surface, in half the hemisphere; forces
    as in `cortex.Mechanics`."""

    variability: float  # root mean square displacement of the template, radians ...
    smoothness: float  # ... by a field that is smooth over so much
    pull: float  # inward force on furrows, released after mid-growth ...
    width: float  # ... and its standard deviation across them
    anisotropy: float  # share of the growth that is missing along furrows
    companions: tuple[float, float]  # least and largest strength of furrows without a name
    corridor: float  # how far beside its course a fundus is traced
    aside: float  # the distance there at which a poor valley costs twice as much ...
    aside_cost: float  # ... and what it adds in the best one, whose own cost is 0.02
    ends: float  # how far from the ends of its course a fundus may begin
    hold: float = 0.0  # narrow inward force on furrows that stays, so that the fold cannot slide off
    pattern: float = 0.0  # force towards the folds that the template grows by itself, which stays
    presence: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of these in a subject: mean, deviation, most


GENERATIONS = {
    2: Guidance(
        variability=0.11, smoothness=0.38, pull=0.018, width=0.05, anisotropy=0.85, companions=(0.3, 0.9),
        corridor=0.11, aside=0.055, aside_cost=0.0, ends=0.045,
    ),
    3: Guidance(
        variability=0.11, smoothness=0.6, pull=0.010, width=0.03, anisotropy=1.0, companions=(0.5, 0.9),
        corridor=0.06, aside=0.02, aside_cost=0.1, ends=0.0,
        hold=0.003, pattern=0.0016, presence=(0.7, 0.5, 1.2),
    ),
}  # fmt: skip
