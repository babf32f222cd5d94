"""LD-Net: sulci between given endpoints, from the curvature image of a surface on its disk.

Preset `paper` (`ldnet_paper`) predicts a set number of points on a fixed list of curves. Preset
`best` shows where sulci run and lets the shortest path on the surface follow. Source: paper,
section 'Landmark Detection'.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
import torch.nn.functional as F
from torch import nn

from ..registration.curves import fundus_cost, fundus_path, weigh_edges
from .layers import convolution, inference
from .ldnet_paper import PaperLDNet, PaperLDNetConfig
from .pictures import check_input, picture, stamp, turn
from .train import TrainConfig

# Of `heat_metric`, chosen on the validation subjects.
CURVATURE_WEIGHT, DEPTH_WEIGHT, FLOOR, ROUNDS = 0.5, 1.0, 0.3, 2
ENDS, CHORDS, FINER = 1.0, 64, 3  # pixels; points on a chord; points on a curve's segment


@dataclass(frozen=True)
class BestLDNetConfig:
    """Sizes of the better LD-Net."""

    preset: str = "best"
    size: int = 128  # of the image, a power of two
    widths: tuple[int, ...] = (32, 64, 96, 96)  # channels at 1/2, 1/4, ... of the size
    band: float = 1.0  # standard deviation of the soft band around a curve, in pixels


def refine(curves, finer=FINER):
    """Points (B, K, n) along polylines (B, K, P), `finer` per segment, and their places (n,)."""
    last = curves.shape[-1] - 1
    place = torch.linspace(0, last, finer * last + 1, device=curves.device)
    first = place.floor().long().clamp(max=last - 1)
    share = place - first
    return curves[..., first] * (1 - share) + curves[..., first + 1] * share, place


class Residual(nn.Module):
    """Two 3 x 3 convolutions and what came in."""

    def __init__(self, width):
        super().__init__()
        self.body = nn.Sequential(*convolution(width, width), *convolution(width, width))

    def forward(self, x):
        return x + self.body(x)


class BestLDNet(nn.Module):
    """A U-Net that maps where sulci between endpoints run; the curve is the shortest path on it.

    It sees the curvature, the disk, the endpoints and the chords between them; any number of curves
    at once, with no names. Endpoints are exact by construction, and curves are paths on the
    surface.
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        widths = config.widths
        self.stem = nn.Sequential(nn.PixelUnshuffle(2), *convolution(16, widths[0]))
        self.down = nn.ModuleList(Residual(width) for width in widths[:-1])
        self.shrink = nn.ModuleList(nn.Conv2d(a, b, 2, stride=2) for a, b in pairwise(widths))
        self.bottom = nn.Sequential(Residual(widths[-1]), Residual(widths[-1]))
        self.grow = nn.ModuleList(nn.Conv2d(b, a, 1) for a, b in pairwise(widths))
        self.up = nn.ModuleList(Residual(width) for width in widths[:-1])
        self.head = nn.Sequential(nn.Conv2d(widths[0], 4, 1), nn.PixelShuffle(2))

    def from_images(self, images, ends):
        """Logits (B, S, S) from images (B, 2, S, S) and ends (B, K, 2) of a `CurveDataset`."""
        shown = torch.ones(ends.shape[:2], dtype=torch.bool, device=ends.device)
        return self(self.channels(images[:, 0], ends, shown))

    def forward(self, channels):
        """Logits (B, S, S) of lying on one of the sulci, from `channels` (B, 4, S, S)."""
        x = self.stem(channels)  # (B, w0, S/2, S/2)
        skips = []
        for block, shrink in zip(self.down, self.shrink):
            skips.append(block(x))
            x = shrink(skips[-1])  # (B, w1, S/4, S/4) ...
        x = self.bottom(x)
        for block, grow in zip(reversed(self.up), reversed(self.grow)):
            x = block(F.interpolate(grow(x), scale_factor=2.0) + skips.pop())
        return self.head(x)[:, 0]

    def channels(self, grey, ends, shown):
        """The input (B, 4, S, S): images (B, S, S) in 0..255, shown endpoints (B, K, 2)."""
        size = self.config.size
        centre = (2 * torch.arange(size, device=grey.device) + 1) / size - 1
        disk = ((centre[:, None] ** 2 + centre**2) <= 1).to(grey.dtype)
        share = torch.linspace(0, 1, CHORDS, device=grey.device)
        chords = ends[..., :1] * (1 - share) + ends[..., 1:] * share  # (B, K, CHORDS)
        marks, chords = (
            stamp(points.flatten(1), shown.repeat_interleave(points.shape[-1], 1), size, ENDS)
            for points in (ends, chords)
        )
        return torch.stack([(grey / 127.5 - 1) * disk, disk.expand_as(grey), marks, chords], 1)

    def loss(self, batch, generator):
        """Binary cross-entropy with the soft band around shown curves, hits weighted by four.

        batch: images (B, 2, S, S), ends (B, K, 2), curves (B, K, P) as `CurveDataset` gives them.
        Augmentation: the symmetries of the square, contrast, some of the curves, parts of curves.
        """
        images, _, curves = batch
        with torch.autocast(images.device.type, enabled=False):
            grey = images[:, :1]
            first, last, shown = whole(curves)
            if generator is not None:
                grey, curves = turn(grey, curves, generator)
                grey = contrast(grey, generator)
                first, last, shown = some(curves, generator)
            ends = torch.stack([curves.gather(2, k[..., None])[..., 0] for k in (first, last)], 2)
            points, place = refine(curves)
            seen = shown[..., None] & (place >= first[..., None]) & (place <= last[..., None])
            band = stamp(points.flatten(1), seen.flatten(1), self.config.size, self.config.band)
            channels = self.channels(grey[:, 0], ends, shown)
            channels = channels.contiguous(memory_format=torch.channels_last)
        logits = self(channels).float()
        disk = channels[:, 1]
        weights = {"weight": disk, "pos_weight": logits.new_tensor(4.0)}
        total = F.binary_cross_entropy_with_logits(logits, band, **weights, reduction="sum")
        error = total / disk.sum()
        heat = logits.detach().sigmoid() * disk
        return error, {"overlap": (2 * (heat * band).sum() / (heat**2 + band**2).sum()).item()}

    @inference
    def heat(self, surface, z, endpoints):
        """Probability (V,) of lying on a sulcus between the endpoints, and the mean curvature."""
        z, endpoints = check_input(surface, z, endpoints)
        grey, radius, H = picture(surface, z, self.config.size)
        w = torch.as_tensor(radius.to_image(z)).to(next(self.parameters()).device, torch.complex64)
        grey = torch.as_tensor(grey, dtype=torch.float32, device=w.device)[None, None]
        logits = self.from_images(grey, w[torch.as_tensor(endpoints, device=w.device)][None])
        place = torch.view_as_real(w)[None, None]  # (1, 1, V, 2): x, y, as grid_sample takes them
        sampled = F.grid_sample(logits[None], place, padding_mode="border", align_corners=False)
        return sampled[0, 0, 0].sigmoid().double().cpu().numpy(), H

    def detect(self, surface, z, endpoints):
        """The sulci between endpoints (K, 2) as vertices' images in the disk map z: list of (k,).

        The shortest paths in `heat_metric`. SurfaceError for a surface that is not a disk or
        another's z; LandmarkError for endpoints out of range or equal.
        """
        heat, H = self.heat(surface, z, endpoints)
        metric = heat_metric(surface, heat, H)
        paths = (fundus_path(surface, *ends, metric) for ends in np.asarray(endpoints))
        return [np.asarray(z)[path] for path in paths]


def heat_metric(surface, heat, H):
    """Length of every edge of `surface.edges` in the metric of `BestLDNet.detect`, (E,).

    An edge's length in space times the mean over its ends of `exp(H/(2 s) - d/m) (FLOOR + 1 -
    heat)`: that of `curves.fundus_metric` with half the weight on the sulcal depth d and the
    mean curvature H smoothed, times how little the network believes in the place.
    """
    cost = fundus_cost(surface, smoothed(surface, H), CURVATURE_WEIGHT, DEPTH_WEIGHT)
    return weigh_edges(surface, cost * (FLOOR + 1 - heat))


def smoothed(surface, values, rounds=ROUNDS):
    """Values (V,), in each round replaced by the mean of themselves and of their neighbours' mean."""
    ends = np.concatenate([surface.edges, surface.edges[:, ::-1]])
    degree = np.bincount(ends[:, 0], minlength=len(values))
    for _ in range(rounds):
        values = (values + np.bincount(ends[:, 0], values[ends[:, 1]], len(values)) / degree) / 2
    return values


def whole(curves):
    """First and last point (B, K) of each curve, and which curves are shown (B, K): all."""
    first = torch.zeros(curves.shape[:2], dtype=torch.long, device=curves.device)
    return first, first + curves.shape[2] - 1, first == 0


def some(curves, generator):
    """The same at random: all curves or some, at least one; a fifth of the curves cut to a part."""
    count, points = curves.shape[:2], curves.shape[2]
    share = torch.rand(count[0], 1, generator=generator) * 1.5  # above 1: all
    draw = torch.rand(count, generator=generator)
    shown = (draw < share) | (draw == draw.amin(1, keepdim=True))
    part = torch.rand(count, generator=generator) < 0.2
    length = torch.randint(points // 4, points - 1, count, generator=generator)
    start = (torch.rand(count, generator=generator) * (points - length)).long()
    first, last = torch.where(part, start, 0), torch.where(part, start + length, points - 1)
    return tuple(x.to(curves.device) for x in (first, last.clamp(max=points - 1), shown))


def contrast(grey, generator):
    """Images (B, 1, S, S) in 0..255 with a random gamma of 0.6 to 1.6, some of them smoothed."""
    gamma, blur = (
        torch.rand(len(grey), 1, 1, 1, generator=generator).to(grey.device) for _ in range(2)
    )
    smooth = F.avg_pool2d(grey, 3, stride=1, padding=1)
    grey = torch.lerp(grey, smooth, (2 * blur - 1).clamp(min=0))
    return 255 * (grey / 255) ** (2 ** (1.4 * gamma - 0.7))


PRESETS = {"paper": (PaperLDNet, PaperLDNetConfig()), "best": (BestLDNet, BestLDNetConfig())}
TRAINING = {
    "paper": TrainConfig(steps=5000, batch=32, rate=1e-3, weight_decay=1e-2, bfloat16=True),
    "best": TrainConfig(steps=5000, batch=16, rate=2e-3, weight_decay=1e-2, bfloat16=True),
}
