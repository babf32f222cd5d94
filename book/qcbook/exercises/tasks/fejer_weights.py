import numpy as np

from . import shaped

TITLE = "A filter that cannot overshoot"
PAGE, MINUTES, POINTS = "fourier", 20, 2
TASK = r"""
Truncation of a Fourier series can lift a legal coefficient to $|\mu| > 1$, and then there is no map,
[E9](#erratum-9). {prf:ref}`Fejér's weights <prop-ft-fejer>` cannot. Write `filtered`: given are `image`, complex
`(N, N)`, and `k` with $2k + 1 \le N$; return the image after the weights, complex `(N, N)`. `np.fft.fft2` and
`np.fft.ifft2` transform there and back. Frequencies count modulo $N$: `fft2` has $0, 1, 2, \dots, -2, -1$ in this
order, and so has `np.fft.fftfreq(N, 1 / N)`. The section *Compression can destroy bijectivity* proves that the weights
work: each new value has to be a mean of values of $\mu$, with weights that are not negative.
"""


# %% answer
def filtered(image, k):
    """The image (N, N) with Fejér's weights on frequencies up to k."""
    ### BEGIN SOLUTION
    m = abs(np.fft.fftfreq(len(image), 1 / len(image)))
    weight = np.maximum(1 - m / (k + 1), 0)
    spectrum = np.fft.fft2(image) * np.outer(weight, weight)
    return np.fft.ifft2(spectrum)
    ### END SOLUTION


# %% test
def cases(rng):
    """A disk with |mu| = 0.9 and a changing direction, 0 outside; N, k and centre vary."""
    for size, k in zip((24, 31), rng.permutation(np.arange(4, 8))):
        x = np.arange(size) / size - rng.uniform(0.4, 0.6, (2, 1))
        plane = x[0] + 1j * x[1][:, None]
        yield np.where(abs(plane) < 0.3, 0.9 * np.exp(4j * plane.real), 0), int(k)


def mean_by_kernel(image, k):
    """The image filtered without a transform: its means with the weights of Fejér's kernel."""
    x = np.pi * np.subtract.outer(*2 * [np.arange(len(image))]) / len(image)
    wide = np.divide(np.sin((k + 1) * x), np.sin(x), out=np.full(x.shape, k + 1.0), where=x != 0)
    weights = wide**2 / (k + 1) / len(image)
    return weights @ image @ weights.T


def verdict(answer, case):
    image, k = case
    right, largest = mean_by_kernel(image, k), abs(image).max()
    said = shaped(answer(image, k), right.shape)
    off = abs(said - right).max()
    if not off < 1e-8:
        return f"for k = {k} the largest |mu| goes from {largest:.6g} to {abs(said).max():.6g}; off by {off:.2g}"


def evidence(answer, case):
    return np.asarray(answer(*case), complex)


MISTAKES = {
    "truncated": (
        ("np.maximum(1 - m / (k + 1), 0)", "1.0 * (m <= k)"),
        "This is truncation: all that is kept is kept whole, and the kernel has negative values. "
        "That is where the"
        " overshoot of Gibbs comes from",
    ),
    "highest frequency lost": (
        ("m / (k + 1)", "m / k"),
        "The weight is 0 already at the frequency k, so one frequency less is kept than was asked "
        "for. See the"
        " denominator in the proposition on the filter",
    ),
    "negative weights": (
        ("np.maximum(1 - m / (k + 1), 0)", "1 - m / (k + 1)"),
        "Above k the weights go on below zero: high frequencies come back, turned over. The sum "
        "in the proof ends at"
        " k, and what is not kept has the weight 0",
    ),
    "frequencies not wrapped": (
        ("abs(np.fft.fftfreq(len(image), 1 / len(image)))", "np.arange(len(image))"),
        "The last rows and columns of the transform are taken for high frequencies. They are the "
        "low negative ones:"
        " frequencies count modulo N",
    ),
    "the smaller weight": (
        ("np.outer(weight, weight)", "np.minimum.outer(weight, weight)"),
        "The weights of the two directions are combined by their minimum. Only their product "
        "belongs to a product of"
        " two kernels, neither of which is negative",
    ),
    "one direction": (
        ("np.outer(weight, weight)", "weight[:, None]"),
        "Only one of the two directions is filtered, and the other one keeps all its frequencies. "
        "The proposition has"
        " two factors",
    ),
}
