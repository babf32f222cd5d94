import numpy as np

from . import parts

TITLE = "A rule before the number"
PAGE, MINUTES, POINTS = "benchmark", 20, 3
TASK = r"""
The section *Fronts, subject by subject* compares two methods on the same subjects by the ratio of their errors.
The rule was written before the numbers. Write both. Given are the errors `ours` and `theirs`, $(n,)$ each, subject
by subject, and `draws`, integers $(B, n)$: each row holds the numbers of $n$ subjects, drawn anew with repetition.

Return four things: the geometric mean of the ratios ours over theirs; the lower and the upper end of its interval,
nineteen in twenty: of the means of the resampled subjects one in forty lies below it and one in forty above; and the
word that the rule gives: `"ahead"` where the interval lies below 1, `"behind"` where it lies above 1, `"level"` where
it holds 1.
"""


# %% answer
def ratio_with_word(ours, theirs, draws):
    """(ratio, low, high, word) of ours over theirs."""
    ### BEGIN SOLUTION
    logs = np.log(ours / theirs)
    means = logs[draws].mean(1)
    ends = np.quantile(means, [0.025, 0.975])
    ratio, low, high = np.exp([logs.mean(), *ends])
    word = "ahead" if high < 1 else "behind" if low > 1 else "level"
    return ratio, low, high, word
    ### END SOLUTION


# %% test
WORDS = "ahead", "level", "behind"


def cases(rng):
    """(ours, theirs, draws): subjects, who differ more than methods do."""
    for ratio in (0.75, 0.97, 1.03, 1.4):
        theirs = np.exp(0.8 * rng.normal(size=12))
        noise = 0.18 * rng.normal(size=12)
        yield (theirs * ratio * np.exp(noise - noise.mean()), theirs, rng.integers(12, size=(1000, 12)))


def verdict(answer, case):
    ours, theirs, draws = case
    said = parts(answer(ours.copy(), theirs.copy(), draws.copy()), 4, "ratio, low, high, word")
    ratio, low, high = map(float, said[:3])
    each = ours / theirs
    means = np.sort(np.prod(each[draws] ** (1 / len(each)), axis=1))
    right = np.prod(each) ** (1 / len(each))
    if not abs(ratio - right) <= 1e-6:
        return f"the ratio is {right:.6g} on these subjects, and not {ratio:.6g}"
    outside = [np.mean(means < low), np.mean(means > high)]
    if not all(0.023 <= share <= 0.027 for share in outside):
        return f"{outside[0]:.1%} of the resampled means lie below the interval and {outside[1]:.1%} above it"
    rule = "ahead" if high < 1 else "behind" if low > 1 else "level"
    if said[3] != rule:
        return f"the interval from {low:.6g} to {high:.6g} is called {said[3]!r}"


def evidence(answer, case):
    *numbers, word = answer(*(part.copy() for part in case))
    return np.array([*numbers, WORDS.index(word)], float)


MISTAKES = {
    "arithmetic mean": (
        (
            "logs = np.log(ours / theirs)\n    means = logs[draws].mean(1)\n"
            "    ends = np.quantile(means, [0.025, 0.975])\n    ratio, low, high = "
            "np.exp([logs.mean(), *ends])",
            "each = ours / theirs\n    ends = np.quantile(each[draws].mean(1), [0.025, 0.975])\n"
            "    ratio, low, high = each.mean(), *ends",
        ),
        "The ratios are averaged as they are: twice and half do not cancel then, and either "
        "method can come out "
        "with the larger errors. Take the geometric mean",
    ),
    "ratio of means": (
        (
            "logs = np.log(ours / theirs)\n    means = logs[draws].mean(1)\n"
            "    ends = np.quantile(means, [0.025, 0.975])\n    ratio, low, high = "
            "np.exp([logs.mean(), *ends])",
            "many = ours[draws].mean(1) / theirs[draws].mean(1)\n    ends = np.quantile(many, "
            "[0.025, 0.975])\n"
            "    ratio, low, high = ours.mean() / theirs.mean(), *ends",
        ),
        "This is the ratio of two means: the worst subject rules it. Each subject's own ratio "
        "comes first, then "
        "their mean",
    ),
    "unpaired": (
        ("logs[draws].mean(1)", "np.log(ours)[draws].mean(1) - np.log(theirs)[np.roll(draws, 1, axis=0)].mean(1)"),
        "Both methods are resampled each by itself, as if their subjects were different people. "
        "Draw subjects, "
        "and keep the pair",
    ),
    "spread of subjects": (
        ("np.quantile(means, ", "np.quantile(logs, "),
        "This interval is that of single subjects. What is asked is how far their mean would move "
        "with other "
        "subjects: resample it",
    ),
    "nine in ten": (
        ("[0.025, 0.975]", "[0.05, 0.95]"),
        "This interval holds nine in ten of the resampled means. Nineteen in twenty leave one in forty on either side",
    ),
    "the word by the ratio": (
        ('"ahead" if high < 1 else "behind" if low > 1 else "level"', '"ahead" if ratio < 1 else "behind"'),
        "The word is read from the ratio alone, which always lies on one side of 1. The rule asks "
        "where the whole "
        "interval lies",
    ),
    "ends exchanged": (
        ('"ahead" if high < 1 else "behind" if low > 1', '"ahead" if low < 1 else "behind" if high > 1'),
        "The ends of the interval are exchanged in the rule: it lies below 1 where its upper end does",
    ),
}
