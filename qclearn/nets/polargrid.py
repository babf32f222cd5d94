"""Points and complex fields on a polar mesh, batched: closed-form interpolation, eigenvectors."""

import numpy as np
import torch
from torch import nn

from ..plane.disk import Disk
from ..plane.grids import POWER, Spectrum, polar_disk


class PolarMesh(nn.Module):
    """`polar_disk(nr, nt, power)` with its points located in closed form, batched."""

    def __init__(self, nr, nt, power=POWER):
        super().__init__()
        self.nr, self.nt, self.power = nr, nt, power
        self.mesh = Disk(*polar_disk(nr, nt, power))
        self.register_buffer(
            "radius", as_tensor((np.arange(nr + 1) / nr) ** power), persistent=False
        )

    def locate(self, points):
        """Corners (..., 3), vertices of the mesh, and barycentric weights (..., 3) of points."""
        step = 2 * torch.pi / self.nt
        angle = torch.remainder(points.angle(), 2 * torch.pi)
        k = torch.floor(angle / step).long().clamp(max=self.nt - 1)
        turned = points * torch.exp(-1j * step * k)
        y = turned.imag / np.sin(step)  # point = x spoke_k + y spoke_(k + 1)
        x = turned.real - y * np.cos(step)
        shrink = 1 / (x + y).clamp(min=1)  # beyond the last chord: onto it
        x, y = x * shrink, y * shrink
        j = torch.bucketize((x + y).contiguous(), self.radius, right=True) - 1
        j = j.clamp(0, self.nr - 1)
        inner, outer = self.radius[j], self.radius[j + 1]
        out = (x + y - inner) / (outer - inner)
        lower = (y <= outer * out) | (j == 0)
        first = torch.where(lower, 1 - out, x / inner.clamp(min=1e-9))
        far = torch.where(lower, y / outer, out)
        ring = torch.stack([j, j + 1, j + lower.long()], -1)
        spoke = torch.stack([k, k + 1, k + 1 - lower.long()], -1)
        corners = torch.where(ring > 0, 1 + (ring - 1) * self.nt + spoke % self.nt, 0)
        return corners, torch.stack([first, far, 1 - first - far], -1)

    def sample(self, values, places):
        """Vertex values (B, V), interpolated linearly at places (B, P) from `locate`."""
        corners, weights = places
        return (values.gather(1, corners.flatten(1)).view(corners.shape) * weights).sum(-1)

    def splat(self, values, places):
        """The transpose of `sample`: real values (B, C, P) shared out to the vertices, (B, C, V)."""
        corners, weights = places
        spread = (values[..., None] * weights[:, None]).flatten(2)
        out = values.new_zeros(*values.shape[:2], len(self.mesh.z))
        return out.scatter_add_(2, corners.flatten(1)[:, None].expand_as(spread), spread)


class PolarGrid(PolarMesh):
    """Complex fields nu (B, nr, nt) on the rings of a polar mesh; the centre has the first's mean.

    modes: how many eigenvectors E of a `Spectrum` are used, the smoothest: `E^* A E = pi`.
    """

    def __init__(self, nr, nt, modes):
        super().__init__(nr, nt)
        self.spectrum = Spectrum(nr, nt)
        tables = {
            "z": self.mesh.z[1:].reshape(nr, nt),
            "area": self.spectrum.areas[::nt, None],
            "radial": self.spectrum.radial,
            "selected": np.argsort(self.spectrum.values, kind="stable")[:modes],
        }
        for name, table in tables.items():
            self.register_buffer(name, as_tensor(table), persistent=False)

    def mean_square(self, nu):
        """`mean|nu|^2` over the disk, (B,)."""
        return (self.area * (nu.real**2 + nu.imag**2)).sum((1, 2)) / torch.pi

    def with_centre(self, nu):
        """(B, nr, nt) as values at the mesh's vertices (B, V)."""
        return torch.cat([nu[:, 0].mean(-1, keepdim=True), nu.flatten(1)], 1)

    def coefficients(self, nu):
        """Coefficients (B, modes) of a field, those of its projection: `E^* A nu / pi`."""
        waves = torch.fft.fft(nu * self.area, norm="ortho").mT[..., None, :]  # (B, nt, 1, nr)
        return (waves @ self.radial.to(waves)).flatten(1)[:, self.selected] / torch.pi


def as_tensor(table):
    table = np.asarray(table)
    if table.dtype.kind in "iu":
        return torch.as_tensor(table)
    return torch.as_tensor(table.astype(np.complex64 if np.iscomplexobj(table) else np.float32))
