import numpy as np

from . import parts

TITLE = "A loss that overlooks stripes"
PAGE, MINUTES, POINTS = "cpnet", 20, 3
TASK = r"""
The section *A smaller loss can hide stripes* tells of a network that had found out how to change $\mu$ from pixel to
pixel and pay nothing. Compute for an image what its loss saw, and what it should have counted. Given is `mu`, complex
$(n, n)$, an image of the square $[-1, 1]^2$; the pixels have the side $h = 2/n$. Return two numbers, in a tuple or an
array,

- *seen*: average $\mu$ to the corners between pixels, $(n - 1, n - 1)$, each the mean of the four pixels that it
  touches; take the differences between neighbouring corners over $h$, along rows and along columns; add the mean
  squares of both;
- *counted*: the same with the pixels themselves in place of the corners.

Then find an image with $|\mu| = 1/2$ everywhere for which the first number is 0 and the second as large as it can
be. What a map makes of such an image is said in the section.
"""


# %% answer
def seen_and_counted(mu):
    """(seen, counted) of an image mu (n, n): mean squares of gradients."""
    ### BEGIN SOLUTION
    h = 2 / len(mu)
    rows = mu[1:] + mu[:-1]
    corners = (rows[:, 1:] + rows[:, :-1]) / 4

    def mean_square(image):
        along = [np.diff(image, axis=k) / h for k in (0, 1)]
        return sum((abs(step) ** 2).mean() for step in along)

    return mean_square(corners), mean_square(mu)
    ### END SOLUTION


# %% test
def cases(rng):
    """(words, mu): a smooth image, stripes and checks of one pixel, and noise."""
    n = 16
    row, column = np.indices((n, n))
    phase = np.exp(1j * rng.uniform(0, 6))
    smooth = 0.4 * phase * np.exp(1j * (rng.uniform(0.1, 0.3) * row - 0.2 * column))
    yield "a smooth image", smooth
    yield "stripes that are one pixel wide", smooth * (-1.0) ** row
    yield ("a smooth image with a little of a checkerboard", smooth + 0.1 * phase * (-1.0) ** (row + column))
    n = 11
    yield "noise", 0.3 * (rng.normal(size=(n, n)) + 1j * rng.normal(size=(n, n)))


def verdict(answer, case):
    words, mu = case
    said = parts(answer(mu.copy()), 2, "seen, counted")
    n = len(mu)
    average = (np.eye(n - 1, n) + np.eye(n - 1, n, 1)) / 2
    corners = average @ mu @ average.T
    for name, figure, image in zip(("first number (seen)", "second (counted)"), map(float, said), (corners, mu)):
        step = n / 2 * (np.eye(len(image) - 1, len(image), 1) - np.eye(len(image) - 1, len(image)))
        right = (abs(step @ image) ** 2).mean() + (abs(image @ step.T) ** 2).mean()
        if not abs(figure - right) <= 1e-9 * (1 + right):
            return f"for {words} the {name} should be {right:.6g}, and not {figure:.6g}"


def evidence(answer, case):
    return np.array(answer(case[1].copy()), float)


MISTAKES = {
    "central differences": (
        ("mean_square(mu)\n", "sum((abs(g) ** 2).mean() for g in np.gradient(mu, h))\n"),
        "Central differences pass over the pixel itself: where the sign changes from pixel to "
        "pixel they are 0, "
        "like the averages. Take next neighbours",
    ),
    "averages for both": (
        ("mean_square(corners), mean_square(mu)", "mean_square(corners), mean_square(corners)"),
        "Both numbers come from the averages at the corners, where stripes are 0. What is counted "
        "has to come "
        "from the pixels",
    ),
    "no length": (
        ("np.diff(image, axis=k) / h", "np.diff(image, axis=k)"),
        "A gradient is a difference over a length: without the side of a pixel the term shrinks "
        "as the image gets "
        "finer",
    ),
    "around the edges": (
        ("np.diff(image, axis=k)", "(image - np.roll(image, 1, axis=k))"),
        "The last pixel is taken for a neighbour of the first: the square is no torus, and its edges would cost most",
    ),
    "real part": (
        ("abs(step) ** 2", "step.real ** 2"),
        "The real part alone is counted. mu is complex, and its direction may change while the "
        "real part stays: "
        "take the modulus of a difference",
    ),
    "means of two": (
        ("(rows[:, 1:] + rows[:, :-1]) / 4", "rows / 2"),
        "What is seen comes from means of two pixels, on the edges between them. A corner touches "
        "four, and sees "
        "still less",
    ),
}
