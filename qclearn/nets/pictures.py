"""Shared by both LD-Nets: checked input, points stamped into images, symmetries of an image.

Points of an image are complex, `w = radius.to_image(z)` with `radius` the image's `AreaRadius`; the
pixel in row i and column j of a size x size image lies at `w = x + iy`, x = (2j + 1)/size - 1, y =
(2i + 1)/size - 1.
"""

import numpy as np
import torch

from ..plane.checks import complex_numbers, unmasked
from ..registration.curves import check_path
from ..registration.problem import LandmarkError
from ..surfaces.curvature import curvature_image, grey_levels, mean_curvature
from ..surfaces.surface import SurfaceError, require_disk


def check_input(surface, z, endpoints):
    """z (V,) complex and endpoints (K, 2) int as arrays; SurfaceError or LandmarkError."""
    require_disk(surface)
    z, endpoints = complex_numbers(z, "z"), unmasked(endpoints, "endpoints")
    if z.shape != (len(surface.vertices),) or not np.isfinite(z).all():
        raise SurfaceError(
            f"z has the shape {z.shape}, {np.count_nonzero(~np.isfinite(z))} of its numbers not "
            f"finite; give the disk map of this surface, {len(surface.vertices)} complex numbers"
        )
    if endpoints.ndim != 2 or endpoints.shape[1] != 2 or not len(endpoints):
        raise LandmarkError(
            f"endpoints have the shape {endpoints.shape}; give (K, 2) vertices, the start and the "
            "end of each of at least one curve"
        )
    for pair in endpoints:
        check_path(surface, pair)
    return z, endpoints


def picture(surface, z, size):
    """Curvature image (size, size) in 0..255, 0 off the disk; its `AreaRadius`; H (V,)."""
    H = mean_curvature(surface)
    image, radius = curvature_image(surface, z, size, grey_levels(H, surface.vertex_areas))
    return np.nan_to_num(image), radius, H


def stamp(points, shown, size, width):
    """Images (B, size, size) of points (B, n): the largest `exp(-d^2 / 2 width^2)`, d in pixels."""
    column, row = (((part + 1) * size - 1) / 2 for part in (points.real, points.imag))
    reach = int(3 * width + 0.5)
    step = torch.arange(-reach, reach + 1, device=points.device)
    rows, columns = (x.round().long()[..., None] + step for x in (row, column))  # (B, n, window)
    across, down = (
        (-((x[..., None] - pixels) ** 2) / (2 * width**2)).exp() * ((pixels >= 0) & (pixels < size))
        for x, pixels in ((column, columns), (row, rows))
    )
    value = down[..., :, None] * across[..., None, :] * shown[..., None, None]
    place = rows.clamp(0, size - 1)[..., :, None] * size + columns.clamp(0, size - 1)[..., None, :]
    image = torch.zeros(len(points), size * size, dtype=value.dtype, device=points.device)
    image = image.scatter_reduce(1, place.flatten(1), value.flatten(1), "amax")
    return image.unflatten(1, (size, size))


def turn(images, points, generator):
    """A random symmetry of the square per item, of images (B, C, S, S) and points (B, ...).

    Exact on pixels. Reflections too, as a mirrored right hemisphere is as good as a left one.
    """
    for change, move in (
        (lambda x: x.flip(3), lambda w: -w.conj()),
        (lambda x: x.flip(2), lambda w: w.conj()),
        (lambda x: x.transpose(2, 3), lambda w: 1j * w.conj()),
    ):
        choice = torch.rand(len(images), generator=generator).to(images.device) < 0.5
        images = torch.where(choice.view(-1, 1, 1, 1), change(images), images)
        points = torch.where(choice.view(-1, *[1] * (points.ndim - 1)), move(points), points)
    return images, points
