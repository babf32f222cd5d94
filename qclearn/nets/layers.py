"""Shared by networks: small stacks of layers, polar convolutions, and calls from NumPy."""

from functools import lru_cache, wraps
from itertools import pairwise

import numpy as np
import torch
from scipy import ndimage
from threadpoolctl import threadpool_limits
from torch import nn
from torch.nn import functional

from ..plane.checks import check_coefficient
from ..plane.disk import Disk
from ..plane.solver import DiskSolver
from ..registration.problem import Problem, Weights

FIRST_SCALE = 0.1  # of a conditioned U-Net's outputs, before the conditions change it


def inference(method):
    """Let a network's call run without gradients and on one thread of torch.

    The work is small: on a busy machine threads that wait for each other cost far more than they
    save.
    """

    @wraps(method)
    @torch.no_grad()
    def alone(*arguments, **options):
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            return method(*arguments, **options)
        finally:
            torch.set_num_threads(threads)

    return alone


def perceptron(*sizes, activation=nn.SiLU):
    """Linear layers from each of these sizes to the next, with activations between them."""
    linear = [nn.Linear(*pair) for pair in pairwise(sizes)]
    later = [part for layer in linear[1:] for part in (activation(), layer)]
    return nn.Sequential(linear[0], *later)


def convolution(channels_in, channels_out, **options):
    """A 3 x 3 convolution with batch normalisation and a ReLU, as a list."""
    layer = nn.Conv2d(channels_in, channels_out, 3, padding=1, bias=False, **options)
    return [layer, nn.BatchNorm2d(channels_out), nn.ReLU(inplace=True)]


def zero(layer):
    """The layer with parameters 0: at the start of training it gives 0."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
    return layer


class PolarPad(torch.autograd.Function):
    """x (B, C, rings, spokes) with a ring and a spoke more on every side, for 3 x 3 convolutions.

    The angle is periodic, the disk goes on at the opposite spoke beyond the centre, and the last
    ring is repeated beyond the circle. This is right for functions, and for components of mu in the
    frame that turns with the spoke. The adjoint is written out, because slices and `cat` lose the
    channels-last layout on the way back.
    """

    @staticmethod
    def forward(ctx, x):
        rings, spokes = x.shape[-2:]
        wide = x.new_empty(*x.shape[:2], rings + 2, spokes + 2)
        wide = wide.contiguous(memory_format=torch.channels_last)
        wide[..., 1:-1, 1:-1] = x
        wide[..., 0, 1:-1] = x[..., 0, :].roll(spokes // 2, -1)
        wide[..., -1, 1:-1] = x[..., -1, :]
        wide[..., 0], wide[..., -1] = wide[..., -2], wide[..., 1]
        return wide

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad):
        spokes = grad.shape[-1] - 2
        columns = grad[..., 1:-1].clone(memory_format=torch.channels_last)
        columns[..., -1] += grad[..., 0]
        columns[..., 0] += grad[..., -1]
        inner = columns[..., 1:-1, :].contiguous(memory_format=torch.channels_last)
        inner[..., 0, :] += columns[..., 0, :].roll(-(spokes // 2), -1)
        inner[..., -1, :] += columns[..., -1, :]
        return inner


class PolarConv(nn.Conv2d):
    """3 x 3 convolution on rings and spokes with the disk's neighbours (`PolarPad`)."""

    def __init__(self, channels_in, channels_out):
        super().__init__(channels_in, channels_out, 3)

    def forward(self, x):
        return super().forward(PolarPad.apply(x))


class PolarBlock(nn.Module):
    """x + conv(act(conv(act(x)))), the identity at first: the last convolution begins at zero."""

    def __init__(self, channels):
        super().__init__()
        self.first, self.second = PolarConv(channels, channels), zero(PolarConv(channels, channels))

    def forward(self, x):
        return x + self.second(functional.silu(self.first(functional.silu(x))))


class PolarUNet(nn.Module):
    """U-Net on rings and spokes: (B, inputs, rings, spokes) -> (B, outputs, rings, spokes).

    channels: one number a level; each level is half as fine as the one before, and 2^(levels - 1)
    must divide rings and spokes. blocks: residual blocks on the coarsest level; the other levels
    have one down and one up.
    """

    def __init__(self, inputs, outputs, channels, blocks):
        super().__init__()
        pairs = list(pairwise(channels))
        self.stem, self.head = PolarConv(inputs, channels[0]), zero(PolarConv(channels[0], outputs))
        self.down = nn.ModuleList(PolarBlock(fine) for fine, _ in pairs)
        self.coarser = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in pairs)
        self.bottom = nn.Sequential(*(PolarBlock(channels[-1]) for _ in range(blocks)))
        self.finer = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs)
        self.up = nn.ModuleList(PolarBlock(fine) for fine, _ in pairs)

    def forward(self, x, modulate=lambda x: x):
        """modulate changes the first features of each level on the way down."""
        x = modulate(self.stem(x.contiguous(memory_format=torch.channels_last)))
        skips = []
        for block, coarser in zip(self.down, self.coarser):
            skips.append(block(x))
            x = modulate(coarser(skips[-1]))
        x = self.bottom(x)
        for finer, block, skip in zip(reversed(self.finer), reversed(self.up), reversed(skips)):
            x = block(functional.interpolate(finer(x), scale_factor=2.0, mode="nearest") + skip)
        return self.head(functional.silu(x))


class ConditionedUNet(PolarUNet):
    """The polar U-Net with FiLM: conditions (B, n) scale and shift the channels of every level."""

    def __init__(self, inputs, outputs, conditions, channels, blocks):
        super().__init__(inputs, outputs, channels, blocks)
        self.sizes = [*(2 * size for size in channels), outputs]
        self.film = perceptron(conditions, 64, sum(self.sizes))
        zero(self.film[-1])

    def forward(self, x, conditions):
        films = iter(self.film(conditions).split(self.sizes, 1))

        def modulate(x):
            scale, shift = next(films)[..., None, None].chunk(2, 1)
            return x * (1 + scale) + shift

        output = super().forward(x, modulate)
        return FIRST_SCALE * torch.exp(next(films))[..., None, None] * output


def disk_of(z, faces):
    """The `Disk` of z (V,) and faces (F, 3); the last four are cached, with their properties."""
    return _disk_of(np.asarray(z, complex).tobytes(), np.asarray(faces, np.int64).tobytes())


@lru_cache(maxsize=4)
def _disk_of(z, faces):
    disk = Disk(np.frombuffer(z, complex), np.frombuffer(faces, np.int64).reshape(-1, 3))
    DiskSolver(disk)  # which refuses what is no mesh of the unit disk
    return disk


@lru_cache(maxsize=4)
def holding(disk, network):
    """The faces (P,) of a `Disk` that hold the pixels of a `DiskNetwork`."""
    return disk.locate(network.pixels)[0]


class DiskNetwork(nn.Module):
    """A network from coefficients to maps on its own mesh, which serves any mesh by resampling.

    A subclass offers `pixels`, the points (P,) where it takes mu, and `run(mu (P,), **options)`,
    which returns the map as a function of points of the disk.
    """

    @inference
    def solve(self, z, faces, mu, **options):
        """The network's map f (V,) for mu (F,) on a disk mesh z (V,), faces (F, 3); deterministic.

        f(0) = 0, and boundary vertices lie on the circle. Not certified: ask `check_bijective`.
        BeltramiError for NaN or |mu| >= 1, or faces that are no disk; SurfaceError where the
        boundary is off the unit circle.
        """
        mu = check_coefficient(mu, len(faces))
        disk = disk_of(z, faces)
        f = self.run(mu[holding(disk, self)], **options)(disk.z)
        f[disk.loop] /= abs(f[disk.loop])
        return f


class CoefficientNetwork(nn.Module):
    """A network that maps landmarks on any disk mesh to mu on its faces.

    A subclass offers `answer(problem, weights, **options)`, which returns mu (F,) of a `Problem`,
    and `usual(alpha)`, the `Weights` of calls that name no others.
    """

    usual = Weights

    @inference
    @threadpool_limits.wrap(limits=1)
    def predict(
        self, z, faces, moving, target, alpha=1.0, beta=None, gamma=None, curve=None, **options
    ):
        """mu (F,) on a disk mesh whose map takes `moving` to `target` (M,), as `fit_landmarks`.

        The map is `solve_beltrami_disk(z, faces, mu)` and the best Möbius map after it. curve is
        checked, not used. LandmarkError for landmarks or weights that the network cannot take;
        BeltramiError or SurfaceError where the mesh is no disk. options: of the network's `answer`.
        """
        usual = self.usual(alpha)
        beta = usual.beta if beta is None else beta
        gamma = usual.gamma if gamma is None else gamma
        weights = Weights(alpha, beta, gamma)
        return self.answer(Problem(disk_of(z, faces), moving, target, curve), weights, **options)


class PolarFunction:
    """The map f(z) = z q(z), q (rings, spokes) at the radii 1/rings ... 1, bilinear between.

    Inside the first ring q has that ring's values. Cubic interpolation is no more accurate and
    takes longer.
    """

    def __init__(self, q):
        self.rings, self.spokes = q.shape
        self.q = np.concatenate([q[:1], q])
        self.q = np.concatenate([self.q, self.q[:, :1]], 1)

    def __call__(self, z):
        place = [abs(z) * self.rings, np.angle(z) % (2 * np.pi) * self.spokes / (2 * np.pi)]
        return z * ndimage.map_coordinates(self.q, place, order=1, mode="nearest")
