"""Random Beltrami coefficients: from photographs, from a procedural stand-in, and smooth ones.

The paper turns two random photographs grey, takes one as the real and one as the imaginary part,
smooths them, adds noise and scales the result below 1. Any callable `source(size, rng) -> grey
image (size, size)` in [0, 1] can take the photographs' place; here a folder of images, or dead
leaves with a 1/f texture, whose spectrum and edges are those of natural images (Ruderman 1997; Lee,
Mumford and Huang 2001).
"""

import hashlib
from io import BytesIO
from pathlib import Path

import numpy as np
from scipy import ndimage
from skimage import io, transform
from skimage.util import img_as_float

from qclearn.plane.fourier import from_square

MAX_ABS = (0.05, 0.6)  # the largest |mu| of a field is uniform in this interval
SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}
SMALLEST = 8  # pixels


class ImageError(ValueError):
    """A folder or a file of images that cannot be used: says which and what to do."""


class ImageFolder:
    """Photographs of a folder as a source: `folder(size, rng)` gives a random square in grey.

    Every file with an image suffix is read once at the start, so that a long run does not meet a
    damaged one; they are read again when drawn, so that memory does not grow with the folder.
    ImageError names the first that cannot be used, or says that there is none.
    """

    def __init__(self, folder):
        folder = Path(folder)
        if not folder.is_dir():
            raise ImageError(f"{folder}: no such folder of images; give one that exists")
        self.paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
        if not self.paths:
            raise ImageError(
                f"{folder}: holds no images; put some there ({', '.join(sorted(SUFFIXES))})"
            )
        contents = hashlib.sha256()
        for path in self.paths:
            _read_grey(path)
            contents.update(path.read_bytes())
        self.contents = contents.hexdigest()

    def __repr__(self):  # the same for the same pictures, wherever they lie
        return f"ImageFolder({len(self.paths)} images, sha256 {self.contents})"

    def __call__(self, size, rng):
        image = _read_grey(self.paths[rng.integers(len(self.paths))])
        side = int(min(image.shape) * rng.uniform(0.5, 1.0))
        row, column = (int(rng.integers(length - side + 1)) for length in image.shape)
        part = image[row : row + side, column : column + side]
        if np.ptp(part) == 0:  # clear sky: nothing to scale, so the whole picture serves
            part = image
        return transform.resize(part, (size, size), order=1, anti_aliasing=min(part.shape) > size)


def _read_grey(path):
    try:
        # From a path, the reader may leave the file open.
        image = img_as_float(io.imread(BytesIO(path.read_bytes())))
    except Exception as error:
        reason = " ".join(str(error).split())[:80]
        raise ImageError(f"{path}: not a readable image ({reason}); remove or replace it") from None
    if image.ndim == 3 and image.shape[-1] <= 4:
        colours = image.shape[-1] - (image.shape[-1] in (2, 4))  # without the opacity
        image = image[..., :colours].mean(-1)
    if image.ndim != 2 or min(image.shape) < SMALLEST:
        raise ImageError(
            f"{path}: shape {image.shape}; give one picture of at least {SMALLEST} x {SMALLEST} "
            "pixels"
        )
    if not np.isfinite(image).all() or np.ptp(image) == 0:
        raise ImageError(f"{path}: is of one grey throughout, or not finite; remove or replace it")
    return image


def power_noise(size, rng, slope):
    """Periodic Gaussian noise (size, size) with amplitude |k|^-slope, mean 0 and standard deviation
    1."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.rfftfreq(size), indexing="ij"))
    k[0, 0] = 1
    spectrum = np.fft.rfft2(rng.normal(size=(size, size))) * k**-slope
    spectrum[0, 0] = 0
    noise = np.fft.irfft2(spectrum, (size, size))
    return noise / noise.std()


def dead_leaves(size, rng, leaves=400):
    """Grey image (size, size) in [0, 1]: overlapping disks of density r^-3 with 1/f textures."""
    y, x = np.mgrid[:size, :size]
    smallest, largest = 0.015 * size, 0.5 * size
    u = rng.random(leaves)
    radii = 1 / np.sqrt(u / largest**2 + (1 - u) / smallest**2)
    centres = rng.uniform(-0.1, 1.1, (leaves, 2)) * size
    image = np.full((size, size), rng.random())
    for radius, (cx, cy) in zip(radii, centres):
        image[(x - cx) ** 2 + (y - cy) ** 2 < radius**2] = rng.random()
    image += 0.12 * power_noise(size, rng, 1.0)
    return np.clip(image, 0, 1)


def image_coefficient(size, rng, source=dead_leaves, smoothing=(0.01, 0.06), noise=0.03):
    """Complex image (size, size) from two grey images of `source`, mean 0, largest modulus 1.

    smoothing: the Gaussian's standard deviation is log-uniform in this interval, as a share of the
    size; noise: the added white noise's standard deviation as a share of the image's.
    """
    field = source(size, rng) + 1j * source(size, rng)
    sigma = size * np.exp(rng.uniform(*np.log(smoothing)))
    field = ndimage.gaussian_filter(field.real, sigma) + 1j * ndimage.gaussian_filter(
        field.imag, sigma
    )
    field -= field.mean()
    field += (
        noise
        * field.std()
        * (rng.normal(size=field.shape) + 1j * rng.normal(size=field.shape))
        / np.sqrt(2)
    )
    return field / abs(field).max()


def smooth_coefficient(size, rng, slope=2.5):
    """Complex image (size, size) with the spectrum of smooth deformations, amplitude |k|^-slope;
    largest modulus 1."""
    field = power_noise(2 * size, rng, slope) + 1j * power_noise(2 * size, rng, slope)
    field = field[:size, :size]  # a quarter of the period, so that opposite sides are free
    return field / abs(field).max()


KINDS = ("image", "smooth")


def random_coefficient(disk, rng, kind="smooth", max_abs=MAX_ABS, size=128, source=dead_leaves):
    """Random mu (F,) on the faces of a `Disk`; its largest |mu| is uniform in `max_abs`.

    kind: "image" (`image_coefficient` of `source`) or "smooth" (`smooth_coefficient`). The field is
    drawn on a square of size x size pixels and resampled by `disk_to_square`, with a uniformly
    random turn of its phase.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown kind {kind!r}; there are {', '.join(KINDS)}")
    if not 0 <= max_abs[0] <= max_abs[1] < 1:
        raise ValueError(f"max_abs = {max_abs}: give an interval within [0, 1)")
    image = (
        image_coefficient(size, rng, source) if kind == "image" else smooth_coefficient(size, rng)
    )
    mu = from_square(image, disk)
    return mu * (rng.uniform(*max_abs) / abs(mu).max()) * np.exp(2j * np.pi * rng.random())
