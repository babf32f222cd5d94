import numpy as np

import qclearn as qc

TITLE = "What a pixel is worth"
PAGE, MINUTES, POINTS = "dbsnet", 25, 3
TASK = r"""
The paper's networks work on images of the square $[-1, 1]^2$, to which the disk is carried by
$z \mapsto z / \max(|\cos t|, |\sin t|)$, $t = \arg z$, in the section *The network as printed*. But the disk is not the
square: the table of what was changed has a mean over the *area of the disk* in CP-Net's loss. Take such a mean
from an image. Given is `mu`, complex $(n, n)$, with the centres of the pixels at $(2k + 1)/n - 1$ in either
coordinate, for $k = 0, \dots, n - 1$. Return the mean of $|\mu|^2$ over the disk, a number.

Each pixel counts by how much area of the disk a unit of area of the square stands for at its centre. Find this
factor in polar coordinates: the map keeps rays, and along a ray it is linear. Where $n$ is odd one centre is 0,
where the factor depends on the direction from which one comes. Give that pixel the exact area of its image, which
is a disk.
"""


# %% answer
def mean_square(mu):
    """L_mu of an image mu (n, n) of the square: a mean over the disk."""
    ### BEGIN SOLUTION
    centres = abs((2 * np.arange(len(mu)) + 1) / len(mu) - 1)
    x, y = centres[None, :], centres[:, None]
    size = np.hypot(x, y)
    middle = size == 0
    worth = (np.maximum(x, y) / (size + middle)) ** 2
    worth = worth + np.pi / 4 * middle
    return np.average(abs(mu) ** 2, weights=worth)
    ### END SOLUTION


# %% test
def cases(rng):
    """(words, mu): images whose size differs along the sides, in the corners, and at the centre."""
    n = 24
    x, y = np.meshgrid(*[(2 * np.arange(n) + 1) / n - 1] * 2)
    phase = np.exp(0.5j * np.pi * (rng.integers(4) + rng.uniform(0.3, 0.7)))
    corner, outside = abs(np.sin(2 * np.arctan2(y, x))), np.hypot(x, y) > 1
    yield "an image that is large along the diagonals", (0.1 + 0.8 * corner**2) * phase
    yield ("an image that is large in one corner", 0.05 * phase + 0.9 * np.exp(-6 * abs(x + 1j * y + 0.7 + 0.7j) ** 2))
    yield ("an image that is large where pixels lie outside of the inscribed circle", (0.1 + 0.7 * outside) * phase)
    mu = 0.03 * phase * (0.5 + corner[: n - 3, : n - 3])
    mu[n // 2 - 2, n // 2 - 2] = rng.uniform(0.85, 0.95)
    yield "an image of an odd number of pixels with a peak at the centre", mu


def over_the_disk(mu, spokes=720):
    """Mean of |mu|^2 over the disk: points spread over it, each taken to its pixel."""
    rings = 8 * len(mu)  # the border of a pixel lies between two of them
    r, t = (np.arange(rings) + 0.5) / rings, 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    w = qc.disk_to_square(r[:, None] * np.exp(1j * t))
    column, row = (np.clip((part + 1) / 2 * len(mu), 0, len(mu) - 1).astype(int) for part in (w.real, w.imag))
    return np.average((abs(mu[row, column]) ** 2).mean(1), weights=r)


def verdict(answer, case):
    words, mu = case
    said, right = float(answer(mu.copy())), over_the_disk(mu)
    if not abs(said - right) <= 0.02 * right:
        return f"for {words} it is {said:.6g}, where points spread over the disk have {right:.6g}"


def evidence(answer, case):
    return float(answer(case[1].copy()))


MISTAKES = {
    "plain mean": (
        ("np.average(abs(mu) ** 2, weights=worth)", "np.mean(abs(mu) ** 2)"),
        "This is the mean over the square: pixels in its corners stand for half as much of the "
        "disk as those amid "
        "a side. Weigh them",
    ),
    "inverse": (
        ("(np.maximum(x, y) / (size + middle)) ** 2", "((size + middle) / np.maximum(x, y).clip(1e-9)) ** 2"),
        "The factor is upside down: the square is larger than the disk, most of all in its "
        "corners, so a pixel "
        "there stands for less",
    ),
    "a length": (
        ("(np.maximum(x, y) / (size + middle)) ** 2", "np.maximum(x, y) / (size + middle)"),
        "This is the factor of lengths along a ray. Across the rays the map stretches as well: "
        "take the factor of "
        "areas",
    ),
    "the inscribed disk": (
        ("worth = worth + np.pi / 4 * middle", "worth = 1.0 * (size <= 1)"),
        "Pixels outside of the inscribed circle are left out. The whole square stands for the disk, its corners too",
    ),
    "without absolute values": (
        (
            "centres = abs((2 * np.arange(len(mu)) + 1) / len(mu) - 1)",
            "centres = (2 * np.arange(len(mu)) + 1) / len(mu) - 1",
        ),
        "The absolute values are missing, as in print, erratum E8: the factor must be the same in "
        "all four "
        "corners of the square",
    ),
    "no weight at the centre": (
        ("np.pi / 4 * middle", "0 * middle"),
        "The pixel at 0 is left out. Its image is a disk that touches its four sides: compare the two areas",
    ),
    "full weight at the centre": (
        ("np.pi / 4 * middle", "1 * middle"),
        "The pixel at 0 counts whole. Its image is a disk that touches its four sides, and has "
        "less area than the "
        "pixel",
    ),
}
