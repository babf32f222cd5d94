"""The exact disk solver without a matrix: batched conjugate gradients on a polar mesh, preconditioned at mu = 0.

On a polar mesh the stiffness matrix of mu = 0 does not change under a turn by one spoke. Its quads are isosceles
trapezia, hence cyclic, and the weights of their diagonals vanish: over the angle's Fourier modes m it becomes
`T + lambda_m D` with one tridiagonal T and one diagonal D over the rings and `lambda_m = 2 - 2 cos(2 pi m / nt)`. Both
are diagonal in one basis, so that its inverse is two small matrix products and two FFTs. The condition number that is
left is at most `((1 + k)/(1 - k))^2` for |mu| <= k, whatever the resolution.
"""

import numpy as np
import torch

from .beltrami import BeltramiError, hat_gradients, signed_areas
from .disk import LOST_STEP, SMALLEST_STEP
from .diskmesh import polar_disk

# Corners of a face that span its spoke, its arc and its diagonal edge, see the order of faces in `polar_disk`.
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
        self._tables = {None: {name: torch.from_numpy(table) for name, table in self._geometry().items()}}

    def _geometry(self):
        rows = self.faces[::self.nt]  # one face of each ring of faces: the others are turned copies
        gradients, areas = hat_gradients(self.z, rows), signed_areas(self.z, rows)
        inward = np.arange(len(rows)) % 2 == 1
        inward[0] = True
        tables = {}
        for edge, first, second in zip(("spoke", "arc", "diagonal"), POINTING_IN, POINTING_OUT):
            a, b = np.where(inward[:, None], gradients[:, first], gradients[:, second]).T
            product = areas * (a * b).conj()
            tables[edge] = np.stack([-areas * (a.conj() * b).real, product.real, -product.imag])[..., None]
        turn = np.exp(-4j * np.pi * np.arange(self.nt) / self.nt)
        plain = {edge: table[0, :, 0] for edge, table in tables.items()}
        return tables | _inverse_at_zero(plain, self.nt) | {"turn": np.stack([turn.real, turn.imag])}

    def tables(self, like):
        """The tables on the device and in the precision of a real tensor."""
        key = (like.dtype, like.device)
        if key not in self._tables:
            self._tables[key] = {name: table.to(like) for name, table in self._tables[None].items()}
        return self._tables[key]

    def solve(self, mu, tolerance=1e-5, limit=100):
        """The maps f (B, V) with coefficients mu (B, F), f(0) = 0 and f(1) = 1; or (V,) from (F,). Differentiable.

        Flux form: `K_ii U = -2 pi e_0`; the boundary fluxes of U give the angles of f_b; `K_ii f_i = -K_ib f_b`.
        Conjugate gradients stop for each sample and system alone: where the residual, in the norm of the inverse of
        the preconditioner, is below `tolerance` times the energy norm of the identity (in the backward pass: times
        that norm of the gradient), or after `limit` steps. BeltramiError where |mu| < 1 fails.
        """
        single = mu.ndim == 1
        mu = self._check(mu[None] if single else mu)
        spoke, arc, diagonal = weights = self._weights(mu)
        tables, load = self.tables(spoke), spoke.new_zeros(len(mu), 1, self._size)
        load[..., 0] = -2 * torch.pi
        U, steps_U = Solve.apply(*weights, load, None, IDENTITY, tables, tolerance, limit)
        boundary = self._boundary(U[:, 0, -self.nt:], spoke[:, -1], diagonal[:, -1])
        last = spoke[:, None, -1] * boundary + diagonal[:, None, -1] * boundary.roll(-1, -1)
        load = torch.cat([load.new_zeros(len(mu), 2, self._size - self.nt), last], -1)
        with torch.no_grad():
            start = torch.zeros_like(load)
            start[..., -self.nt:] = boundary * tables["rim"]
            start = precondition(start, tables)
        f, steps_f = Solve.apply(*weights, load, start, IDENTITY, tables, tolerance, limit)
        self.iterations = torch.cat([steps_U, steps_f], 1)
        f = self._normalise(torch.complex(*f.unbind(1)), torch.complex(*boundary.unbind(1)))
        return f[0] if single else f

    @property
    def _size(self):
        return 1 + (self.nr - 1) * self.nt

    def _check(self, mu):
        if mu.shape[1:] != (len(self.faces),) or not mu.is_complex():
            raise BeltramiError(f"mu has shape {tuple(mu.shape)} and type {mu.dtype}: give complex (B, F) or (F,) with "
                                f"F = {len(self.faces)}, one value a face")
        bad = ~(mu.detach().abs() < 1)
        if bad.any():
            sample, face = bad.nonzero()[0].tolist()
            raise BeltramiError(f"|mu| < 1 fails on {int(bad.sum())} faces (first: sample {sample}, face {face}, mu = "
                                f"{mu[sample, face].item():.3g}); no orientation-preserving map has such a "
                                "coefficient: truncate or mend mu there")
        return mu

    def _weights(self, mu):
        """Edge weights -K_ab: spokes (B, nr, nt), arcs (B, nr - 1, nt) of inner rings, diagonals (B, nr - 1, nt)."""
        mu = mu.reshape(len(mu), -1, self.nt)
        re, im = mu.real, mu.imag
        tables = self.tables(re)
        cos, sin = tables["turn"]
        re, im = re * cos - im * sin, re * sin + im * cos  # in the frame of the spoke
        m = re ** 2 + im ** 2
        scale = 1 / (1 - m)
        parts = (1 + m) * scale, 2 * scale * re, 2 * scale * im
        spoke, arc, diagonal = (sum(table * part for table, part in zip(tables[edge], parts))
                                for edge in ("spoke", "arc", "diagonal"))
        fan = spoke[:, :1] + diagonal[:, :1].roll(1, -1)
        spoke = torch.cat([fan, spoke[:, 1::2] + spoke[:, 2::2].roll(1, -1)], 1)
        arc = torch.cat([arc[:, :1], arc[:, 1:-2:2]], 1) + arc[:, 2::2]
        return spoke, arc, diagonal[:, 1::2] + diagonal[:, 2::2]

    def _boundary(self, U, spoke, diagonal):
        """cos and sin (B, 2, nt) of the boundary angles from U on the last inner ring (B, nt)."""
        density = -(spoke * U + (diagonal * U).roll(1, -1)) / 2  # of all edges' one length, which cancels
        steps = density + density.roll(-1, -1)
        mean = 2 * torch.pi / self.nt
        lost = steps.amin(1, keepdim=True) <= LOST_STEP * mean
        raised = lost & (steps < SMALLEST_STEP * mean)
        self.floored = raised.sum(1)
        steps = torch.where(raised, SMALLEST_STEP * mean, steps)
        angle = 2 * torch.pi * (steps.cumsum(1) - steps) / steps.sum(1, keepdim=True)
        angle = torch.cat([torch.zeros_like(steps[:, :1]), angle[:, 1:]], 1)
        return torch.stack([angle.cos(), angle.sin()], 1)

    def _normalise(self, inner, boundary):
        a = inner[:, :1]
        a = torch.where(a.abs() < 1, a, torch.zeros_like(a))  # beyond, f is folded and the circle must not turn over
        inner, boundary = ((w - a) / (1 - a.conj() * w) for w in (inner, boundary))
        turn = boundary[:, :1].conj()
        turn, boundary = turn / turn.abs(), boundary[:, 1:] * turn
        return torch.cat([inner * turn, torch.ones_like(turn), boundary / boundary.abs()], 1)


def _inverse_at_zero(plain, nt):
    """Tables of the preconditioner from the edge weights (2 nr - 1,) of each ring of faces at mu = 0.

    `(T + lambda D)^-1 = S (1 + lambda M)^-1 S^T` with T = L L^T, L^-1 D L^-T = Q M Q^T and S = L^-T Q. Mode 0 is the
    chain of rings with the centre at its end; its Green's function is the resistance to the circle.
    """
    spoke = np.concatenate([plain["spoke"][:1] + plain["diagonal"][:1], plain["spoke"][1::2] + plain["spoke"][2::2]])
    arc = np.concatenate([plain["arc"][:1], plain["arc"][1:-2:2]]) + plain["arc"][2::2]
    tridiagonal = np.diag(spoke[:-1] + spoke[1:]) - np.diag(spoke[1:-1], 1) - np.diag(spoke[1:-1], -1)
    inverse_factor = np.linalg.inv(np.linalg.cholesky(tridiagonal))
    values, basis = np.linalg.eigh(inverse_factor * arc @ inverse_factor.T)
    modes = 2 - 2 * np.cos(2 * np.pi * np.arange(nt // 2 + 1) / nt)
    spectrum = 1 / (1 + values[:, None] * modes)
    spectrum[:, 0] = 0
    resistance = np.cumsum(1 / spoke[::-1])[::-1]
    rings = np.arange(len(spoke))
    return {"basis": inverse_factor.T @ basis, "spectrum": np.repeat(spectrum, 2, axis=1), "rim": spoke[-1:],
            "mean": resistance[np.maximum(rings[:, None], rings)] / nt}


def precondition(r, tables):
    """The inverse of the matrix of mu = 0 with values 0 on the circle, applied to r (B, S, 1 + (nr - 1) nt)."""
    basis, spectrum = tables["basis"], tables["spectrum"]
    rings = r[..., 1:].unflatten(-1, (len(basis), -1))
    mean = torch.cat([r[..., :1], rings.sum(-1)], -1) @ tables["mean"]
    modes = torch.view_as_real(torch.fft.rfft(basis.T @ rings)).flatten(-2)
    modes = torch.view_as_complex((modes * spectrum).unflatten(-1, (-1, 2)))
    rings = basis @ torch.fft.irfft(modes, rings.shape[-1]) + mean[..., 1:, None]
    return torch.cat([mean[..., :1], rings.flatten(-2)], -1)


class Stencil:
    """K(mu) on the inner vertices, those of the circle held at 0, from edge weights as in `PolarSolver._weights`.

    Vertices are numbered ring by ring, so that neighbours lie 1, nt and nt + 1 places apart. The diagonal that closes
    a ring, from its last vertex to the first of the next ring, spans one place; the arc that closes it spans nt - 1.
    """

    def __init__(self, spoke, arc, diagonal):
        spoke, arc, diagonal = spoke[:, None], arc[:, None], diagonal[:, None]
        self.nt, self.hub = spoke.shape[-1], -spoke[..., 0, :]
        centre = spoke[..., :-1, :] + spoke[..., 1:, :] + arc + arc.roll(1, -1) + diagonal
        centre[..., 1:, :] += diagonal[..., :-1, :].roll(1, -1)
        self.centre, self.closing = centre.flatten(-2), -arc[..., -1]
        self.outward = -spoke[..., 1:-1, :].flatten(-2)
        along, slanted = -arc, -diagonal[..., :-1, :]
        along[..., :-1, -1] = slanted[..., -1]
        slanted[..., -1] = 0
        self.along, self.slanted = along.flatten(-2)[..., :-1], slanted.flatten(-2)[..., :-1]

    def apply(self, x):
        """K x for x (B, S, 1 + (nr - 1) nt)."""
        nt, u = self.nt, x[..., 1:]
        y = torch.empty_like(x)
        v = y[..., 1:]
        torch.mul(self.centre, u, out=v)
        for weight, shift in ((self.along, 1), (self.outward, nt), (self.slanted, nt + 1)):
            v[..., shift:].addcmul_(weight, u[..., :-shift])
            v[..., :-shift].addcmul_(weight, u[..., shift:])
        v[..., ::nt].addcmul_(self.closing, u[..., nt - 1::nt])
        v[..., nt - 1::nt].addcmul_(self.closing, u[..., ::nt])
        v[..., :nt].addcmul_(self.hub, x[..., :1])
        y[..., 0] = (self.hub * (u[..., :nt] - x[..., :1])).sum(-1)
        return y


def conjugate_gradients(stencil, load, start, size, tables, tolerance, limit):
    """Solutions of K x = load (B, S, N) and the number of steps (B, S); `size` None measures against the load."""
    x = torch.zeros_like(load) if start is None else start
    r = load.clone() if start is None else load - stencil.apply(start)
    p = precondition(r, tables)
    energy = torch.linalg.vecdot(r, p)
    goal = tolerance ** 2 * (energy if size is None else torch.full_like(energy, size ** 2))
    active, steps = energy > goal, torch.zeros_like(energy, dtype=int)
    while active.any() and limit > int(steps.max()):
        q = stencil.apply(p)
        # A system that has converged stands still: its step is 0.
        alpha = torch.where(active, energy / torch.linalg.vecdot(p, q), 0)[..., None]
        x, r = x.addcmul_(alpha, p), r.addcmul_(alpha, q, value=-1)
        z = precondition(r, tables)
        energy, previous = torch.linalg.vecdot(r, z), energy
        p = z.addcmul_((energy / previous)[..., None], p)
        steps += active
        active = active & (energy > goal)
    return x, steps


class Solve(torch.autograd.Function):
    """x with K x = load by conjugate gradients; backward by the adjoint: `K lam = grad_x`, `-(lam_a - lam_b)(x_a - x_b)`."""

    @staticmethod
    def forward(ctx, spoke, arc, diagonal, load, start, size, tables, tolerance, limit):
        ctx.stencil = Stencil(spoke, arc, diagonal)
        ctx.tables, ctx.stopping = tables, (tolerance, limit)
        x, steps = conjugate_gradients(ctx.stencil, load, start, size, tables, tolerance, limit)
        ctx.save_for_backward(x)
        ctx.mark_non_differentiable(steps)
        return x, steps

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_x, _):
        x, = ctx.saved_tensors
        lam, _ = conjugate_gradients(ctx.stencil, grad_x, None, None, ctx.tables, *ctx.stopping)
        grads = (-(a * b).sum(1) for a, b in zip(_differences(lam, ctx.stencil.nt), _differences(x, ctx.stencil.nt)))
        return *grads, lam, None, None, None, None, None


def _differences(x, nt):
    """Differences of x (B, S, N), 0 on the circle, along spokes, arcs and diagonals, each (B, S, ., nt)."""
    rings = torch.nn.functional.pad(x[..., 1:].unflatten(-1, (-1, nt)), (0, 0, 0, 1))
    inner, outer = rings[..., :-1, :], rings[..., 1:, :]
    spoke = torch.cat([rings[..., :1, :] - x[..., :1, None], outer - inner], -2)
    return spoke, inner.roll(-1, -1) - inner, outer.roll(-1, -1) - inner
