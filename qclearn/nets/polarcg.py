"""Systems K x = load on a polar mesh: stencil, FFT preconditioner, conjugate gradients, adjoint."""

import torch


class Preconditioner:
    """The inverse of the matrix of mu = 0, 0 on the circle, for loads of one shape (B, S, nr, nt).

    It keeps the array of modes and all views of it: on small meshes to make them would cost more
    than to use them.
    """

    def __init__(self, load, tables):
        self.modes, self.pivots, self.nt = torch.fft.rfft(load), tables["pivots"], load.shape[-1]
        self.x = torch.view_as_real(self.modes).flatten(-2)  # a view
        self.steps, lower, stride = [], tables["lower"], 1
        while stride < load.shape[-2]:
            rest, gone = self.x[..., :: 2 * stride, :], self.x[..., stride :: 2 * stride, :]
            n_left, n_right = gone.shape[-2], rest.shape[-2] - 1
            left, right, lower = lower.split([n_left, n_right, len(lower) - n_left - n_right])
            self.steps += [
                (rest[..., :n_left, :], gone, left),
                (rest[..., 1:, :], gone[..., :n_right, :], right),
            ]
            stride *= 2

    def __call__(self, r):
        torch.fft.rfft(r, out=self.modes)
        for rest, gone, factor in self.steps:
            rest.addcmul_(factor, gone)
        self.x.mul_(self.pivots)
        for rest, gone, factor in reversed(self.steps):
            gone.addcmul_(factor, rest)
        return torch.fft.irfft(self.modes, self.nt)


class Stencil:
    """K(mu) inside the circle, values on it held at 0, from the edge weights of `PolarSystem`.

    Vertices are numbered ring by ring, so that neighbours lie 1, nt and nt + 1 places apart. The
    diagonal that closes a ring, from its last vertex to the first of the next ring, spans one
    place; the arc that closes it spans nt - 1.
    """

    def __init__(self, spoke, arc, diagonal):
        spoke, arc, diagonal = spoke[:, None], arc[:, None], diagonal[:, None]
        centre = spoke + arc + arc.roll(1, -1) + diagonal
        centre[..., 1:, :] += spoke[..., :-1, :] + diagonal[..., :-1, :].roll(1, -1)
        along, slanted = -arc, -diagonal[..., :-1, :]
        along[..., :-1, -1] = slanted[..., -1]
        slanted[..., -1] = 0
        self.centre, self.closing = centre.flatten(2), -arc[..., -1]
        self.places = [
            (1, along.flatten(2)[..., :-1]),
            (spoke.shape[-1], -spoke[..., :-1, :].flatten(2)),
            (spoke.shape[-1] + 1, slanted.flatten(2)[..., :-1]),
        ]

    def apply(self, x):
        """K x for x (B, S, nr, nt)."""
        u = x.flatten(2)
        v = self.centre * u
        for shift, weight in self.places:
            v[..., shift:].addcmul_(weight, u[..., :-shift])
            v[..., :-shift].addcmul_(weight, u[..., shift:])
        v = v.view(x.shape)
        v[..., 0].addcmul_(self.closing, x[..., -1])
        v[..., -1].addcmul_(self.closing, x[..., 0])
        # Unequal shares would never decay in the residual, and their rounding would outgrow what
        # does.
        v[..., 0, :] = v[..., 0, :].mean(-1, keepdim=True)
        return v


def conjugate_gradients(stencil, load, start, size, tables, tolerance, limit):
    """Solutions of K x = load (B, S, nr, nt) and steps (B, S); `size` None: measure by the load."""
    precondition = Preconditioner(load, tables)
    x = torch.zeros_like(load) if start is None else start.clone()
    r = load.clone() if start is None else load - stencil.apply(start)
    p = precondition(r)
    energy = _dot(r, p)
    goal = tolerance**2 * (energy if size is None else torch.full_like(energy, size**2))
    active, steps = energy > goal, torch.zeros_like(energy, dtype=int)
    for _ in range(limit):
        if not active.any():
            break
        q = stencil.apply(p)
        # A system that has converged stands still: its step is 0.
        alpha = torch.where(active, energy / _dot(p, q), 0)
        x.addcmul_(alpha, p)
        r.addcmul_(alpha, q, value=-1)
        z = precondition(r)
        energy, previous = _dot(r, z), energy
        steps += active
        active = active & (energy > goal)
        p = z.addcmul_(torch.where(active, energy / previous, 0), p)
    return x, steps[..., 0, 0]


def _dot(a, b):
    return torch.linalg.vecdot(a.flatten(2), b.flatten(2))[..., None, None]


class Solve(torch.autograd.Function):
    """x with K x = load; its adjoint: `K lam = grad_x`, then `-(lam_a - lam_b)(x_a - x_b)`."""

    @staticmethod
    def forward(ctx, spoke, arc, diagonal, load, start, size, *stopping):
        ctx.stencil, ctx.stopping = Stencil(spoke, arc, diagonal), stopping
        x, steps = conjugate_gradients(ctx.stencil, load, start, size, *stopping)
        ctx.save_for_backward(x)
        ctx.mark_non_differentiable(steps)
        return x, steps

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_x, _):
        lam, _ = conjugate_gradients(ctx.stencil, grad_x.contiguous(), None, None, *ctx.stopping)
        ends = zip(_differences(lam), _differences(*ctx.saved_tensors))
        return *(-(a * b).sum(1) for a, b in ends), lam, None, None, None, None, None


def _differences(x):
    """Differences of x (B, S, nr, nt), 0 on the circle, along spokes, arcs and diagonals."""
    outer = torch.cat([x[..., 1:, :], torch.zeros_like(x[..., :1, :])], -2)
    return outer - x, x.roll(-1, -1) - x, outer.roll(-1, -1) - x
