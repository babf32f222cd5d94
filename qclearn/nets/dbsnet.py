"""DBS-Net, the disk Beltrami solver network: from mu (F,) to the map f, f(0) = 0, f(1) = 1.

Preset `best` corrects, in logarithmic coordinates, what two preconditioned steps know about the
map; the circle is preserved exactly. Preset `paper` (`dbsnet_paper`) is the paper's, corrected.
"""

from dataclasses import dataclass

import torch
from torch.nn import functional

from .dbsnet_paper import PaperDBSNet, PaperDBSNetConfig, mixed
from .layers import DiskNetwork, PolarFunction, PolarUNet
from .losses import LossMesh
from .polar import PolarSolver, harmonic_extension, two_steps
from .train import TrainConfig

TOLERANCE = 1e-5  # of the exact maps that the network learns from

# The network's input, in order: name -> (scale, which brings it to the size of 1 at |mu| = 0.5; why
# it is shown).
FEATURES = {
    "inner.re": (1, "mu of each cell's inner face, in the frame that turns with the spoke"),
    "inner.im": (1, "the same, imaginary part"),
    "outer.re": (1, "mu of each cell's outer face"),
    "outer.im": (1, "the same, imaginary part"),
    "u": (3, "log-radius of the map after two steps, which is corrected"),
    "v": (3, "its turn, which is corrected"),
    "change.re": (10, "from the first step to the second: how fast u converges"),
    "change.im": (10, "and v"),
    "residual.re": (20, "what a third step would add to u: the remaining error, to first order"),
    "residual.im": (20, "and to v"),
    "U.change": (10, "from the first potential of log|f| to the second"),
    "U.against u": (10, "two discretisations of log|f|: they differ where the mesh is too coarse"),
    "rim.change": (5, "turn of the boundary between the steps, carried inwards harmonically"),
    "rim.residual": (20, "what the next step would add to it"),
}


@dataclass(frozen=True)
class BestDBSNetConfig:
    """Sizes of the better DBS-Net."""

    preset: str = "best"
    max_abs: tuple = (0.05, 0.6)  # of the coefficients it is trained on
    rings: int = 48
    spokes: int = 144
    channels: tuple = (24, 48, 96, 128)
    blocks: int = 3


class BestDBSNet(DiskNetwork):
    """f = z exp(u + iv): two preconditioned steps, plus what a U-Net on the polar mesh adds.

    u = 0 on the circle and v(1) = 0 by construction, so that the boundary stays on the circle, f(0)
    = 0 and f(1) = 1.
    """

    def __init__(self, config):
        super().__init__()
        self.config = config
        self.solver = PolarSolver(config.rings, config.spokes)
        self.mesh = LossMesh(self.solver.mesh)
        self.unet = PolarUNet(len(FEATURES), 2, config.channels, config.blocks)
        z = torch.tensor(self.solver.mesh.z[1:]).reshape(1, config.rings, config.spokes)
        self.register_buffer("z", z.to(torch.complex64), persistent=False)
        self.register_buffer("radius", z.abs().float(), persistent=False)

    @property
    def pixels(self):
        """The centroids (F,) of the polar mesh."""
        return self.solver.mesh.centroids

    def run(self, mu, steps=0):
        """The map of mu (F,), after `steps` steps of the exact solver, as a function of points."""
        f = self.refine(torch.from_numpy(mu).to(self.z)[None], steps)
        return PolarFunction((f[:, 1:].view(self.z.shape) / self.z)[0].cpu().numpy())

    def refine(self, mu, steps):
        """The maps (B, V) after `steps` conjugate gradient steps from its own."""
        f = self(mu)
        return self.solver.solve(mu, 0.0, steps, start=f) if steps else f

    def forward(self, mu):
        """The maps f (B, V) of mu (B, F) on the polar mesh."""
        with torch.autocast(mu.device.type, enabled=False), torch.no_grad():
            features, u, v = self.features(mu)
        correction = self.unet(features)
        with torch.autocast(mu.device.type, enabled=False):
            du, dv = (0.1 * correction.float()).unbind(1)
            # The factor keeps the correction of u smooth up to the circle and takes it to 0 there.
            du = du * (1 - self.radius**2)
            f = self.z * torch.exp(torch.complex(u + du, v + dv - dv[:, -1:, :1]))
            return torch.cat([f.new_zeros(len(f), 1), f.flatten(1)], 1)

    def features(self, mu):
        """FEATURES (B, 14, rings, spokes) in closed form, and the first u, v (B, rings, spokes)."""
        maps, potentials, angles = two_steps(self.solver, mu)
        # (B, rings, spokes).
        first, second, beyond = (f[:, 1:].view(-1, *self.z.shape[1:]) for f in maps)
        start, change, residual = (
            torch.log(a / b) for a, b in ((second, self.z), (second, first), (beyond, second))
        )
        u, v = start.real.clone(), start.imag
        u[:, -1] = 0
        angles = harmonic_extension(self.solver, torch.stack(angles, 1))  # (B, 2, rings, spokes)
        radius = torch.log(self.radius[:, :-1])
        lower, U = (functional.pad(U - radius, (0, 0, 0, 1)) for U in potentials)
        rows = mu.view(len(mu), -1, self.config.spokes)  # (B, 2 rings - 1, spokes)
        turn = torch.complex(*self.solver.tables(rows.real)["turn"])
        # The two faces of each cell, those at the centre twice.
        pairs = torch.cat([rows[:, :1], rows], 1) * turn
        inner, outer = pairs[:, ::2], pairs[:, 1::2]  # (B, rings, spokes)
        fields = inner, outer, torch.complex(u, v), change, residual
        known = [part for x in fields for part in (x.real, x.imag)]
        known += [U - lower, U - u, *angles.unbind(1)]  # (B, rings, spokes) each, as in FEATURES
        scales = [scale for scale, _ in FEATURES.values()]
        scaled = [scale * x for scale, x in zip(scales, known, strict=True)]
        return torch.stack(scaled, 1), u, v

    def loss(self, batch, generator):
        """Relative position error plus relative error of the derivatives, against exact maps."""
        mu = batch[0]
        with torch.autocast(mu.device.type, enabled=False), torch.no_grad():
            mu = self.rescale(mu, generator)
            exact = self.solver.solve(mu, TOLERANCE)
        f = self(mu)
        with torch.autocast(mu.device.type, enabled=False):
            position = position_error(f, exact, self.z.flatten()).mean()
            size, folds = derivative_error(self.mesh, f, exact)
            loss = position + 0.5 * size.mean() + 2 * folds.mean()
        figures = {"position": position, "derivative": size.mean(), "folds": folds.mean()}
        return loss, {name: value.item() for name, value in figures.items()}

    def rescale(self, mu, generator):
        """mu (B, F); with a generator mixed, turned, with a largest |mu| uniform in `max_abs`."""
        if generator is None:
            return mu
        draw = torch.rand(4, len(mu), generator=generator)
        order = torch.randperm(len(mu), generator=generator)
        shift = int(torch.randint(self.config.spokes, (), generator=generator))
        draw = torch.cat([draw, torch.rand(1, len(mu), generator=generator)])
        mu = mixed(mu, order, draw, self.config.max_abs).view(len(mu), -1, self.config.spokes)
        return mu.roll(shift, -1).flatten(1)


def position_error(f, exact, z):
    """Mean distance (B,) of maps (B, 1 + V), in units of the exact map's mean displacement."""
    exact, f = exact[:, 1:], f[:, 1:]
    turn = (exact * z.conj()).sum(1, keepdim=True)
    displacement = (exact - turn / turn.abs() * z).abs().mean(1)
    return (f - exact).abs().mean(1) / displacement


def derivative_error(mesh, f, exact):
    """Error of the derivatives over the exact map's smaller stretch: (RMS, excess), (B,) each.

    `d = (|e_z| + |e_zbar|) / (|f_z| - |f_zbar|)` a face, e = f - exact: a face folds only where d
    >= 1; excess is the mean of `max(d - 0.5, 0)^2`. Maps (B, V) on the `LossMesh`.
    """
    (e_z, e_zbar), (f_z, f_zbar) = mesh.wirtinger(f - exact), mesh.wirtinger(exact)
    d = (e_z.abs() + e_zbar.abs()) / (f_z.abs() - f_zbar.abs()).clamp(min=0.05)
    return (d**2).mean(1).sqrt(), (functional.relu(d - 0.5) ** 2).mean(1)


PRESETS = {"paper": (PaperDBSNet, PaperDBSNetConfig()), "best": (BestDBSNet, BestDBSNetConfig())}
TRAINING = {
    "paper": TrainConfig(steps=17_600, batch=16, rate=2e-3, validate_every=275),
    "best": TrainConfig(
        steps=7000, batch=8, rate=1e-3, warmup=200, bfloat16=True, clip=0.3, validate_every=1000
    ),
}
