import numpy as np

from . import parts

TITLE = "Judged by what took no part"
PAGE, MINUTES, POINTS = "worth", 20, 3
TASK = r"""
In the section *Held-out curves* the curves are split in two halves; one is fitted, and the others are
measured; then the halves change places. So every curve is held out once. Write the line
that a report needs. Given are

- `apart` `(R, 2, C)`: the distance in mm of $C$ curves from their own after $R$ runs, in both splits;
- `fitted` `(2, C)`: whether a curve took part in the fit in that split;
- `certified` `(R, 2)`: whether the map was certified;
- `r` `(R,)`: the correlation of depth after the fit, with which you may do what you think right.

Return three things, in a tuple or an array: the number of the run to report, the one whose held-out curves are
nearest on average among those certified in both splits (runs and curves are numbered from 0); the mean distance of
its curves, each where it took no part, in mm, one mean over all curves; and the number of the curve that is farthest
off there.
"""


# %% answer
def reported(apart, fitted, certified, r):
    """(number of the run, mm, number of its worst curve)."""
    ### BEGIN SOLUTION
    held = np.where(fitted, np.nan, apart)
    mm = np.nanmean(held, axis=(1, 2))
    run = np.where(certified.all(1), mm, np.inf).argmin()
    curve = np.nanmax(held[run], axis=0).argmax()
    return run, mm[run], curve
    ### END SOLUTION


# %% test Of each run: mm on fitted curves and on held-out ones, r of depth, and its certificates in
# both splits.
RUNS = (
    (2.2, 2.2, 0.60, (True, True)),  # a Möbius map
    (0.05, 2.6, 0.65, (True, True)),  # landmarks alone
    (0.5, 0.9, 0.85, (True, True)),  # folds beside them
    (0.02, 1.25, 0.80, (True, True)),  # the same with a large gamma
    (0.6, 1.7, 0.95, (True, True)),  # too large a delta
    (0.3, 0.7, 0.84, (False, True)),
    (0.3, 0.5, 0.86, (False, False)),
)


def cases(rng):
    for split, curves in ((0, 8), (1, 11), (1, 9)):
        best, largest_r, folded = 2, 4, 5
        order = rng.permutation(np.delete(np.arange(len(RUNS)), [largest_r, folded]))
        order = [folded, largest_r, *order]  # the run to report is neither the first nor the first that is certified
        best = order.index(best)
        runs = [RUNS[k] for k in order]
        near, far, r, certified = (np.array(part) for part in zip(*runs))
        fitted = rng.permutation(np.arange(curves) % 2 == 0)
        fitted = np.array([fitted, ~fitted])
        spread = 1 + 0.2 * rng.uniform(-1, 1, (len(runs), 2, curves))
        own, others = rng.permutation(np.flatnonzero(~fitted[split]))[:2]  # the farthest is another one in other runs
        spread[best, split, own] *= 3
        spread[np.arange(len(runs)) != best, split, others] *= 1.6
        spread[best, split, rng.choice(np.flatnonzero(fitted[split]))] *= 8  # and farther still where it was fitted
        yield (np.where(fitted, near[:, None, None], far[:, None, None]) * spread, fitted, certified, r)


def verdict(answer, case):
    apart, fitted, certified, _ = case
    said = parts(answer(*(part.copy() for part in case)), 3, "a run, its mm, a curve")
    run, mm, curve = int(said[0]), float(said[1]), int(said[2])
    if not (0 <= run < len(apart)):
        return f"the {len(apart)} runs are numbered from 0, and {run} is none of them"
    own = [{k: row[half, k] for half, k in zip(*np.nonzero(~fitted))} for row in apart]
    means = [np.mean(list(one.values())) for one in own]
    if not certified[run].all():
        return f"run {run} of this table is not certified in both splits"
    if any(mean < means[run] for mean, sure in zip(means, certified.all(1)) if sure):
        return f"run {run} is reported, and another certified one leaves curves that took no part nearer"
    if not abs(mm - means[run]) <= 1e-9:
        return f"the held-out curves of run {run} are {means[run]:.6g} mm off, and not {mm:.6g} mm"
    if curve not in own[run]:
        return f"there are {len(own[run])} curves, numbered from 0 in both splits alike, and {curve} is none of them"
    if curve != max(own[run], key=own[run].get):
        return f"curve {curve} of run {run} is {own[run][curve]:.6g} mm off, and another one farther"


def evidence(answer, case):
    return np.array(answer(*(part.copy() for part in case)), float)


MISTAKES = {
    "fitted curves": (
        ("np.where(fitted, np.nan, apart)", "np.where(fitted, apart, np.nan)"),
        "These are the curves that were fitted: they say how well the fit obeyed. Take each curve "
        "in the split "
        "where it took no part",
    ),
    "all curves": (
        ("np.where(fitted, np.nan, apart)", "apart"),
        "Every curve counts here, the fitted ones too, and their small distances flatter the "
        "mean. Leave out what "
        "took part in the fit",
    ),
    "by r": (
        ("np.where(certified.all(1), mm, np.inf).argmin()", "np.where(certified.all(1), r, -1).argmax()"),
        "The run is chosen by r, which the fit was told to raise: a fit that has bent too far has "
        "the largest. "
        "Choose by the held-out curves",
    ),
    "without certificates": (
        ("np.where(certified.all(1), mm, np.inf).argmin()", "mm.argmin()"),
        "The certificates are not asked: a map that folds can bring curves near, and is no map to "
        "report. Leave "
        "such runs out of the choice",
    ),
    "one certificate": (
        ("certified.all(1)", "certified.any(1)"),
        "A run that is certified in one split only is let through: both of its maps stand behind "
        "the mean, so ask "
        "for both certificates",
    ),
    "zeros in the mean": (
        ("np.where(fitted, np.nan, apart)", "np.where(fitted, 0.0, apart)"),
        "What took part counts as a distance of 0 here, so that the mean is half of what it "
        "should be. Divide by the "
        "number of curves that are counted",
    ),
    "a place in both splits": (
        ("np.nanmax(held[run], axis=0).argmax()", "np.nanargmax(held[run])"),
        "Run and mean are right; the worst curve is counted through both splits in a row. Find "
        "the place of the "
        "largest distance, and of that place the curve alone",
    ),
    "the worst when fitted": (
        ("np.nanmax(held[run], axis=0)", "np.nanmax(np.where(fitted, apart[run], np.nan), axis=0)"),
        "Run and mean are right; the worst curve is sought where the curves were fitted. Seek it "
        "where they took "
        "no part",
    ),
}
