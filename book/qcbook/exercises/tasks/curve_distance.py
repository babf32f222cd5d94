import numpy as np

TITLE = "How far a detected sulcus is off"
PAGE, MINUTES, POINTS = "ldnet", 20, 3
TASK = r"""
A detector is judged by the distance between its curve and the true one, as in the section *Accuracy on held-out
subjects*. Write that distance. Two curves are given as polygons in space, $(n, 3)$ and
$(m, 3)$, in mm; their corners may crowd anywhere, and they need not begin at the same end. Return one number in mm:
the mean distance from the points of either curve to the nearest point of the other, averaged over both directions.
The points of the two are not pooled: each direction has its own mean, and both count alike.

'The points' are spaced equally by length along the curve, 200 or more on each.
"""


# %% answer
def both_ways(one, other):
    """Mean distance (mm) between two polygons (n, 3), (m, 3) in space."""

    ### BEGIN SOLUTION
    def evenly(curve):
        step = np.linalg.norm(np.diff(curve, axis=0), axis=1)
        along = np.append(0, np.cumsum(step))
        places = np.linspace(0, along[-1], 300)
        return np.stack([np.interp(places, along, x) for x in curve.T], 1)

    one, other = evenly(one), evenly(other)
    apart = np.linalg.norm(one[:, None] - other, axis=2)
    return (apart.min(0).mean() + apart.min(1).mean()) / 2
    ### END SOLUTION


# %% test
def cases(rng):
    """(words, found, true): polygons of a sulcus of some 60 mm, and what detectors make of it."""
    phase, size = rng.uniform(0, 6), rng.uniform(4, 8)

    def course(t):
        return np.stack([60 * t, size * np.sin(5 * t + phase), 5 * np.cos(3 * t)], axis=1)

    even, crowded = np.linspace(0, 1, 15), np.linspace(0, 1, 40) ** 4
    true, across = course(even), np.array([0, 1, 0.8])
    yield "the first half of the sulcus alone", course(even * rng.uniform(0.4, 0.6)), true
    yield (
        "the sulcus, and a detour beyond its end",
        np.concatenate([true, true[-1] + 25 * even[1:, None] * across]),
        true,
    )
    yield ("a course beside the sulcus, drawn from its other end", course(even)[::-1] + 3 * across, true)
    yield ("a course that leaves the sulcus at one end", course(crowded) + 8 * crowded[:, None] * across, true)


def from_to(one, other):
    """Mean distance of a polygon's points from another polygon, by its segments."""
    length = np.linalg.norm(np.diff(one, axis=0), axis=1)
    middle = (np.arange(200) + 0.5) / 200 * length.sum()
    along = np.append(0, np.cumsum(length))
    points = np.stack([np.interp(middle, along, x) for x in one.T], axis=1)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(other, axis=0), axis=1)))
    others = np.stack([np.interp((np.arange(300) + 0.5) / 300 * along[-1], along, x) for x in other.T], axis=1)
    return np.linalg.norm(points[:, None] - others, axis=2).min(1).mean()


def verdict(answer, case):
    words, found, true = case
    said, right = (float(answer(found.copy(), true.copy())), (from_to(found, true) + from_to(true, found)) / 2)
    if not abs(said - right) <= 0.08 + 0.02 * right:
        return f"for {words} it says {said:.2f} mm, where {right:.2f} mm is right"


def evidence(answer, case):
    return float(answer(*(part.copy() for part in case[1:])))


NEAR = 0.02, 0.08  # relative and absolute: the number of points is the student's choice
MISTAKES = {
    "from the first alone": (
        ("(apart.min(0).mean() + apart.min(1).mean()) / 2", "apart.min(1).mean()"),
        "One direction alone: half of a sulcus lies on the whole one, and is off by nothing. Ask "
        "from the points "
        "of the true curve, too",
    ),
    "from the second alone": (
        ("(apart.min(0).mean() + apart.min(1).mean()) / 2", "apart.min(0).mean()"),
        "One direction alone: a detour beyond the sulcus costs nothing. Ask from the points of the detected curve, too",
    ),
    "corners as they come": (
        ("one, other = evenly(one), evenly(other)", "one, other = np.array(one), np.array(other)"),
        "Each corner counts alike here, and corners crowd where the mesh is fine. Take points "
        "equally spaced by "
        "length first",
    ),
    "spaced by number": (
        ("np.cumsum(step))", "np.cumsum(0 * step + 1))"),
        "The points are spaced by the corners' numbers and not by length: where corners crowd, so "
        "do these "
        "points. Add up the lengths of the segments",
    ),
    "pairs of one number": (
        ("(apart.min(0).mean() + apart.min(1).mean()) / 2", "np.linalg.norm(one - other, axis=1).mean()"),
        "Points of one number are compared, as landmarks are: a curve drawn from its other end is "
        "far from itself "
        "then. Take the nearest point",
    ),
    "the farthest point": (
        ("(apart.min(0).mean() + apart.min(1).mean()) / 2", "max(apart.min(0).max(), apart.min(1).max())"),
        "This is the distance of the farthest point: one bad end decides it. The page's figure is a mean",
    ),
}
