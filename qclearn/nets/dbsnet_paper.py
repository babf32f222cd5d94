"""The paper's DBS-Net, corrected: a Fourier layer on the square, an inner and a boundary route."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage
from torch import nn
from torch.nn import functional

from ..plane.disk import Disk
from ..plane.fourier import fourier_matrix
from ..plane.grids import disk_to_square, pixel_centres, square_disk, square_to_disk
from .gauges import gauge_errors
from .layers import DiskNetwork, perceptron, zero
from .losses import L_LBS, L_DBSNet, L_Energy, L_LBS_printed, L_Maps, LossMesh
from .squaremaps import SquareMaps

LOSSES = ("printed", "rows", "energy", "maps")  # see `PaperDBSNet.distance`
# Of the exact maps of the loss "maps": a tenth of what lies between two discretisations.
TOLERANCE = 1e-3
FURTHEST = 0.95  # from 0 that f(0) is believed to be before the Möbius map that takes it there


@dataclass(frozen=True)
class PaperDBSNetConfig:
    """Sizes of the paper's DBS-Net, corrected, and the weights of its loss."""

    preset: str = "paper"
    max_abs: tuple = (0.05, 0.6)  # of the coefficients it is trained on
    size: int = 64  # of the square, in pixels
    frequencies: int = 8  # the low ones: at most this, either way
    shortcut: bool = True
    loss: str = "energy"  # one of LOSSES
    # Of "printed" and "rows", for this size: the right weight falls with the fourth power of the
    # pixels.
    rho: float = 1e-8


class FourierLayer(nn.Module):
    """`M mu N` (B, 2k + 1, 2k + 1) of images mu, M and N learnable, first the truncated DFT."""

    def __init__(self, size, k):
        super().__init__()
        # Entries of modulus 1.
        start = torch.from_numpy(fourier_matrix(size, k)).to(torch.complex64) * size
        self.M = nn.Parameter(torch.view_as_real(start))
        self.N = nn.Parameter(torch.view_as_real(start.T.contiguous()))

    def forward(self, mu):
        M, N = torch.view_as_complex(self.M), torch.view_as_complex(self.N)
        return M @ mu @ N / mu.shape[-1] ** 2


class InnerRoute(nn.Module):
    """Low frequencies (and, by the shortcut, the image) to inner vertices (B, 2, size - 1, ...).

    The coefficients are first transformed back, to an image of 2k + 1 pixels a side. The paper does
    not say so, but convolutions and bilinear upsampling mean something for neighbours in space, not
    in frequency.
    """

    def __init__(self, size, k, shortcut):
        super().__init__()
        self.size, wide, narrow = size, 64, 16
        matrix = torch.from_numpy(fourier_matrix(2 * k + 1, k)).to(torch.complex64)
        self.register_buffer("back", matrix.conj().T * (2 * k + 1), persistent=False)

        def conv(channels_in, channels_out):
            return nn.Conv2d(channels_in, channels_out, 3, padding=1)

        self.coarse = nn.ModuleList([conv(2, wide), *(conv(wide, wide) for _ in range(5))])
        self.middle, self.fine = conv(wide, wide // 2), conv(wide // 2, narrow)
        self.shortcut = nn.ModuleList([conv(2, narrow), conv(narrow, narrow)] if shortcut else [])
        self.join = conv(2 * narrow if shortcut else narrow, 2 * narrow)
        self.head = zero(nn.Conv2d(2 * narrow, 2, 2))  # from cells to the vertices between them

    def forward(self, coefficients, mu):
        x = self.coarse[0](coefficients)  # (B, 2, 2k + 1, 2k + 1)
        for layer in self.coarse[1:]:
            x = x + layer(functional.silu(x))
        for layer, size in ((self.middle, self.size // 2), (self.fine, self.size)):
            x = functional.interpolate(x, size=(size, size), mode="bilinear", align_corners=False)
            x = functional.silu(layer(x))
        if self.shortcut:
            y = mu  # (B, 2, size, size)
            for layer in self.shortcut:
                y = functional.silu(layer(y))
            x = torch.cat([x, y], 1)
        return x

    def last(self, x):
        """The features (B, C, size, size) to coordinates, as two real channels."""
        return self.head(functional.silu(self.join(x)))


class BoundaryRoute(nn.Module):
    """An MLP from low frequencies (B, n) to positive boundary angles (B, 4 size) of sum 2 pi."""

    def __init__(self, inputs, usual, hidden=512):
        super().__init__()
        self.layers = perceptron(inputs, hidden, hidden, len(usual))
        zero(self.layers[-1])
        # Of the mesh itself, where the MLP says 0.
        self.register_buffer("usual", torch.log(usual), persistent=False)

    def forward(self, coefficients):
        return 2 * torch.pi * torch.softmax(self.usual + self.layers(coefficients), -1)


class PaperDBSNet(DiskNetwork):
    """The two routes joined in one map of `square_disk(size)`.

    The paper leaves two things open. Here the routes are joined by carrying the turn of the
    boundary inwards harmonically and adding what the inner route gives; and a Möbius map after that
    holds f(0) = 0 and f(1) = 1, as in the exact solver. (A shift would put a spike at the vertex 0,
    which no loss of first derivatives feels.)
    """

    def __init__(self, config):
        super().__init__()
        if config.loss not in LOSSES:
            raise ValueError(f"unknown loss {config.loss!r}; there are {', '.join(LOSSES)}")
        self.config, self.exact = config, None
        disk = Disk(*square_disk(config.size))
        self.mesh, z = LossMesh(disk), disk.z
        loop = self.mesh.loop.numpy()
        loop = np.roll(loop, -int(abs(z[loop] - 1).argmin()))
        inner, self.centre = np.setdiff1d(np.arange(len(z)), loop), int(abs(z).argmin())
        usual = np.angle(np.roll(z[loop], -1) / z[loop])
        start = np.angle(z[loop]) % (2 * np.pi)
        tables = {
            "loop": loop,
            "inner": inner,
            "start": start.astype(np.float32),
            "extension": poisson_matrix(z, z[loop]).astype(np.float32),
        }
        for name, table in tables.items():
            self.register_buffer(name, torch.from_numpy(table), persistent=False)
        self.fourier = FourierLayer(config.size, config.frequencies)
        self.inner_route = InnerRoute(config.size, config.frequencies, config.shortcut)
        inputs = 2 * (2 * config.frequencies + 1) ** 2
        self.boundary_route = BoundaryRoute(inputs, torch.from_numpy(usual).float())

    def forward(self, mu):
        """(f (B, V), angles (B, 4 size)) of images mu (B, size, size), a pixel per cell."""
        with torch.autocast(mu.device.type, enabled=False):
            low = self.fourier(mu)
            back = self.inner_route.back
            low, small, image = (
                torch.stack([x.real, x.imag], 1) for x in (10 * low, back @ low @ back.T, mu)
            )
        shift = self.inner_route(small, image)
        # The loss differentiates, so all digits count.
        with torch.autocast(mu.device.type, enabled=False):
            angles = self.boundary_route(low.flatten(1))
            shift = 0.1 * self.inner_route.last(shift.float()).flatten(2)
            shift = torch.complex(shift[:, 0], shift[:, 1])
            turned = angles.cumsum(-1) - angles
            carried = (turned - self.start) @ self.extension
            f = self.mesh.z * torch.polar(torch.ones_like(carried), carried)
            f = f.index_add(1, self.inner, shift)
            f = f.index_copy(1, self.loop, torch.polar(torch.ones_like(turned), turned))
            return (f if self.config.loss == "printed" else self.normalised(f)), angles

    def normalised(self, f):
        """The Möbius map after f (B, V) to f(0) = 0 and f(1) = 1."""
        a = f[:, self.centre, None]
        a = a / (a.abs() / FURTHEST).clamp(min=1)
        f = (f - a) / (1 - a.conj() * f)
        return f * f[:, self.loop[:1]].conj()

    @property
    def pixels(self):
        """The places (size^2,) of the pixels in the disk: mu is resampled, not pulled back."""
        return square_to_disk(pixel_centres(self.config.size)).ravel()

    def run(self, mu):
        """The map of mu (size^2,) as a function of points: bilinear on the square."""
        size = self.config.size
        f, _ = self(torch.from_numpy(mu).to(self.mesh.z).view(1, size, size))
        moved = (f[0] - self.mesh.z).cpu().numpy().reshape(size + 1, size + 1)

        def function(z):
            w = (disk_to_square(z) + 1 + 1j) * size / 2
            return z + ndimage.map_coordinates(moved, [w.imag, w.real], order=1, mode="nearest")

        return function

    def on_faces(self, mu):
        """Face values (B, F) of the images mu (B, size, size)."""
        return mu.flatten(1).repeat(1, 2)

    def loss(self, batch, generator):
        """The configured loss of the fields batch[0], with a generator of mixed and turned ones.

        Figures: `gauge_errors`, where the batch brings exact maps as well.
        """
        mu = batch[0]
        if generator is not None:
            draw = torch.rand(5, len(mu), generator=generator)
            mu = mixed(mu, torch.randperm(len(mu), generator=generator), draw, self.config.max_abs)
        f, angles = self(mu)
        with torch.autocast(mu.device.type, enabled=False):
            loss = self.distance(mu, f, angles)
        if len(batch) == 1:
            return loss, {}
        return loss, gauge_errors(*(x.detach().cpu().numpy() for x in (f, batch[1], self.mesh.z)))

    def distance(self, mu, f, angles):
        """How far maps f (B, V) are from those of mu.

        "printed": L_DBSNet with L_LBS_printed, in thousandths, where one boundary point is all that
        a map f holds; "rows": the same with its rows corrected, and with f(0) = 0; "energy": L_Energy;
        "maps": L_Maps against exact maps.
        """
        given, config = self.on_faces(mu), self.config
        if config.loss == "energy":
            return L_Energy(self.mesh, given, f).mean()
        if config.loss in ("printed", "rows"):
            equation = L_LBS if config.loss == "rows" else L_LBS_printed
            options = {"rho": config.rho, "equation": equation}
            return 1e3 * L_DBSNet(self.mesh, given, f, angles, **options).mean()
        self.exact = self.exact or SquareMaps(config.size)
        with torch.no_grad():
            exact = self.exact(mu, TOLERANCE)
        return L_Maps(f, exact, self.mesh.z)


def poisson_matrix(z, boundary):
    """Matrix (B, V) of the harmonic extension from B boundary points, in order, to z (V,).

    Poisson's kernel, its rows normalised; points nearer to the circle than the boundary points to
    one another are taken back to that distance, where the sum still resolves the kernel.
    """
    following = np.roll(boundary, -1)
    spans = abs(following - boundary) + abs(boundary - np.roll(boundary, 1))
    z = z * np.minimum(1, (1 - spans.mean() / 2) / np.maximum(abs(z), 0.5))
    kernel = spans[:, None] * (1 - abs(z) ** 2) / abs(z - boundary[:, None]) ** 2
    return kernel / kernel.sum(0)


def mixed(mu, order, draw, max_abs):
    """Coefficients (B, ...), half of them sums of two; phase and largest |mu| are random.

    order (B,): a permutation, the other ones; draw (5, B): uniform in 0..1; max_abs: the range of
    the largest |mu|.
    """
    draw, other = draw.to(mu.real).view(5, -1, *[1] * (mu.ndim - 1)), mu[order.to(mu.device)]
    share = draw[0] * (draw[1] < 0.5)

    def unit(x):
        return x / x.flatten(1).abs().amax(1).view(draw[0].shape)

    mu = unit(mu) * (1 - share) + unit(other) * share * torch.exp(2j * torch.pi * draw[2])
    low, high = max_abs
    return unit(mu) * torch.exp(2j * torch.pi * draw[3]) * (low + (high - low) * draw[4])
