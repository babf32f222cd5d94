"""Random Beltrami coefficients: from photographs as in the paper, from a procedural stand-in, and smooth ones.

The paper turns two random photographs grey, takes one as the real and one as the imaginary part, smooths them, adds
noise and scales the result below 1. Any callable `source(size, rng) -> grey image (size, size)` in [0, 1] can take the
photographs' place; here a folder of images, or dead leaves with a 1/f texture, whose spectrum and edges are those of
natural images (Ruderman 1997; Lee, Mumford and Huang 2001).
"""

from pathlib import Path

import numpy as np
from scipy import ndimage
from skimage import io, transform
from skimage.util import img_as_float

from qclearn.fourier import from_square

MAX_ABS = (0.05, 0.6)  # the largest |mu| of a field is uniform in this interval
SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}


class ImageError(ValueError):
    """A folder or a file of images that cannot be used: says which and what to do."""


class ImageFolder:
    """Photographs of a local folder as a source of grey images: `folder(size, rng)` gives a random square part.

    Every file with an image suffix is opened once at the start; ImageError names the first that cannot be read, or
    says that there is none.
    """

    def __init__(self, folder):
        folder = Path(folder)
        if not folder.is_dir():
            raise ImageError(f"{folder}: no such folder of images")
        paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        if not paths:
            raise ImageError(f"{folder}: holds no images ({', '.join(sorted(SUFFIXES))})")
        self.images = [_read_grey(path) for path in paths]

    def __call__(self, size, rng):
        image = self.images[rng.integers(len(self.images))]
        side = int(min(image.shape) * rng.uniform(0.5, 1.0))
        row, column = (int(rng.integers(length - side + 1)) for length in image.shape)
        part = image[row:row + side, column:column + side]
        return transform.resize(part, (size, size), order=1, anti_aliasing=side > size)


def _read_grey(path):
    try:
        image = img_as_float(io.imread(path))
    except Exception as error:  # the readers raise all sorts
        raise ImageError(f"{path}: not a readable image ({' '.join(str(error).split())[:80]}); remove or replace it") from None
    image = image[..., :3].mean(-1) if image.ndim == 3 else image
    if image.ndim != 2 or min(image.shape) < 8:
        raise ImageError(f"{path}: shape {image.shape}; give a picture of at least 8 x 8 pixels")
    return image


def power_noise(size, rng, slope):
    """Periodic Gaussian noise (size, size) with amplitude |k|^-slope, mean 0 and standard deviation 1."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.rfftfreq(size), indexing="ij"))
    k[0, 0] = np.inf
    noise = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(size, size))) * k ** -slope, (size, size))
    return noise / noise.std()


def dead_leaves(size, rng, leaves=400):
    """Grey image (size, size) in [0, 1]: disks of radius density r^-3 hide one another, each with a 1/f texture."""
    y, x = np.mgrid[:size, :size]
    smallest, largest = 0.015 * size, 0.5 * size
    u = rng.random(leaves)
    radii = 1 / np.sqrt(u / largest ** 2 + (1 - u) / smallest ** 2)
    centres = rng.uniform(-0.1, 1.1, (leaves, 2)) * size
    image = np.full((size, size), rng.random())
    for radius, (cx, cy) in zip(radii, centres):
        image[(x - cx) ** 2 + (y - cy) ** 2 < radius ** 2] = rng.random()
    image += 0.12 * power_noise(size, rng, 1.0)
    return np.clip(image, 0, 1)


def image_coefficient(size, rng, source=dead_leaves, smoothing=(0.01, 0.06), noise=0.03):
    """Complex image (size, size) by the paper's recipe from two grey images of `source`, mean 0, largest modulus 1.

    smoothing: the Gaussian's standard deviation is log-uniform in this interval, as a share of the size; noise: the
    added white noise's standard deviation as a share of the image's.
    """
    field = source(size, rng) + 1j * source(size, rng)
    sigma = size * np.exp(rng.uniform(*np.log(smoothing)))
    field = ndimage.gaussian_filter(field.real, sigma) + 1j * ndimage.gaussian_filter(field.imag, sigma)
    field -= field.mean()
    field += noise * field.std() * (rng.normal(size=field.shape) + 1j * rng.normal(size=field.shape)) / np.sqrt(2)
    return field / abs(field).max()


def smooth_coefficient(size, rng, slope=2.5):
    """Complex image (size, size) with the spectrum of smooth deformations, amplitude |k|^-slope; largest modulus 1."""
    field = power_noise(2 * size, rng, slope) + 1j * power_noise(2 * size, rng, slope)
    field = field[:size, :size]  # a quarter of the period, so that opposite sides are free
    return field / abs(field).max()


KINDS = {"image": image_coefficient, "smooth": smooth_coefficient}


def random_coefficient(z, faces, rng, kind="smooth", max_abs=MAX_ABS, size=128, **options):
    """Random mu (F,) on the faces of a disk mesh; its largest |mu| is uniform in `max_abs`.

    kind: "image" (the paper's recipe, options as `image_coefficient`) or "smooth" (`smooth_coefficient`). The field is
    drawn on the square and resampled by `disk_to_square`, with a uniformly random turn of its phase.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown kind {kind!r}; there are {', '.join(KINDS)}")
    if not 0 <= max_abs[0] <= max_abs[1] < 1:
        raise ValueError(f"max_abs = {max_abs}: give an interval within [0, 1)")
    mu = from_square(KINDS[kind](size, rng, **options), z, faces)
    return mu * (rng.uniform(*max_abs) / abs(mu).max()) * np.exp(2j * np.pi * rng.random())
