"""Low-frequency approximation of Beltrami coefficients on a square grid.

The paper transforms the real and the imaginary part of mu as two images. The transform is linear:
the coefficients of the complex mu are `mu_R^ + i mu_I^`, and |m|, |n| <= k remain in both
channels at once.
"""

import numpy as np
import scipy

from .checks import unmasked
from .grids import disk_to_square, pixel_centres, square_to_disk
from .solver import DiskSolver

# Radians by which pixels are turned before they are located: on a spoke rounding alone would choose
# between two faces.
ASIDE = 1e-9


def frequencies(size, k):
    """The integers m with |m| <= k that differ on a grid of `size` points, ascending: 2k + 1 or
    `size` of them."""
    if k < 0:
        raise ValueError(f"the highest frequency kept is {k}; give 0 (the mean alone) or more")
    return np.arange(-k, k + 1) if 2 * k + 1 <= size else np.arange(size) - size // 2


def fourier_matrix(size, k):
    """The matrix `M_mp = exp(-2 pi i m p / size) / size`, |m| <= k: rows as `frequencies(size, k)`,
    `size` columns.

    `M mu M^T` are the coefficients: the paper's product M mu N before M and N are learnt.
    """
    return np.exp(-2j * np.pi * np.outer(frequencies(size, k), np.arange(size)) / size) / size


def fourier_coefficients(image, k):
    """`mu^(m, n) = 1/N^2 sum mu(p, q) exp(-2 pi i (p m + q n)/N)`, |m|, |n| <= k, of an (N, N)
    image.

    Rows and columns as `frequencies(N, k)`. Source: paper, section 'Compression by Fourier
    Approximation', eq. (FFT).
    """
    image = _square(image)
    low = frequencies(len(image), k)
    return np.fft.fft2(image)[np.ix_(low, low)] / image.size


def from_coefficients(coefficients, size):
    """The complex image (size, size) with these `fourier_coefficients` and no others."""
    low = frequencies(size, len(coefficients) // 2)
    spectrum = np.zeros((size, size), complex)
    spectrum[np.ix_(low, low)] = coefficients
    return np.fft.ifft2(spectrum) * size**2


def compress(image, k):
    """The image (N, N) without its frequencies above k, complex: the best approximation in the mean
    square.

    Overshoot near a jump can lift |mu| to 1; the border is a jump where opposite sides of the
    square differ.
    """
    return from_coefficients(fourier_coefficients(image, k), len(image))


def coefficient_count(size, k):
    """How many complex numbers `compress` keeps, (2k + 1)^2; a real channel's are conjugate in
    pairs: as many reals."""
    return len(frequencies(size, k)) ** 2


def to_square(disk, mu, size):
    """mu (F,) of a `Disk` resampled at the `pixel_centres` of the square [-1, 1]^2, complex (size,
    size).

    The pixel at w shows the face that holds `square_to_disk(w)`, on an edge the next
    counterclockwise: no pullback.
    """
    face, _ = disk.locate(square_to_disk(pixel_centres(size)).ravel() * np.exp(1j * ASIDE))
    return unmasked(mu, "mu")[face].reshape(size, size)


def from_square(image, disk):
    """An image of the square, bilinear at the centroids of the faces of a `Disk`, complex (F,)."""
    image = _square(image)
    w = disk_to_square(disk.centroids)
    row, column = (((x + 1) * len(image) - 1) / 2 for x in (w.imag, w.real))
    return scipy.ndimage.map_coordinates(image, [row, column], order=1, mode="nearest")


def compression_effect(disk, mu, ks, size=128):
    """The cost of keeping the frequencies of mu (F,) on a `Disk` up to k, one dict for each k of
    `ks`.

    Keys: k; coefficients, their number; image_error and mu_error, root mean square of the change of
    mu over pixels and over the disk; max_abs_mu; map_error, the largest change of the disk map.
    BeltramiError where |mu| comes to 1.
    """
    image = to_square(disk, mu, size)
    solver = DiskSolver(disk)
    original = solver.solve(mu)
    rows = []
    for k in ks:
        smooth = compress(image, k)
        compressed = from_square(smooth, disk)
        mean_square = np.average(abs(compressed - mu) ** 2, weights=disk.areas)
        rows.append(
            {
                "k": k,
                "coefficients": coefficient_count(size, k),
                "image_error": float(np.sqrt(np.mean(abs(smooth - image) ** 2))),
                "mu_error": float(np.sqrt(mean_square)),
                "max_abs_mu": float(abs(compressed).max()),
                "map_error": float(abs(solver.solve(compressed) - original).max()),
            }
        )
    return rows


def _square(image):
    image = unmasked(image, "the image")
    if image.ndim != 2 or image.shape[0] != image.shape[1]:
        raise ValueError(f"the image must be square, (N, N), not {image.shape}; see to_square")
    return image
