"""What several networks share: convolutions on the polar mesh, and the crossing between NumPy and torch."""

from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional


class PolarPad(torch.autograd.Function):
    """x (B, C, rings, spokes) with one more ring and spoke on every side, for a 3 x 3 convolution on the disk.

    Periodic in the angle; beyond the centre the disk goes on at the opposite spoke; beyond the circle the last ring is
    repeated. Right for functions and for components in the frame that turns twice with the spoke, as those of mu.
    (Written out, with its adjoint, because slices and `cat` lose the channels-last layout on the way back.)
    """

    @staticmethod
    def forward(ctx, x):
        rings, spokes = x.shape[-2:]
        wide = x.new_empty(*x.shape[:2], rings + 2, spokes + 2).contiguous(memory_format=torch.channels_last)
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
    """3 x 3 convolution on the grid of rings and spokes with the neighbours of the disk (`PolarPad`)."""

    def __init__(self, channels_in, channels_out):
        super().__init__(channels_in, channels_out, 3)

    def forward(self, x):
        return super().forward(PolarPad.apply(x))


class PolarBlock(nn.Module):
    """x + conv(act(conv(act(x)))), the last convolution zero at the start: the block begins as the identity."""

    def __init__(self, channels):
        super().__init__()
        self.first, self.second = PolarConv(channels, channels), PolarConv(channels, channels)
        nn.init.zeros_(self.second.weight)
        nn.init.zeros_(self.second.bias)

    def forward(self, x):
        return x + self.second(functional.silu(self.first(functional.silu(x))))


class PolarUNet(nn.Module):
    """U-Net on the grid of rings and spokes: (B, inputs, rings, spokes) -> (B, outputs, rings, spokes).

    channels: one number a level, each level half as fine; rings and spokes divisible by 2^(levels - 1). blocks:
    residual blocks on the coarsest level; the others have one on the way down and one on the way up.
    """

    def __init__(self, inputs, outputs, channels, blocks=3):
        super().__init__()
        pairs = list(pairwise(channels))
        self.stem, self.head = PolarConv(inputs, channels[0]), PolarConv(channels[0], outputs)
        self.down = nn.ModuleList(PolarBlock(fine) for fine, _ in pairs)
        self.coarser = nn.ModuleList(nn.Conv2d(fine, coarse, 2, stride=2) for fine, coarse in pairs)
        self.bottom = nn.Sequential(*(PolarBlock(channels[-1]) for _ in range(blocks)))
        self.finer = nn.ModuleList(nn.Conv2d(coarse, fine, 1) for fine, coarse in pairs)
        self.up = nn.ModuleList(PolarBlock(fine) for fine, _ in pairs)
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)

    def forward(self, x):
        x, kept = self.stem(x.contiguous(memory_format=torch.channels_last)), []
        for block, coarser in zip(self.down, self.coarser):
            kept.append(block(x))
            x = coarser(kept[-1])
        x = self.bottom(x)
        for finer, block, skip in zip(reversed(self.finer), reversed(self.up), reversed(kept)):
            x = block(functional.interpolate(finer(x), scale_factor=2.0, mode="nearest") + skip)
        return self.head(functional.silu(x))
