"""The exact disk solver without a matrix: batched conjugate gradients on a polar mesh, preconditioned at mu = 0.

On a polar mesh the stiffness matrix of mu = 0 does not change under a turn by one spoke: an FFT in the angle leaves
one tridiagonal system over the rings a mode (its quads are isosceles trapezia, hence cyclic, and the weights of their
diagonals vanish), solved by cyclic reduction with factors computed once. The condition number that is left is at most
`((1 + k)/(1 - k))^2` for |mu| <= k, whatever the resolution, so that a solve costs O(n log n).

Inside, the centre is a ring like the others: nt copies of its value, and equal shares of its load. Then every vector is
a grid (nr, nt) of the rings inside the circle.
"""

import numpy as np
import torch

from .beltrami import BeltramiError, hat_gradients, signed_areas
from .disk import LOST_STEP, SMALLEST_STEP
from .diskmesh import polar_disk

# Corners of a face at the ends of its spoke, its arc and its diagonal edge, see the order of faces in `polar_disk`.
POINTING_IN, POINTING_OUT = ((0, 1), (1, 2), (0, 2)), ((1, 2), (2, 0), (0, 1))
IDENTITY = torch.pi ** 0.5  # energy norm of x and of y on the unit disk


class PolarSolver:
    """Disk self-maps with Beltrami coefficients mu and a free boundary on the mesh `polar_disk(nr, nt, power)`.

    The same map as `BeltramiDiskSolver(z, faces).solve(mu)` up to the tolerance, for a batch at once and
    differentiable, on the device and in the precision of mu. Not certified: ask `check_bijective`.
    After `solve`, `iterations` (B, 3) counts the steps of conjugate gradients for U, Re f and Im f, and `floored` (B,)
    the boundary steps that had to be raised to stay positive. Source: paper, theorem 1.
    """

    def __init__(self, nr, nt, power=1.0):
        if nr < 2:
            raise ValueError(f"PolarSolver needs at least 2 rings; got {nr}")
        self.nr, self.nt = nr, nt
        self.z, self.faces = polar_disk(nr, nt, power)
        edges = _edge_tables(self.z, self.faces[::nt])  # one face of each ring of faces: the others are turned copies
        turn = np.exp(-4j * np.pi * np.arange(nt) / nt)
        tables = {"edges": edges, "turn": np.stack([turn.real, turn.imag]), **_reduction(edges[:, 0, :, 0], nt)}
        self._tables = {None: {name: torch.from_numpy(table) for name, table in tables.items()}}

    def tables(self, like):
        """The tables on the device and in the precision of a real tensor."""
        key = (like.dtype, like.device)
        if key not in self._tables:
            self._tables[key] = {name: table.to(like) for name, table in self._tables[None].items()}
        return self._tables[key]

    def solve(self, mu, tolerance=1e-5, limit=100, start=None):
        """The maps f (B, V) with coefficients mu (B, F), f(0) = 0 and f(1) = 1; or (V,) from (F,). Differentiable.

        Flux form: `K_ii U = -2 pi e_0`; the boundary fluxes of U give the angles of f_b; `K_ii f_i = -K_ib f_b`.
        Conjugate gradients stop for each sample and system alone: where the residual, in the norm of the inverse of
        the preconditioner, is below `tolerance` times the energy norm of the identity (in the backward pass: times
        that norm of the gradient), or after `limit` steps. start: maps f like the result, to begin with in place of
        those of mu = 0. BeltramiError where |mu| < 1 fails.
        """
        if mu.ndim == 1:
            return self.solve(mu[None], tolerance, limit, None if start is None else start[None])[0]
        spoke, _, diagonal = weights = self._weights(mu)
        tables = self.tables(spoke)
        stopping = tables, tolerance, limit
        pole, rim = (spoke.new_zeros(len(mu), copies, self.nr - 1, self.nt) for copies in (1, 2))
        pole = torch.cat([torch.full_like(pole[:, :, :1], -2 * torch.pi / self.nt), pole], 2)
        U, f, rest = (None, 0, 0) if start is None else self._begin(start, spoke)
        U, steps_U = Solve.apply(*weights, pole, U, IDENTITY, *stopping)
        boundary = self._boundary(U[:, 0, -1], spoke[:, -1], diagonal[:, -1])
        pull = spoke[:, None, -1:] * boundary + diagonal[:, None, -1:] * boundary.roll(-1, -1)
        harmonic = torch.cat([rim, tables["rim"] * (boundary.detach() - rest)], 2)
        f = f + Preconditioner(harmonic, tables)(harmonic)
        f, steps_f = Solve.apply(*weights, torch.cat([rim, pull], 2), f, IDENTITY, *stopping)
        self.iterations = torch.cat([steps_U, steps_f], 1)
        return self.finish(f, boundary)

    def _begin(self, f, spoke):
        """(U, f, f on the circle) to begin with from maps f (B, V): U = log|f|, at the centre what its row asks for."""
        rings = f.detach()[:, 1:].view(len(f), self.nr, self.nt)
        U = rings[:, :-1].abs().clamp(min=torch.finfo(spoke.dtype).tiny).log()
        fan = spoke.detach()[:, 0]
        pole = ((fan * U[:, 0]).sum(1) - 2 * torch.pi) / fan.sum(1)
        U = torch.cat([pole[:, None, None].expand(-1, 1, self.nt), U], 1)
        centre = f.detach()[:, :1, None].expand(-1, 1, self.nt)
        parts = torch.view_as_real(torch.cat([centre, rings], 1)).movedim(-1, 1)  # (B, 2, nr + 1, nt)
        return U[:, None], parts[:, :, :-1].contiguous(), parts[:, :, -1:]

    def finish(self, f, boundary):
        """The normalised maps (B, V) from Re f and Im f (B, 2, nr, nt) inside and (B, 2, 1, nt) on the circle."""
        inner = torch.cat([f[:, :, 0].mean(-1, keepdim=True), f[:, :, 1:].flatten(2)], 2)
        return _normalise(torch.complex(*inner.unbind(1)), torch.complex(*boundary[:, :, 0].unbind(1)))

    def _weights(self, mu):
        """Edge weights -K_ab (B, nr, nt): spokes outwards from each ring, arcs on it, diagonals outwards from it."""
        if mu.shape[1:] != (len(self.faces),) or not mu.is_complex():
            raise BeltramiError(f"mu has shape {tuple(mu.shape)} and type {mu.dtype}: give complex (B, F) or (F,) with "
                                f"F = {len(self.faces)}, one value a face")
        rows = mu.reshape(len(mu), -1, self.nt)
        tables = self.tables(rows.real)
        m = rows.real ** 2 + rows.imag ** 2
        if not (m < 1).all():
            _refuse(mu, ~(m.flatten(1) < 1))
        cos, sin = tables["turn"]
        re, im = rows.real * cos - rows.imag * sin, rows.real * sin + rows.imag * cos  # in the frame of the spoke
        scale = 1 / (1 - m)
        parts = (1 + m) * scale, 2 * scale * re, 2 * scale * im
        spoke, arc, diagonal = (torch.addcmul(torch.addcmul(a * parts[0], b, parts[1]), c, parts[2])
                                for a, b, c in tables["edges"])
        fan = spoke[:, :1] + diagonal[:, :1].roll(1, -1)
        none = torch.zeros_like(fan)
        spoke = torch.cat([fan, spoke[:, 1::2] + spoke[:, 2::2].roll(1, -1)], 1)
        arc = torch.cat([none, torch.cat([arc[:, :1], arc[:, 1:-2:2]], 1) + arc[:, 2::2]], 1)
        return spoke, arc, torch.cat([none, diagonal[:, 1::2] + diagonal[:, 2::2]], 1)

    def _boundary(self, U, spoke, diagonal):
        """cos and sin (B, 2, 1, nt) of the boundary angles from U on the last inner ring (B, nt)."""
        density = -(spoke * U + (diagonal * U).roll(1, -1)) / 2  # over two edges of the one length, which cancels
        steps, mean = density + density.roll(-1, -1), 2 * torch.pi / self.nt
        lost = steps.amin(1, keepdim=True) <= LOST_STEP * mean
        raised = lost & (steps < SMALLEST_STEP * mean)
        self.floored = raised.sum(1)
        steps = torch.where(raised, SMALLEST_STEP * mean, steps)
        before = torch.cat([torch.zeros_like(steps[:, :1]), steps[:, :-1].cumsum(1)], 1)
        angle = 2 * torch.pi * before / steps.sum(1, keepdim=True)
        return torch.stack([angle.cos(), angle.sin()], 1)[:, :, None]


def _refuse(mu, bad):
    sample, face = bad.nonzero()[0].tolist()
    raise BeltramiError(f"|mu| < 1 fails on {int(bad.sum())} faces (first: sample {sample}, face {face}, mu = "
                        f"{mu[sample, face].item():.3g}); no orientation-preserving map has such a coefficient: "
                        "truncate or mend mu there")


def _normalise(inner, boundary):
    """The Möbius map after f to f(0) = 0 and f(1) = 1."""
    a = inner[:, :1]
    a = torch.where(a.abs() < 1, a, torch.zeros_like(a))  # beyond, f is folded and the circle must not turn over
    inner, boundary = ((w - a) / (1 - a.conj() * w) for w in (inner, boundary))
    turn = (boundary[:, :1] / boundary[:, :1].abs()).conj()
    boundary = boundary[:, 1:] * turn
    return torch.cat([inner * turn, torch.ones_like(turn), boundary / boundary.abs()], 1)


def _edge_tables(z, faces):
    """Coefficients (edge, 3, face, 1) of (1 + |mu|^2, 2 Re mu, 2 Im mu)/(1 - |mu|^2) in each face's edge weights."""
    gradients, areas = hat_gradients(z, faces), signed_areas(z, faces)
    inward = np.arange(len(faces)) % 2 == 1
    inward[0] = True
    tables = []
    for first, second in zip(POINTING_IN, POINTING_OUT):
        a, b = np.where(inward[:, None], gradients[:, first], gradients[:, second]).T
        product = areas * (a * b).conj()
        tables.append([-areas * (a.conj() * b).real, product.real, -product.imag])
    return np.array(tables)[..., None]


def _reduction(plain, nt):
    """Cyclic reduction of the modes at mu = 0, from the edge weights (3, faces) of each ring of faces.

    Every second of the remaining rings is eliminated from its neighbours until the centre alone is left: `K = L D L^T`,
    `lower` holds the entries of -L level by level, `pivots` 1 / D; all twice, for real and imaginary parts.
    """
    spoke, arc, diagonal = plain
    spoke = np.concatenate([spoke[:1] + diagonal[:1], spoke[1::2] + spoke[2::2]])
    arc = np.concatenate([[0.0], np.concatenate([arc[:1], arc[1:-2:2]]) + arc[2::2]])
    modes = 2 - 2 * np.cos(2 * np.pi * np.arange(nt // 2 + 1) / nt)
    pivots = (spoke + np.append(0, spoke[:-1]))[:, None] + arc[:, None] * modes
    coupling = np.repeat(-spoke[:-1, None], len(modes), axis=1)
    lower, stride = [], 1
    while stride < len(spoke):
        kept, gone = pivots[::2 * stride], pivots[stride::2 * stride]
        left, right = -coupling[::2] / gone, -coupling[1::2] / gone[:len(kept) - 1]
        kept[:len(gone)] += left * coupling[::2]
        kept[1:] += right * coupling[1::2]
        coupling = left[:len(right)] * coupling[1::2]
        coupling = coupling[:len(kept) - 1]
        lower += [left, right]
        stride *= 2
    inverse = 1 / pivots
    inverse[0, 1:] = 0  # the centre has mode 0 only
    return {"pivots": np.repeat(inverse, 2, axis=1), "lower": np.repeat(np.concatenate(lower), 2, axis=1),
            "rim": spoke[-1:]}


class Preconditioner:
    """The inverse of the matrix of mu = 0, values 0 on the circle, for loads of one shape (B, S, nr, nt).

    It keeps the array of modes and all views of it: on small meshes to make them would cost more than to use them.
    """

    def __init__(self, load, tables):
        self.modes, self.pivots, self.nt = torch.fft.rfft(load), tables["pivots"], load.shape[-1]
        self.x = torch.view_as_real(self.modes).flatten(-2)  # a view
        self.steps, lower, stride = [], tables["lower"], 1
        while stride < load.shape[-2]:
            kept, gone = self.x[..., ::2 * stride, :], self.x[..., stride::2 * stride, :]
            n_left, n_right = gone.shape[-2], kept.shape[-2] - 1
            left, right, lower = lower.split([n_left, n_right, len(lower) - n_left - n_right])
            self.steps += [(kept[..., :n_left, :], gone, left), (kept[..., 1:, :], gone[..., :n_right, :], right)]
            stride *= 2

    def __call__(self, r):
        torch.fft.rfft(r, out=self.modes)
        for kept, gone, factor in self.steps:
            kept.addcmul_(factor, gone)
        self.x.mul_(self.pivots)
        for kept, gone, factor in reversed(self.steps):
            gone.addcmul_(factor, kept)
        return torch.fft.irfft(self.modes, self.nt)


class Stencil:
    """K(mu) inside the circle, values on it held at 0, from the edge weights of `PolarSolver._weights`.

    Vertices are numbered ring by ring, so that neighbours lie 1, nt and nt + 1 places apart. The diagonal that closes
    a ring, from its last vertex to the first of the next ring, spans one place; the arc that closes it spans nt - 1.
    """

    def __init__(self, spoke, arc, diagonal):
        spoke, arc, diagonal = spoke[:, None], arc[:, None], diagonal[:, None]
        centre = spoke + arc + arc.roll(1, -1) + diagonal
        centre[..., 1:, :] += spoke[..., :-1, :] + diagonal[..., :-1, :].roll(1, -1)
        along, slanted = -arc, -diagonal[..., :-1, :]
        along[..., :-1, -1] = slanted[..., -1]
        slanted[..., -1] = 0
        self.centre, self.closing = centre.flatten(2), -arc[..., -1]
        self.places = [(1, along.flatten(2)[..., :-1]), (spoke.shape[-1], -spoke[..., :-1, :].flatten(2)),
                       (spoke.shape[-1] + 1, slanted.flatten(2)[..., :-1])]

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
        # Unequal shares would never decay in the residual, and their rounding would outgrow what does.
        v[..., 0, :] = v[..., 0, :].mean(-1, keepdim=True)
        return v


def conjugate_gradients(stencil, load, start, size, tables, tolerance, limit):
    """Solutions of K x = load (B, S, nr, nt) and the number of steps (B, S); `size` None measures against the load."""
    precondition = Preconditioner(load, tables)
    x = torch.zeros_like(load) if start is None else start.clone()
    r = load.clone() if start is None else load - stencil.apply(start)
    p = precondition(r)
    energy = _dot(r, p)
    goal = tolerance ** 2 * (energy if size is None else torch.full_like(energy, size ** 2))
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
    """x with K x = load by conjugate gradients; its adjoint: `K lam = grad_x`, then `-(lam_a - lam_b)(x_a - x_b)`."""

    @staticmethod
    def forward(ctx, spoke, arc, diagonal, load, start, size, *stopping):
        ctx.stencil, ctx.stopping = Stencil(spoke, arc, diagonal), stopping
        x, steps = conjugate_gradients(ctx.stencil, load, start, size, *stopping)
        ctx.save_for_backward(x)
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
