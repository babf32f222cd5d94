"""Verdicts: how pages judge a printed claim. A rule tests the direction of the claim and its size.

`judge_ratio` is for a quotient of two methods' figures. `side` reads an interval, and `compared`
two figures of one study.
"""

FACTOR = 3 / 2  # two figures from different studies are of one size within it, either way
MARGIN = 0.05  # two figures of one study are level within this share


def of_one_size(here, printed):
    """Whether two positive figures lie within `FACTOR` of each other."""
    return 1 / FACTOR <= here / printed <= FACTOR


def judge_ratio(printed, here, low=None, high=None):
    """The verdict on a printed quotient of two methods, by its side of 1 and its size.

    low, high: the interval of ours, where there is one; it has to lie on one side of 1 as a whole.
    "agrees": direction and size hold. "agrees in direction only": the size is off by more than
    `FACTOR`. "turned round": ours lies on the other side of 1. "not settled": our interval holds 1.
    """
    ours = side(here if low is None else low, here if high is None else high, of=1)
    if ours == "level":
        return "not settled"
    if ours != side(printed, printed, of=1):
        return "turned round"
    return "agrees" if of_one_size(here, printed) else "agrees in direction only"


def side(low, high, of=0.0):
    """Where an interval lies: "below", "above", or "level" where it holds `of`."""
    return "below" if high < of else "above" if low > of else "level"


def compared(one, other):
    """A figure against another of the same study: "below", "above", or "level" within `MARGIN`."""
    return side(one / other - MARGIN, one / other + MARGIN, of=1)
