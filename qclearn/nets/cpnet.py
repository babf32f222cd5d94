"""CP-Net, the coefficient prediction network: landmarks and the weights of `L_CP` to the Beltrami coefficient mu.

Preset `best` starts from the linearised landmark fit (`born`) and corrects it, and corrects it again with the landmark
error that an exact solve on a coarse mesh has measured. Preset `paper` (`cpnet_paper`) is the network as printed.
"""

from dataclasses import dataclass

import torch
from torch import nn

from ..registration.problem import LandmarkError, Weights, check_landmarks
from .born import Born
from .cpnet_paper import PaperCPNet, PaperCPNetConfig
from .layers import ConditionedUNet, disk_mesh, inference
from .linearised import Linearised
from .polar import PolarSolver
from .polargrid import PolarGrid, PolarMesh
from .torchplane import bounded, fit_mobius, mobius
from .train import TrainConfig

INSIDE, LOSS = (1e-3, 8), (1e-3, 20)  # tolerance and most steps of the solver inside the network, and in the loss

FIELD = 0.03  # of the U-Nets' outputs that bend the field itself

# What the two corrections see on the grid, in order: name -> (how often its frame turns with the spoke, scale that
# brings it to the size of 1, why it is shown). Complex ones make two channels.
FIRST = {
    "nu": (2, 1, "the Born step, which is corrected"),
    "moved": (1, 5, "what it does to the nodes, to first order"),
    "wanted": (1, 10, "at the landmarks: where they should go, and how many share a node"),
    "left": (1, 10, "at the landmarks: what the Born step leaves of that"),
}
SECOND = {
    "nu": (2, 1, "the first answer, which is corrected"),
    "chord": (2, 1, "what the Born step's linearisation would change, now that the true error is known"),
    "moved": (1, 5, "what the exact map does to the nodes"),
    "left": (1, 50, "at the landmarks: the error of the exact map, and how many share a node"),
}
SMALL = 1e-3  # an L_CP / alpha below which the loss asks for no more: where p = q it is 0


@dataclass(frozen=True)
class BestCPNetConfig:
    """Sizes of the better CP-Net. Ranges are of log10, three decades each."""

    preset: str = "best"
    rings: int = 24
    spokes: int = 72
    modes: int = 512
    first: tuple = (16, 32, 64)
    second: tuple = (24, 48, 64)
    blocks: int = 2
    looks: int = 0  # at the exact map; trained with one
    stiffest: float = 5.5  # log10 of gamma / beta, see `BestCPNet.gamma_used`
    most: int = 128  # landmarks
    smooth: tuple = (-2.0, 1.0)  # of beta / alpha
    match: tuple = (2.3, 5.3)  # of gamma / alpha


def check_count(points, most):
    if len(points) > most:
        raise LandmarkError(
            f"{len(points)} landmarks, and CP-Net takes at most {most}: thin the curves, or use fit_landmarks"
        )


class BestCPNet(nn.Module):
    """nu on a polar grid from landmarks p, targets q (B, M) with a mask (B, M), and weights (B, 2).

    weights: beta / alpha and gamma / alpha, since only ratios decide the minimiser.
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        self.grid = PolarGrid(config.rings, config.spokes, modes=config.modes)
        self.born = Born(self.grid)
        self.solver = PolarSolver(config.rings, config.spokes, self.grid.power)
        self.one = ConditionedUNet(10, 8, 3, config.first, config.blocks)
        self.two = ConditionedUNet(10, 8, 6, config.second, config.blocks)
        self.register_buffer("spoke", self.grid.z / self.grid.z.abs(), persistent=False)
        self.to(memory_format=torch.channels_last)

    @property
    def ranges(self):
        return self.config.smooth, self.config.match

    def forward(self, p, q, mask, weights, looks=None):
        """nu (B, rings, spokes) after `looks` looks (default: the configuration's) at the exact map."""
        problem, _, nu = self.begin(p, q, mask, weights)
        for _ in range(self.config.looks if looks is None else looks):
            _, _, nu = self.look(problem, nu)
        return nu

    def begin(self, p, q, mask, weights):
        """The problem, its Born step and the first correction."""
        kind = p.device.type
        with torch.autocast(kind, enabled=False), torch.no_grad():
            problem = Linearised(self.grid, self.born, self.ranges, p, q, mask, weights)
            features, conditions = self.first_features(problem)
        change = self.one(features, conditions)
        with torch.autocast(kind, enabled=False):
            return problem, problem.nu, self.correct(problem, problem.residual, 0.0, change.float())

    def look(self, problem, nu):
        """The exact map of nu on the network's mesh, the chord step from there, and the next correction."""
        kind = problem.p.device.type
        with torch.autocast(kind, enabled=False):
            f = self.solver.solve(bounded(self.grid.on_faces(nu)), *INSIDE)
            with torch.no_grad():
                features, conditions, chord, residual, linear = self.second_features(problem, nu.detach(), f.detach())
        change = self.two(features, conditions)
        with torch.autocast(kind, enabled=False):
            return f, chord, self.correct(problem, residual, linear, change.float())

    def correct(self, problem, residual, linear, change):
        """The dual step for a corrected residual (B, M), plus a correction of the field itself, from the U-Net's
        output.

        change (B, 8, rings, spokes): at the landmarks a factor and, in units of the residual's size, a vector in the
        frame of the spoke; on the grid a factor and an addition in the frame that turns twice with the spoke.
        """
        pairs = torch.complex(change[:, ::2], change[:, 1::2])
        fields = torch.stack([pairs[:, 0], pairs[:, 1] * self.spoke], 1)
        fields = torch.cat([fields[:, :, 0].mean(-1, keepdim=True), fields.flatten(2)], 2).flatten(0, 1)
        twice = [part.repeat_interleave(2, 0) for part in problem.places]
        gain, vector = self.grid.sample(fields, twice).unflatten(0, (-1, 2)).unbind(1)
        size = ((residual.abs() ** 2).sum(1, keepdim=True) / problem.mask.sum(1, keepdim=True)).sqrt()
        wanted = residual * (1 + gain) + problem.slope * size * vector * problem.mask
        nu = self.grid.field(problem.step((wanted - linear) * problem.scale)[0])
        return nu * (1 + FIELD * pairs[:, 2]) + FIELD * pairs[:, 3] * self.spoke**2

    def first_features(self, problem):
        """FIRST as channels (B, 10, rings, spokes), and conditions (B, 3)."""
        left = problem.displacement - problem.born_displacement
        (wanted, count), (left, _) = (
            self.landmarks(problem, values, FIRST[name][1])
            for name, values in (("wanted", problem.displacement), ("left", left))
        )
        fields = {
            "nu": problem.nu,
            "moved": FIRST["moved"][1] * self.born.moved(problem.c),
            "wanted": wanted,
            "left": left,
        }
        channels = [part for name, field in fields.items() for part in self.turning(field, FIRST[name][0])]
        return self.stack([*channels[:6], count, *channels[6:]]), problem.conditions

    def second_features(self, problem, one, f):
        """SECOND as channels (B, 10, rings, spokes), conditions (B, 6), the chord step, and the residual,
        seen and linear."""
        parameters = fit_mobius(self.grid.sample(f, problem.places), problem.q, problem.mask)
        w_all = mobius(f, *parameters)
        w = self.grid.sample(w_all, problem.places)
        residual = (w - problem.q) * problem.mask
        linear = problem.slope * problem.linear(self.grid.coefficients(one))
        chord = self.grid.field(problem.step((residual - linear) * problem.scale)[0])
        moved = (w_all - mobius(self.identity(len(w)), *problem.parameters))[:, 1:].view_as(one)  # (B, rings, spokes)
        left, count = self.landmarks(problem, -residual, SECOND["left"][1])
        fields = {"nu": one, "chord": chord - one, "moved": SECOND["moved"][1] * moved, "left": left}
        channels = [part for name, field in fields.items() for part in self.turning(field, SECOND[name][0])] + [count]
        size, slope = self.grid.terms(bounded(one))
        b, g = problem.weights.unbind(1)
        count = problem.mask.sum(1)
        parts = [size + b * slope, g * (residual.abs() ** 2).sum(1) / count, problem.promised]
        extra = torch.stack([torch.log10(part.clamp(min=1e-12)) for part in parts], 1)
        return self.stack(channels), torch.cat([problem.conditions, extra], 1), chord, residual, linear

    def identity(self, count):
        z = torch.cat([self.grid.z.new_zeros(1), self.grid.z.flatten()])
        return z.expand(count, -1)

    def turning(self, field, times):
        """Real and imaginary part of a field (B, rings, spokes)
        in the frame that turns so many times with the spoke."""
        field = field * self.spoke.conj() ** times
        return field.real, field.imag

    def landmarks(self, problem, values, scale):
        """Complex values at the landmarks as a field (B, rings, spokes), and their number at each node."""
        values = torch.stack([scale * values.real, scale * values.imag, problem.mask], 1) * problem.mask[:, None]
        spread = self.grid.splat(values, problem.places)[:, :, 1:].unflatten(
            2, self.grid.z.shape
        )  # (B, 3, rings, spokes)
        return torch.complex(spread[:, 0], spread[:, 1]), spread[:, 2]

    def stack(self, channels):
        radius = self.grid.radius[1:, None].expand_as(channels[0])  # (B, rings, spokes)
        return torch.stack([*channels, radius], 1)

    @inference
    def predict(self, z, faces, moving, target, alpha=1.0, beta=1e-2, gamma=1e5, curve=None, looks=None):
        """mu (F,) on a disk mesh z (V,), faces (F, 3) whose map takes `moving` to `target` (M,), as `fit_landmarks`.

        The map is `solve_beltrami_disk(z, faces, mu)` and the best Möbius map after it. Trained for `config.smooth` and
        `config.match`; beyond these ranges the linearised fit still has the weights, the corrections those of the
        nearest place inside; and gamma / beta is used up to `config.stiffest`. looks: exact maps on the network's mesh
        in between (default: the configuration's), each better and slower. curve is not used. LandmarkError for bad
        landmarks or weights, or more than `config.most` landmarks; BeltramiError or SurfaceError where the mesh is no
        disk.
        """
        given = self.tensors(moving, target, Weights(alpha, beta, gamma))
        return self.on_mesh(disk_mesh(z, faces), self(*given, looks))

    @torch.no_grad()
    def answers(self, problem, weights, looks=3):
        """What `predict` would say of a `Problem` after each of its stages: dict name -> mu (F,), in order."""
        mesh = disk_mesh(problem.z, problem.faces)
        linearised, born, nu = self.begin(*self.tensors(problem.moving, problem.target, weights))
        found = {"Born step": born, "first correction": nu}
        for number in range(1, looks + 1):
            _, chord, nu = self.look(linearised, nu)
            found |= {"chord step": chord} if number == 1 else {}
            found[f"{number} look{'s' * (number > 1)}"] = nu
        return {name: self.on_mesh(mesh, nu) for name, nu in found.items()}

    def tensors(self, moving, target, weights):
        """Checked landmarks, their mask and the ratios of the weights as tensors (1, ...)."""
        moving, target, _ = check_landmarks(moving, target, None, False)
        check_count(moving, self.config.most)
        p, q = (torch.from_numpy(points)[None].to(self.grid.z) for points in (moving, target))
        ratios = torch.tensor([[weights.beta / weights.alpha, self.gamma_used(weights) / weights.alpha]])
        return p, q, torch.ones_like(p.real), ratios.to(self.grid.area)

    def gamma_used(self, weights):
        """The gamma that `predict` answers for: the given one, or a smaller one beyond `config.stiffest`.

        There, on the validation subjects, the answer for the smaller gamma is the better one at the larger gamma too.
        """
        smooth = max(weights.beta / weights.alpha, 10 ** self.config.smooth[0])
        return min(weights.gamma, weights.alpha * 10**self.config.stiffest * smooth)

    def on_mesh(self, mesh, nu):
        """The coefficient mu (F,) of nu (1, rings, spokes) at the centroids of a `DiskMesh`."""
        corners, share = mesh.places(self, lambda: self.grid.locate(torch.from_numpy(mesh.centroids).to(nu)))
        mu = bounded((self.grid.with_centre(nu)[0, corners] * share).sum(-1))
        return mu.cpu().numpy().astype(complex)

    def loss(self, batch, generator):
        """Mean of log L_CP after both corrections, the maps exact: the second on a finer mesh than the network's."""
        with torch.autocast(batch[0].device.type, enabled=False):
            p, q, mask, weights = self.draw(batch, generator)
        problem, _, one = self.begin(p, q, mask, weights)
        f, _, two = self.look(problem, one)
        with torch.autocast(p.device.type, enabled=False):
            first = self.objective(one, self.grid.sample(f, self.grid.locate(p)), q, mask, weights)[0] + SMALL
            solver, mesh, corners, share = self.fine
            f = solver.solve(bounded((self.grid.with_centre(two)[:, corners] * share).sum(-1)), *LOSS)
            second, error = self.objective(two, mesh.sample(f, mesh.locate(p)), q, mask, weights)
            second = second + SMALL
            loss = (second.log() + 0.3 * first.log()).mean()
        figures = {
            "first": first.log().mean().item(),
            "second": second.log().mean().item(),
            "error": error.mean().item(),
        }
        return loss, figures

    @property
    def fine(self):
        """Another polar mesh, on which the loss is measured: (solver, mesh, corners (F, 3)
        and weights of its faces)."""
        if not hasattr(self, "_fine"):
            rings, spokes = 4 * self.config.rings // 3, 4 * self.config.spokes // 3
            solver = PolarSolver(rings, spokes, self.grid.power)
            centres = torch.from_numpy(solver.z[solver.faces].mean(1)).to(self.grid.z)
            self._fine = solver, PolarMesh(rings, spokes).to(self.grid.z.device), *self.grid.locate(centres)
        return self._fine

    def objective(self, nu, mapped, q, mask, weights):
        """`L_CP / alpha` (B,) with the best Möbius map after the map, and the mean distance of the landmarks (B,)."""
        w = mobius(mapped, *fit_mobius(mapped, q, mask))
        size, slope = self.grid.terms(bounded(nu))
        distance = (w - q).abs() * mask
        count = mask.sum(1)
        b, g = weights.unbind(1)
        return size + b * slope + g * (distance**2).sum(1) / count, distance.sum(1) / count

    def draw(self, batch, generator):
        """The batch's problems; with a generator turned, mirrored and with new weights."""
        p, q, mask, logs = batch
        p, q, mask = (x[:, : int(mask.sum(1).max())] for x in (p, q, mask))
        if generator is not None:
            turn, mirror, b, g = torch.rand(4, len(p), generator=generator).to(mask)
            turn = torch.exp(2j * torch.pi * turn)[:, None]
            p, q = (torch.where(mirror[:, None] < 0.5, x, x.conj()) * turn for x in (p, q))
            logs = torch.stack(
                [low + (high - low) * x for x, (low, high) in ((b, self.config.smooth), (g, self.config.match))], 1
            )
        return p, q, mask, 10**logs


PRESETS = {"paper": (PaperCPNet, PaperCPNetConfig()), "best": (BestCPNet, BestCPNetConfig())}
TRAINING = {
    "paper": TrainConfig(steps=900, batch=16, rate=2e-3, bfloat16=True, validate_every=150),
    "best": TrainConfig(steps=4_000, batch=16, rate=1.5e-3, bfloat16=True, validate_every=250),
}
