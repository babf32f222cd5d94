"""The paper's LD-Net, corrected: a fixed list of curves, a set number of points on each."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from ..registration.problem import LandmarkError
from .layers import convolution, inference, perceptron
from .losses import L_LD
from .pictures import check_input, picture, turn


@dataclass(frozen=True)
class PaperLDNetConfig:
    """Sizes of the paper's LD-Net, corrected."""

    preset: str = "paper"
    size: int = 128  # of the image, a power of two
    # Channels of convolutions, each of which halves the image.
    widths: tuple[int, ...] = (16, 32, 64, 96, 64)
    curves: int = 8
    points: int = 10  # on each curve, ends included
    hidden: int = 256  # width of the perceptrons


class PaperLDNet(nn.Module):
    """The image through convolutions, start and end points through perceptrons, concatenated.

    For a fixed list of curves, in the order it was trained on; `points` on each, the inner ones
    predicted, the endpoints as given. The curves are polylines of the image and need not lie on
    edges of the surface.
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        pairs = list(zip((2, *config.widths), config.widths))
        side = config.size >> len(pairs)  # of the last image
        layers = [layer for pair in pairs for layer in convolution(*pair, stride=2)]
        self.image = nn.Sequential(*layers)
        flat = nn.Linear(config.widths[-1] * side**2, config.hidden)
        self.flat = nn.Sequential(nn.Flatten(), flat, nn.ReLU())
        ends = 2 * config.curves, config.hidden, config.hidden
        self.start, self.end = (
            nn.Sequential(*perceptron(*ends, activation=nn.ReLU), nn.ReLU()) for _ in range(2)
        )
        inner = 2 * config.curves * (config.points - 2)
        self.joined = perceptron(3 * config.hidden, 2 * config.hidden, inner, activation=nn.ReLU)

    def forward(self, images, ends):
        """Curves (B, K, points), complex, from images (B, 2, S, S) in 0..255 and ends (B, K, 2)."""
        seen = self.flat(self.image(images / 255))  # (B, hidden)
        # (B, 2K) -> (B, hidden).
        start, end = (
            route(torch.view_as_real(ends[..., k].contiguous()).flatten(1))
            for k, route in enumerate((self.start, self.end))
        )
        inner = self.joined(torch.cat([seen, start, end], 1)).float()
        # (B, K, points - 2).
        inner = torch.view_as_complex(inner.view(len(images), self.config.curves, -1, 2))
        return torch.cat([ends[..., :1], inner, ends[..., 1:]], 2)

    def loss(self, batch, generator):
        """Mean `L_LD` under random symmetries of the square, and the points' mean distance."""
        images, _, curves = batch
        # The set has more points, equally spaced too.
        every = (curves.shape[2] - 1) // (self.config.points - 1)
        curves = curves[..., ::every]
        if generator is not None:
            images, curves = turn(images, curves, generator)
        predicted = self(images, curves[..., [0, -1]])
        distance = abs(predicted - curves)[..., 1:-1].mean().item()
        return L_LD(predicted, curves).mean(), {"distance": distance}

    @inference
    def detect(self, surface, z, endpoints):
        """The curves between endpoints (K, 2) in the disk map z: list of (points,) complex.

        LandmarkError unless K is the number it was trained on; the pairs in that order. Others as
        `BestLDNet.detect`.
        """
        z, endpoints = check_input(surface, z, endpoints)
        if len(endpoints) != self.config.curves:
            raise LandmarkError(
                f"{len(endpoints)} pairs of endpoints; this network was trained on "
                f"{self.config.curves} curves in a fixed order: give all of them, or use preset "
                "'best'"
            )
        grey, radius, _ = picture(surface, z, self.config.size)
        device, size = next(self.parameters()).device, self.config.size
        ends = radius.to_image(z[endpoints])
        # The second channel is 255 at the pixels nearest the endpoints.
        place = (np.stack([ends.imag, ends.real]) + 1) * size / 2  # row, column
        marks = np.zeros_like(grey)
        marks[tuple(place.astype(int).clip(0, size - 1))] = 255
        images = torch.as_tensor(np.stack([grey, marks]))[None].to(device, torch.float32)
        curves = self(images, torch.as_tensor(ends)[None].to(device, torch.complex64))[0]
        curves = curves.cpu().numpy().astype(complex)
        curves = radius.from_image(curves / np.maximum(abs(curves), 1))
        curves[:, [0, -1]] = z[endpoints]
        return list(curves)
