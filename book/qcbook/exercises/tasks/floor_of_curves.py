import numpy as np

from . import parts

TITLE = "What no landmark can mend"
PAGE, MINUTES, POINTS = "cohort", 20, 3
TASK = r"""
The section *A lower bound for methods that match folds* names two floors that stand before anything is registered.
Compute them for one curve, and what follows for a method. All points are in space, in mm. Given are

- `images` `(n, 3)`: the *true* images of $n$ points of the moving curve, equally spaced by arc length;
- `points` `(n, 3)`: the control's points at the same arc lengths, to which a method is told to take them;
- `curve` `(N, 3)`: the control's whole curve, many points of it;
- `missed` `(n,)`: how far from `points` a method has left its points, its landmark errors.

Return three means over the $n$ points, in mm, in a tuple or an array: the floor by arc length, the distance of a true
image from the point it is paired with; the floor by curves, its distance from the nearest of the $N$ points of the
whole curve; and the least that the method's *true* errors can be on average, given its landmark errors. (What does
the triangle inequality say of one point, whichever way it was missed?)
"""


# %% answer
def two_floors(images, points, curve, missed):
    """(floor by arc length, floor by curves, least true error) in mm."""
    ### BEGIN SOLUTION
    off = np.linalg.norm(images - points, axis=1)
    apart = np.linalg.norm(images[:, None] - curve, axis=2)
    return off.mean(), apart.min(1).mean(), abs(off - missed).mean()
    ### END SOLUTION


# %% test
def cases(rng):
    """A curve, images that lie beside and along it, and a method that obeys, and one that does not."""
    t = np.linspace(0, 1, 200)
    for obeys in (0.2, None):
        phase = rng.uniform(0, 6)
        curve = np.stack([50 * t, 6 * np.sin(5 * t + phase), 4 * np.cos(3 * t)], axis=1)
        points = curve[np.linspace(0, 199, 10).astype(int)]
        along = curve[np.clip(np.linspace(0, 199, 10) + rng.uniform(-25, 25, 10), 20, 179).astype(int)]
        images = along + rng.normal(size=(10, 3))
        missed = rng.permutation(np.linspace(0.2, 2.4, 10))
        missed *= obeys or np.linalg.norm(images - points, axis=1).mean()
        yield images, points, curve, missed


def verdict(answer, case):
    images, points, curve, missed = case
    said = parts(answer(*(part.copy() for part in case)), 3, "two floors and a least error")
    off = [np.sqrt(((a - b) ** 2).sum()) for a, b in zip(images, points)]
    nearest = [min(np.sqrt(((a - b) ** 2).sum()) for b in curve) for a in images]
    # The place at the distance `missed` from the point that lies nearest to the image is on the
    # line through both.
    places = [b + (a - b) / d * m for a, b, d, m in zip(images, points, off, missed)]
    least = [np.sqrt(((a - place) ** 2).sum()) for a, place in zip(images, places)]
    names = "the floor by arc length", "the floor by curves", "the least true error"
    for name, figure, right in zip(names, said, map(np.mean, (off, nearest, least))):
        if not abs(float(figure) - right) <= 1e-6 * right:
            return f"{name} is {right:.6g} mm, and not {float(figure):.6g} mm"


def evidence(answer, case):
    return np.array(answer(*(part.copy() for part in case)), float)


MISTAKES = {
    "means subtracted": (
        ("abs(off - missed).mean()", "abs(off.mean() - missed.mean())"),
        "Two means are subtracted: what one point is off by too little another makes up for. Take "
        "the difference "
        "point by point, then the mean",
    ),
    "cut off at 0": (
        ("abs(off - missed).mean()", "np.maximum(off - missed, 0).mean()"),
        "A point that was missed by more than its floor is let off with 0: it is too far from its "
        "target to lie "
        "at its true image",
    ),
    "added": (
        ("abs(off - missed).mean()", "(off + missed).mean()"),
        "Floor and landmark error are added: that is the most that the true error can be. The "
        "triangle inequality "
        "has a second half, for the least",
    ),
    "the floor alone": (
        ("abs(off - missed).mean()", "off.mean()"),
        "The floor binds a method that meets its landmarks exactly. One that misses them may lie "
        "nearer to the "
        "truth, by as much as it misses",
    ),
    "from the curve": (
        ("apart.min(1).mean()", "apart.min(0).mean()"),
        "The floor by curves is asked from the points of the control's curve; ask how far each true image lies from it",
    ),
    "root of the mean square": (
        ("return off.mean()", "return np.sqrt((off**2).mean())"),
        "The floor by arc length is a mean of distances; this is the root of their mean square, which large ones rule",
    ),
    "without absolute values": (
        ("abs(off - missed).mean()", "(off - missed).mean()"),
        "The absolute value is missing: a point that is missed by more than its floor brings a negative distance",
    ),
}
