"""The paper's CP-Net, corrected: one control, one network for each (alpha, beta, gamma)."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from ..plane.disk import Disk
from ..plane.grids import square_disk
from ..plane.mobius import mobius, mobius_slope
from ..registration.problem import LandmarkError, Weights
from .layers import CoefficientNetwork, perceptron
from .losses import L_CP, L_lost, LossMesh
from .squaremaps import SquareMaps
from .torchplane import bounded, fit_mobius, square_places
from .torchplane import mobius as mobius_of

NEAR = 1e-4  # in the unit disk: targets closer than this to the control's are the control's
STOPPING = 1e-3, 100  # of the exact solver in training: tolerance and steps
LOSSES = ("corrected", "whole", "printed")  # see `PaperCPNet.distance`
SCALE = 10.0  # of the landmarks' displacements, a few hundredths of the disk


@dataclass(frozen=True)
class PaperCPNetConfig:
    """Sizes of the paper's CP-Net, corrected."""

    preset: str = "paper"
    gamma: float = 1e4  # alpha and beta are 1
    through: str = "paper"  # what makes its mu a map in training: a preset of DBS-Net, or "exact"
    loss: str = "corrected"  # one of LOSSES
    curves: int = 8
    points: int = 10  # of each curve
    size: int = 64  # of the square, in pixels: that of its DBS-Net
    widths: tuple = (128, 96, 64, 48, 32)  # channels, from the smallest image to the whole


class PaperCPNet(CoefficientNetwork):
    """Landmarks (B, M) on a subject's disk to mu (B, size, size) on the square, rows upwards.

    Each curve passes through an MLP of its own and is reshaped into channels; all are concatenated,
    and transposed convolutions make the image. The last layer is linear, so that nu may point
    anywhere; `mu = tanh(|nu|) nu / |nu|`.
    """

    def __init__(self, config):
        super().__init__()
        if config.loss not in LOSSES:
            raise ValueError(f"unknown loss {config.loss!r}; there are {', '.join(LOSSES)}")
        self.config, groups, first = config, config.curves, config.widths[0]
        self.side = config.size // 2 ** (len(config.widths) - 1)
        self.split = first // groups
        sizes = 2 * config.points, 128, 128, self.split * self.side**2
        self.groups = nn.ModuleList(perceptron(*sizes) for _ in range(groups))
        pairs = list(zip([groups * self.split, *config.widths[1:-1]], config.widths[1:]))
        self.up = nn.ModuleList(nn.ConvTranspose2d(a, b, 4, stride=2, padding=1) for a, b in pairs)
        self.head = nn.Conv2d(config.widths[-1], 2, 3, padding=1)
        nn.init.normal_(self.head.weight, std=1e-3)
        nn.init.zeros_(self.head.bias)
        self.register_buffer("targets", torch.zeros(groups * config.points, dtype=torch.complex64))
        self.solver = None

    def forward(self, p):
        """mu (B, size, size) of landmarks (B, M), curve by curve."""
        p = p - self.targets  # the network need not learn where the control is
        # (B, K, 2 points).
        curves = torch.view_as_real(SCALE * p).unflatten(1, (self.config.curves, -1)).flatten(2)
        channels = [
            group(curve).unflatten(1, (self.split, self.side, self.side))
            for group, curve in zip(self.groups, curves.unbind(1))
        ]
        x = torch.cat(channels, 1)  # (B, curves split, side, side)
        for layer in self.up:
            x = functional.silu(layer(functional.silu(x)))
        nu = self.head(x).float()
        return bounded(torch.complex(nu[:, 0], nu[:, 1]))

    def loss(self, batch, generator):
        """The `distance` of the maps that the configured solver makes.

        With a generator, of combinations of two of the batch's displacements, no smaller than they
        are.
        """
        p, targets = batch
        self.targets.copy_(targets[0])
        if generator is not None:
            angle = torch.pi / 2 * torch.rand(len(p), 1, generator=generator).to(p.real)
            other = p[torch.randperm(len(p), generator=generator)]
            p = targets + angle.cos() * (p - targets) + angle.sin() * (other - targets)
        if self.solver is None:
            # The square's mesh and images mu -> maps (B, V): no part of this network's weights.
            mesh = LossMesh(Disk(*square_disk(self.config.size))).to(p.device)
            self.solver = mesh, maps_through(self.config.through, self.config.size, p.device)
        (mesh, maps), mu, side = self.solver, self(p), self.config.size + 1
        with torch.autocast(p.device.type, enabled=False):
            # How far the maps move the square's vertices, interpolated at the landmarks.
            shift = torch.view_as_real(maps(mu) - mesh.z).mT.unflatten(2, (side, side))
            places = square_places(p)[:, None]  # (B, 1, M, 2)
            shift = functional.grid_sample(shift, places, align_corners=True)[:, :, 0]
            w = p + torch.complex(*shift.unbind(1))
            if self.config.loss != "printed":
                w = mobius_of(w, *fit_mobius(w, targets))
            loss = self.distance(mesh, mu.flatten(1).repeat(1, 2), w, targets)
            error = (w - targets).abs().mean()
        return loss.mean(), {"error": error.item(), "mu": mu.abs().mean().item()}

    def distance(self, mesh, mu, w, targets):
        """The loss (B,), by `config.loss`, of mu (B, F) whose maps take the landmarks to w (B, M).

        "corrected": `L_CP` with means over the area, of landmarks after the best Möbius map, as in
        `register`; "whole": what its averages lose is counted, too; "printed": means over faces, of
        landmarks where the map leaves them.
        """
        shares = None if self.config.loss == "printed" else mesh.areas / mesh.areas.sum()
        weights = Weights(1.0, 1.0, self.config.gamma)
        loss = L_CP(mesh, mu, w, targets, weights, shares=shares)
        if self.config.loss == "whole":
            loss = loss + weights.beta * L_lost(mesh, mu, shares)
        return loss

    def usual(self, alpha):
        return Weights(alpha, 1.0, alpha * self.config.gamma)

    def answer(self, problem, weights):
        """mu (F,) of a `Problem`.

        LandmarkError where the targets are not those of this network's control, or the weights not
        (1, 1, gamma) up to a factor.
        """
        p, disk = self.in_order(problem.moving, problem.target), problem.disk
        ratios = weights.beta / weights.alpha, weights.gamma / weights.alpha
        if not np.allclose(ratios, [1.0, self.config.gamma], rtol=1e-3):
            raise LandmarkError(
                f"this network is trained for the weights (1, 1, {self.config.gamma:g}) and was "
                f"given ({weights.alpha:g}, {weights.beta:g}, {weights.gamma:g}); use the preset "
                "best for others"
            )
        moved = torch.from_numpy(p)[None].to(self.targets)
        a, theta = (parameter.item() for parameter in fit_mobius(moved, self.targets[None]))
        aligned = torch.from_numpy(mobius(p, a, theta))[None].to(self.targets)
        mu = self(aligned)
        centroids = torch.from_numpy(mobius(disk.centroids, a, theta)).to(self.targets)
        places = square_places(centroids)[None, None]
        image = torch.stack([mu.real, mu.imag], 1)
        parts = functional.grid_sample(image, places, align_corners=False, padding_mode="border")
        slope = mobius_slope(disk.centroids, a, theta)  # mu of f after M is mu(M) conj(M') / M'
        return torch.complex(*parts[0, :, 0]).cpu().numpy() * np.conj(slope) / slope

    def in_order(self, moving, target):
        """The landmarks (M,) in the order of the control's; two curves may share one."""
        control = self.targets.cpu().numpy()
        away = abs(control[:, None] - target)
        nearest = away.argmin(1)
        if away.min(1).max() > NEAR or away.min(0).max() > NEAR:
            raise LandmarkError(
                f"the {len(target)} targets are not the {len(control)} landmarks of the control "
                'that this network was trained for; the preset best takes any: load("cpnet")'
            )
        return moving[nearest]


def maps_through(name, size, device):
    """From images mu (B, size, size) to the square's maps: by "exact" or a preset of DBS-Net.

    Differentiable. The closed forms that preset "best" starts from are not: its maps are its own,
    their derivative that of the exact solver.
    """
    from .weights import load

    if name == "exact":
        exact = SquareMaps(size)
        return lambda mu: exact(mu, *STOPPING)
    network = load("dbsnet", name).to(device)
    if name == "paper":
        return lambda mu: network(mu)[0]

    def solve(mu):
        with torch.no_grad():
            f = network(mu)
        exact = network.solver.solve(mu, *STOPPING, start=f)
        return exact + (f - exact).detach()

    return SquareMaps(size, network.solver.mesh, solve)
