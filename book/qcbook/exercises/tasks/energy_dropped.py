import numpy as np

TITLE = "The error before it is made"
PAGE, MINUTES, POINTS = "fourier", 20, 2
TASK = r"""
How many frequencies does a coefficient need? {prf:ref}`The proposition on the best approximation <prop-ft-parseval>`
answers without a single transform back: what is dropped is the error. Write `errors`: given are `image`, complex
`(N, N)`, and `ks`, a list of whole numbers with $2k + 1 \le N$; return for each $k$ the root mean square of
$\mu - \mu_k$ over the pixels, real `(len(ks),)`, where $\mu_k$ keeps the frequencies $|m| \le k$ and $|n| \le k$.
Call `np.fft.fft2` once. It sums over the pixels and does not divide: compare it with
[the book's transform](#eq-ft-transform). `np.fft.fftfreq(N, 1 / N)` lists the frequencies in its order. The section
*What is lost in $\mu$* says how fast the numbers may fall: try an image with a jump, and double $k$.
"""


# %% answer
def errors(image, ks):
    """Root mean square error of the image compressed to each k of ks."""
    ### BEGIN SOLUTION
    power = abs(np.fft.fft2(image) / image.size) ** 2
    m = abs(np.fft.fftfreq(len(image), 1 / len(image)))
    height = np.maximum.outer(m, m)
    return np.array([np.sqrt(power[height > k].sum()) for k in ks])
    ### END SOLUTION


# %% test
def cases(rng):
    """Images with a jump, with a trace of noise."""
    for size, ks in ((16, [6, 0, 3, 1]), (25, [2, 8, 5])):
        x = np.arange(size) / size - rng.uniform(0.4, 0.6)
        image = np.where(abs(x + 1j * x[:, None]) < 0.3, 0.7 * np.exp(1j * rng.uniform(0, 6)), 0.1)
        yield image + 0.02 * rng.normal(size=(size, size, 2)) @ [1, 1j], ks


def verdict(answer, case):
    image, ks = case
    right = np.array([np.sqrt(np.mean(abs(image - compressed(image, k)) ** 2)) for k in ks])
    said = np.asarray(answer(image, ks))
    if said.shape != (len(ks),):
        return f"one number for each of {len(ks)} values of k is asked for, and it returns {said.shape or 'no array'}"
    off = abs(said - right)
    if not off.max() < 1e-8:
        worst = off.argmax()
        return f"for k = {ks[worst]} the compressed image is {right[worst]:.6g} away, and you say {said[worst]:.6g}"


def compressed(image, k):
    """What is left of the image, by two products with a projection."""
    waves = np.exp(2j * np.pi * np.outer(np.arange(len(image)), np.arange(-k, k + 1)) / len(image))
    kept = waves @ waves.conj().T / len(image)
    return kept @ image @ kept.T


def evidence(answer, case):
    return np.asarray(answer(*case), float)


MISTAKES = {
    "transform not divided": (
        ("np.fft.fft2(image) / image.size", "np.fft.fft2(image)"),
        "The transform is a sum over the pixels, not a mean: it lacks the factor before the sum, "
        "and so the waves are"
        " not of length 1. See the definition of the book's transform",
    ),
    "divided by N": (
        ("/ image.size", "/ len(image)"),
        "This is N times too large: a transform divided by N once, or a sum of squares that was "
        "not divided by the"
        " number of pixels. See the factor before the double sum in the book's transform",
    ),
    "no root": (
        ("np.sqrt(power[height > k].sum())", "power[height > k].sum()"),
        "This is the mean square, in units of mu squared, as on the left-hand side of the "
        "proposition. Its root can"
        " be laid beside mu itself",
    ),
    "what is kept": (
        ("power[height > k]", "power[height <= k]"),
        "This is the size of what is kept, and it grows with k. The error is made of all the "
        "other coordinates: see"
        " the right-hand side of the proposition",
    ),
    "frequencies not wrapped": (
        ("abs(np.fft.fftfreq(len(image), 1 / len(image)))", "np.arange(len(image))"),
        "The last rows and columns of the transform are taken for high frequencies. They are the "
        "low negative ones,"
        " and a compression keeps them",
    ),
    "high both ways": (
        ("np.maximum.outer", "np.minimum.outer"),
        "Only waves that are high in both directions are counted as dropped. One that is high in "
        "a single direction"
        " is gone, too: see the condition below the sum in the proposition",
    ),
    "amplitudes added": (
        ("np.sqrt(power[height > k].sum())", "np.sqrt(power[height > k]).sum()"),
        "Amplitudes are added, as if all waves pointed the same way. The waves are orthonormal, "
        "so it is their"
        " squares that add up",
    ),
}
