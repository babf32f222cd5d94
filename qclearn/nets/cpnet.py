"""CP-Net, the coefficient prediction network: from landmarks and weights to mu.

Preset `best` corrects the first Gauss-Newton step (the Born step) by a U-Net that has learned from
fits, and looks at the map of its answer on the caller's mesh (`nets.refinement`). Preset
`paper` is the paper's, corrected.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from ..plane.grids import Spectrum
from ..plane.solver import CoefficientMesh
from ..registration.problem import LandmarkError
from .born import Born
from .cpnet_paper import PaperCPNet, PaperCPNetConfig
from .layers import CoefficientNetwork, ConditionedUNet, inference
from .polargrid import PolarGrid
from .refinement import CoefficientRefinement
from .train import TrainConfig

# What the correction sees on the grid, in order: name -> (how often its frame turns with the spoke,
# scale that brings it to the size of 1, why it is shown). Complex ones make two channels; nu is
# scaled by its own size.
SEEN = {
    "nu": (2, 0.3, "the Born step, which is corrected"),
    "moved": (1, 5, "what it does to the nodes, to first order"),
    "wanted": (1, 10, "at the landmarks: where they should go, and how many share a node"),
    "left": (1, 10, "at the landmarks: what the Born step leaves of that"),
}
FLOOR = 1e-3  # relative, of the loss: below, an example is learned
SMALL = 1e-4  # a size of nu below which there is nothing to correct


@dataclass(frozen=True)
class BestCPNetConfig:
    """Sizes of the better CP-Net. Ranges are of log10."""

    preset: str = "best"
    rings: int = 24
    spokes: int = 72
    modes: int = 512  # of the Born step
    channels: tuple = (16, 32, 64)
    blocks: int = 2
    looks: int = 2  # iterations of `CoefficientRefinement`, one exact map each
    finer: int = 32  # rings, where landmarks are closer than `close` cells
    close: float = 0.5
    # Gamma / beta from which on nu has the `finest` rings, and more looks begin at the Born step.
    stiff: float = 1e6
    finest: int = 48
    stiff_looks: int = 7
    most: int = 128  # landmarks
    smooth: tuple = (-4.0, 1.0)  # of beta / alpha
    match: tuple = (0.0, 6.0)  # of gamma / alpha


# Of the last few disks that were looked at.
coefficient_mesh_of = lru_cache(maxsize=8)(CoefficientMesh)


class BestCPNet(CoefficientNetwork):
    """nu on a polar grid, the start of the refinement, from landmarks (B, M) and the Born step.

    wanted, left (B, M): where the landmarks should go, and what the Born step nu (B, rings, spokes)
    leaves of that; logs (B, 2): log10 of beta / alpha and gamma / alpha, since only ratios decide
    the minimiser.
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        self.grid = PolarGrid(config.rings, config.spokes, modes=config.modes)
        self.born = Born(self.grid)
        self.unet = ConditionedUNet(10, 4, 4, config.channels, config.blocks)
        self.register_buffer("spoke", self.grid.z / self.grid.z.abs(), persistent=False)
        self.to(memory_format=torch.channels_last)
        self.carriers = {}  # rings -> what carries nu while it is looked at

    def forward(self, p, wanted, left, mask, logs, nu):
        with torch.autocast(p.device.type, enabled=False), torch.no_grad():
            size = self.grid.mean_square(nu).sqrt() + SMALL
            features = self.features(p, wanted, left, mask, nu, size)
            # Conditions (B, 4): the clipped weights, the number of landmarks and the size of nu.
            low, high = torch.tensor([self.config.smooth, self.config.match]).to(logs).T
            sizes = torch.log10(torch.stack([mask.sum(1) / 100, size], 1))
            conditions = torch.cat([logs.clamp(low, high) - logs.new_tensor([0, 4]), sizes], 1)
        change = self.unet(features, conditions).float()
        factor, more = torch.complex(change[:, ::2], change[:, 1::2]).unbind(1)
        return nu * (1 + factor) + size[:, None, None] * more * self.spoke**2

    def features(self, p, wanted, left, mask, nu, size):
        """SEEN as channels (B, 10, rings, spokes), the count after `wanted`, and the radius."""
        places = self.grid.locate(p)
        (wanted, count), (left, _) = (self.landmarks(places, x, mask) for x in (wanted, left))
        fields = zip(SEEN.values(), (nu / size[:, None, None], self.born.moved(nu), wanted, left))
        turned = [scale * field * self.spoke.conj() ** times for (times, scale, _), field in fields]
        channels = [part for field in turned for part in (field.real, field.imag)]
        radius = self.grid.radius[1:, None].expand_as(count)
        return torch.stack([*channels[:6], count, *channels[6:], radius], 1)

    def landmarks(self, places, values, mask):
        """Values at the landmarks as a field (B, rings, spokes), and their number at each node."""
        values = torch.stack([values.real, values.imag, torch.ones_like(mask)], 1) * mask[:, None]
        spread = self.grid.splat(values, places)[:, :, 1:].unflatten(2, self.grid.z.shape)
        return torch.complex(spread[:, 0], spread[:, 1]), spread[:, 2]

    def answer(self, problem, weights, looks=None):
        """mu (F,) of a `Problem`.

        looks: how many exact maps of its mesh are made, each followed by one Gauss-Newton step
        (default: `looks_at(weights)`). The U-Net is trained for weights within `config.smooth` and
        `config.match`, and takes others for the nearest of those; the looks take them for what they
        are. LandmarkError for more than `config.most` landmarks.
        """
        *_, mu = self.stages(problem, weights, looks)
        return mu

    @inference
    @threadpool_limits.wrap(limits=1)
    def answers(self, problem, weights, looks=3):
        """The answers mu (F,) after 0 to `looks` refinements from either start, dict name -> mu.

        "Born step" has learned nothing, "CP-Net" begins where the U-Net says; `predict` returns one
        of these.
        """
        answers = {}
        for learned, name in ((False, "Born step"), (True, "CP-Net")):
            for number, mu in enumerate(self.stages(problem, weights, looks, learned)):
                seen = "" if number == 0 else f", {number} look{'s' * (number > 1)}"
                answers[name + (seen or ", no look" * learned)] = mu
        return answers

    def stages(self, problem, weights, looks=None, learned=None):
        """The answers mu (F,) before any look and after each, one after the other.

        learned: whether the looks begin where the U-Net says. By default they do unless the weights
        are stiff: then the Born step is as good a start, and the answer is the best of the looks,
        as the last step may lead astray.
        """
        points = p, q = problem.moving, problem.target
        if len(p) > (most := self.config.most):
            advice = "thin the curves, or use fit_landmarks"
            raise LandmarkError(f"{len(p)} landmarks, and CP-Net takes at most {most}: {advice}")
        ratios = weights.beta / weights.alpha, weights.gamma / weights.alpha
        looks, stiff = self.looks_at(weights) if looks is None else looks, self.is_stiff(weights)
        learned = not stiff if learned is None else learned
        spectrum, spread = self.carrier(self.rings(p, q, weights))
        mesh = coefficient_mesh_of(problem.disk, spectrum.mesh)
        start = spread @ self.start(points, ratios) if learned else None
        refinement = CoefficientRefinement(mesh, spectrum, points, *ratios)
        for number, (proposal, best) in enumerate(refinement.run(start, looks)):
            chosen = best.proposal if number and stiff else proposal
            yield mesh.coefficient(chosen.nu)

    def start(self, points, ratios):
        """nu (N,) at the vertices of the network's mesh, before any look."""
        own, _ = self.carrier(self.config.rings)
        mesh = coefficient_mesh_of(own.mesh, own.mesh)
        born, wanted, left = CoefficientRefinement(mesh, own, points, *ratios).born()
        nu = born[1:].reshape(self.grid.z.shape)
        fields = points[0], wanted, left, nu
        p, wanted, left, nu = (torch.from_numpy(x)[None].to(self.grid.z) for x in fields)
        logs = torch.from_numpy(np.log10(np.maximum(ratios, 1e-12)))[None].to(self.grid.area)
        nu = self(p, wanted, left, torch.ones_like(p.real), logs, nu)
        return self.grid.with_centre(nu)[0].cpu().numpy().astype(complex)

    def is_stiff(self, weights):
        """Whether gamma / beta is so large that the landmarks' last digits decide."""
        return weights.gamma >= self.config.stiff * weights.beta

    def looks_at(self, weights):
        """How many looks these weights are given."""
        return self.config.stiff_looks if self.is_stiff(weights) else self.config.looks

    def rings(self, p, q, weights):
        """How many rings carry nu while these landmarks are looked at."""
        config = self.config
        if self.is_stiff(weights):
            return config.finest
        apart = min(np.min(abs(x[:, None] - x) + np.eye(len(x))) for x in (p, q))
        return config.finer if apart < config.close / config.rings else config.rings

    def carrier(self, rings):
        """The `Spectrum` of so many rings, and the sparse matrix to its vertices."""
        if rings not in self.carriers:
            spectrum = Spectrum(rings, rings * self.config.spokes // self.config.rings)
            self.carriers[rings] = spectrum, self.grid.mesh.interpolation(spectrum.mesh.z)
        return self.carriers[rings]

    def loss(self, batch, generator):
        """Mean log of the squared error against a fit's field, over that of the Born step."""
        with torch.autocast(batch[0].device.type, enabled=False):
            *given, target = self.draw(batch, generator)
        nu = self(*given)
        before, after = (self.grid.mean_square(x - target) for x in (given[-1], nu))
        share = after / (before + FLOOR * self.grid.mean_square(target) + SMALL**2)
        figures = {"error": share.sqrt().mean().item(), "born": before.sqrt().mean().item()}
        return (share + FLOOR).log().mean(), figures

    def draw(self, batch, generator):
        """The batch's problems; with a generator turned by whole spokes, and mirrored."""
        *points, mask, logs, born, target = batch
        most = int(mask.sum(1).max())
        points, fields = [x[:, :most] for x in points], [born, target]
        if generator is not None:
            spokes = self.config.spokes
            by = torch.randint(spokes, (len(mask), 1), generator=generator)
            mirror = torch.rand(len(mask), 1, generator=generator) < 0.5
            # Whose values come here.
            places = (torch.where(mirror, -1, 1) * (torch.arange(spokes) - by)) % spokes
            places = places.to(mask.device)[:, None].expand(born.shape)
            turn, mirror = torch.exp(2j * torch.pi * by / spokes).to(born), mirror.to(mask.device)
            points = [torch.where(mirror, x.conj(), x) * turn for x in points]
            fields = [torch.where(mirror[..., None], x.conj(), x).gather(2, places) for x in fields]
            fields = [x * turn[..., None] ** 2 for x in fields]
        return *points, mask[:, :most], logs, *fields


PRESETS = {"paper": (PaperCPNet, PaperCPNetConfig()), "best": (BestCPNet, BestCPNetConfig())}
TRAINING = {
    "paper": TrainConfig(steps=9_000, batch=16, rate=2e-3, bfloat16=True, validate_every=150),
    "best": TrainConfig(steps=3_000, batch=8, rate=2e-3, weight_decay=1e-3, validate_every=250),
}
