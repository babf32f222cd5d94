"""The exact disk solver without a matrix: batched conjugate gradients on a polar mesh.

The stiffness matrix of mu = 0 on a polar mesh does not change under a turn by one spoke. An FFT in
the angle therefore leaves one tridiagonal system over the rings for each mode, which cyclic
reduction solves with factors computed once. (The quads are isosceles trapezia, hence cyclic: the
weights of their diagonals vanish.) The preconditioned matrix has a condition number of at most `((1
+ k)/(1 - k))^2` for |mu| <= k at any resolution, so that a solve costs O(n log n).

The solver treats the centre as a ring: nt copies of its value, and equal shares of its load. Every
vector is then a grid (nr, nt) of the rings inside the circle.
"""

from itertools import pairwise

import numpy as np
import torch

from ..plane.checks import BeltramiError
from ..plane.disk import Disk
from ..plane.grids import polar_disk
from ..plane.solver import LOST_STEP, SMALLEST_STEP
from .polarcg import Preconditioner, Solve, Stencil

# Corners of a face at the ends of its spoke, its arc and its diagonal edge, see the order of faces
# in `polar_disk`.
POINTING_IN, POINTING_OUT = ((0, 1), (1, 2), (0, 2)), ((1, 2), (2, 0), (0, 1))
IDENTITY = torch.pi**0.5  # energy norm of x and of y on the unit disk


class PolarSolver:
    """Disk self-maps with coefficients mu and a free boundary on `polar_disk(nr, nt, power)`.

    The same map as `BeltramiDiskSolver(z, faces).solve(mu)` up to the tolerance, for a batch at
    once and differentiable, on the device and in the precision of mu. Not certified: ask
    `check_bijective`. After `solve`, `iterations` (B, 3) counts the steps of conjugate gradients
    for U, Re f and Im f, and `floored` (B,) the boundary steps that had to be raised to stay
    positive. Source: paper, theorem 1.
    """

    def __init__(self, nr, nt, power=1.0):
        if nr < 2:
            raise ValueError(f"PolarSolver needs at least 2 rings; got {nr}")
        self.nr, self.nt = nr, nt
        self.mesh = Disk(*polar_disk(nr, nt, power))
        # Coefficients (edge, 3, face, 1) of the edge weights by the terms in mu, for a face a ring:
        # the others are turned.
        gradients, areas, edges = self.mesh.gradients[::nt], self.mesh.areas[::nt], []
        inward = np.arange(len(areas))[:, None] % 2 == 1
        inward[0] = True
        for first, second in zip(POINTING_IN, POINTING_OUT):
            a, b = np.where(inward, gradients[:, first], gradients[:, second]).T
            product = areas * (a * b).conj()
            edges.append([-areas * (a.conj() * b).real, product.real, -product.imag])
        edges = np.array(edges)[..., None]
        turn = np.exp(-4j * np.pi * np.arange(nt) / nt)
        tables = {"edges": edges, "turn": np.stack([turn.real, turn.imag])}
        tables |= _reduction(edges[:, 0, :, 0], nt)
        self._tables = {None: {name: torch.from_numpy(table) for name, table in tables.items()}}

    def tables(self, like):
        """The tables on the device and in the precision of a real tensor."""
        key = (like.dtype, like.device)
        if key not in self._tables:
            self._tables[key] = {name: table.to(like) for name, table in self._tables[None].items()}
        return self._tables[key]

    def solve(self, mu, tolerance=1e-5, limit=100, start=None):
        """The maps f (B, V) with coefficients mu (B, F), f(0) = 0 and f(1) = 1; or (V,) from (F,).
        Differentiable.

        Flux form: `K_ii U = -2 pi e_0`; the boundary fluxes of U give the angles of f_b; `K_ii f_i
        = -K_ib f_b`. Conjugate gradients stop for each sample and system alone, after `limit`
        steps, or where the residual in the norm of the inverse preconditioner is below `tolerance`
        times the energy norm of the identity (backwards: of the gradient). start: maps f to begin
        with, in place of those of mu = 0. BeltramiError unless |mu| < 1.
        """
        if mu.ndim == 1:
            return self.solve(mu[None], tolerance, limit, None if start is None else start[None])[0]
        system, stopping = PolarSystem(self, mu), (tolerance, limit)
        U, f, rest = (None, 0, 0) if start is None else self._begin(start, system.spoke)
        U, steps_U = system.solve(system.pole, U, *stopping)
        boundary = system.boundary(U[:, 0])
        harmonic = system.harmonic(boundary.detach() - rest)
        f = f + Preconditioner(harmonic, system.tables)(harmonic)
        f, steps_f = system.solve(system.pull(boundary), f, *stopping)
        self.floored, self.iterations = system.floored, torch.cat([steps_U, steps_f], 1)
        return self.finish(f, boundary)

    def _begin(self, f, spoke):
        """(U, f, f on the circle) of maps f (B, V): U = log|f|, by its own row at the centre."""
        rings = f.detach()[:, 1:].view(len(f), self.nr, self.nt)
        U = rings[:, :-1].abs().clamp(min=torch.finfo(spoke.dtype).tiny).log()
        fan = spoke.detach()[:, 0]
        pole = ((fan * U[:, 0]).sum(1) - 2 * torch.pi) / fan.sum(1)
        U = torch.cat([pole[:, None, None].expand(-1, 1, self.nt), U], 1)
        centre = f.detach()[:, :1, None].expand(-1, 1, self.nt)
        # (B, 2, nr + 1, nt).
        parts = torch.view_as_real(torch.cat([centre, rings], 1)).movedim(-1, 1)
        return U[:, None], parts[:, :, :-1].contiguous(), parts[:, :, -1:]

    def finish(self, f, boundary):
        """The normalised maps (B, V) from (B, 2, nr, nt) inside and (B, 2, 1, nt) on the circle."""
        inner = torch.cat([f[:, :, 0].mean(-1, keepdim=True), f[:, :, 1:].flatten(2)], 2)
        parts = inner, boundary[:, :, 0]
        inner, boundary = (torch.complex(*part.unbind(1)) for part in parts)
        # The Möbius map that takes f(0) to 0; beyond the disk f is folded, and the circle must not
        # turn over.
        a = inner[:, :1]
        a = torch.where(a.abs() < 1, a, torch.zeros_like(a))
        inner, boundary = ((w - a) / (1 - a.conj() * w) for w in (inner, boundary))
        # The turn that takes f(1) to 1.
        turn = (boundary[:, :1] / boundary[:, :1].abs()).conj()
        boundary = boundary[:, 1:] * turn
        return torch.cat([inner * turn, torch.ones_like(turn), boundary / boundary.abs()], 1)


class PolarSystem:
    """K(mu) and the loads of a batch mu (B, F) on a `PolarSolver`, for fields (B, S, nr, nt).

    spoke, arc, diagonal (B, nr, nt): edge weights -K_ab of the spokes outwards from each ring, the
    arcs on it and the diagonals outwards from it; pole: the load of U; floored (B,): how many steps
    `boundary` had to raise.
    """

    def __init__(self, solver, mu):
        if mu.shape[1:] != (len(solver.mesh.faces),) or not mu.is_complex():
            raise BeltramiError(
                f"mu has shape {tuple(mu.shape)} and type {mu.dtype}: give complex (B, F) or (F,) "
                f"with F = {len(solver.mesh.faces)}, one value a face"
            )
        rows = mu.reshape(len(mu), -1, solver.nt)
        self.nr, self.nt, self.tables = solver.nr, solver.nt, solver.tables(rows.real)
        self.spoke, self.arc, self.diagonal = self.weights = _edge_weights(mu, rows, self.tables)
        pole = self._zeros(1)
        self.pole = torch.cat([torch.full_like(pole[:, :, :1], -2 * torch.pi / self.nt), pole], 2)

    def _zeros(self, copies):
        return self.spoke.new_zeros(len(self.spoke), copies, self.nr - 1, self.nt)

    def solve(self, load, start, tolerance, limit):
        """(x, steps): K x = load from start (None: from 0), 0 on the circle; see
        `PolarSolver.solve`. Differentiable."""
        return Solve.apply(*self.weights, load, start, IDENTITY, self.tables, tolerance, limit)

    def residual(self, load, x):
        """load - K x."""
        return load - Stencil(*self.weights).apply(x)

    def boundary(self, U):
        """cos and sin (B, 2, 1, nt) of the boundary angles from U (B, nr, nt)."""
        spoke, diagonal, U = self.spoke[:, -1], self.diagonal[:, -1], U[:, -1]
        # Over two edges of the one length, which cancels.
        density = -(spoke * U + (diagonal * U).roll(1, -1)) / 2
        steps, mean = density + density.roll(-1, -1), 2 * torch.pi / self.nt
        lost = steps.amin(1, keepdim=True) <= LOST_STEP * mean
        raised = lost & (steps < SMALLEST_STEP * mean)
        self.floored = raised.sum(1)
        steps = torch.where(raised, SMALLEST_STEP * mean, steps)
        before = torch.cat([torch.zeros_like(steps[:, :1]), steps[:, :-1].cumsum(1)], 1)
        angle = 2 * torch.pi * before / steps.sum(1, keepdim=True)
        return torch.stack([angle.cos(), angle.sin()], 1)[:, :, None]

    def pull(self, boundary):
        """The load (B, 2, nr, nt) of values (B, 2, 1, nt) on the circle, `-K_ib f_b`."""
        spoke, diagonal = self.spoke[:, None, -1:], self.diagonal[:, None, -1:]
        pull = spoke * boundary + diagonal * boundary.roll(-1, -1)
        return torch.cat([self._zeros(2), pull], 2)

    def harmonic(self, boundary):
        """The same at mu = 0, whose solution is the harmonic extension."""
        return torch.cat([self._zeros(2), self.tables["rim"] * boundary], 2)


def _edge_weights(mu, rows, tables):
    m = rows.real**2 + rows.imag**2
    if not (m < 1).all():
        bad = ~(m.flatten(1) < 1)
        sample, face = bad.nonzero()[0].tolist()
        raise BeltramiError(
            f"|mu| < 1 fails on {int(bad.sum())} faces (first: sample {sample}, face {face}, mu = "
            f"{mu[sample, face].item():.3g}); no orientation-preserving map has such a "
            "coefficient: truncate or repair mu there"
        )
    cos, sin = tables["turn"]
    # In the frame of the spoke.
    re = rows.real * cos - rows.imag * sin
    im = rows.real * sin + rows.imag * cos
    scale = 1 / (1 - m)
    parts = (1 + m) * scale, 2 * scale * re, 2 * scale * im
    spoke, arc, diagonal = (
        torch.addcmul(torch.addcmul(a * parts[0], b, parts[1]), c, parts[2])
        for a, b, c in tables["edges"]
    )
    fan = spoke[:, :1] + diagonal[:, :1].roll(1, -1)
    none = torch.zeros_like(fan)
    spoke = torch.cat([fan, spoke[:, 1::2] + spoke[:, 2::2].roll(1, -1)], 1)
    arc = torch.cat([none, torch.cat([arc[:, :1], arc[:, 1:-2:2]], 1) + arc[:, 2::2]], 1)
    return spoke, arc, torch.cat([none, diagonal[:, 1::2] + diagonal[:, 2::2]], 1)


def _reduction(plain, nt):
    """Cyclic reduction of the modes at mu = 0, from the edge weights (3, faces) per ring.

    Every second of the remaining rings is eliminated from its neighbours until the centre alone is
    left: `K = L D L^T`, `lower` holds the entries of -L level by level, `pivots` 1 / D; all twice,
    for real and imaginary parts.
    """
    spoke, arc, diagonal = plain
    spoke = np.concatenate([spoke[:1] + diagonal[:1], spoke[1::2] + spoke[2::2]])
    arc = np.concatenate([[0.0], np.concatenate([arc[:1], arc[1:-2:2]]) + arc[2::2]])
    modes = 2 - 2 * np.cos(2 * np.pi * np.arange(nt // 2 + 1) / nt)
    pivots = (spoke + np.append(0, spoke[:-1]))[:, None] + arc[:, None] * modes
    coupling = np.repeat(-spoke[:-1, None], len(modes), axis=1)
    lower, stride = [], 1
    while stride < len(spoke):
        rest, gone = pivots[:: 2 * stride], pivots[stride :: 2 * stride]
        left, right = -coupling[::2] / gone, -coupling[1::2] / gone[: len(rest) - 1]
        rest[: len(gone)] += left * coupling[::2]
        rest[1:] += right * coupling[1::2]
        coupling = left[: len(right)] * coupling[1::2]
        coupling = coupling[: len(rest) - 1]
        lower += [left, right]
        stride *= 2
    inverse = 1 / pivots
    inverse[0, 1:] = 0  # the centre has mode 0 only
    pivots, lower = (np.repeat(x, 2, axis=1) for x in (inverse, np.concatenate(lower)))
    return {"pivots": pivots, "lower": lower, "rim": spoke[-1:]}


def two_steps(solver, mu):
    """Maps (f1, f2, f3), potentials (U1, U2) of log|f|, and boundary angles (d1, d2), (B, nt).

    1 and 2 are of first and second order in mu: two preconditioned steps from mu = 0 for U (the
    very first step of conjugate gradients only scales its potential), and from the harmonic map
    with the boundary of U2 for f. f3 - f2 and d2 are the preconditioned residuals of f2 and U2; d1
    is the change of the boundary from U1 to U2.
    """
    system = PolarSystem(solver, mu)
    potentials = [system.solve(system.pole, None, 0.0, 2)[0]]
    potentials.append(system.solve(system.pole, potentials[0], 0.0, 1)[0])
    residual = system.residual(system.pole, potentials[1])
    beyond = potentials[1] + Preconditioner(system.pole, system.tables)(residual)
    circle = [system.boundary(U[:, 0]) for U in (*potentials, beyond)]
    angles = [
        torch.atan2(a[:, 0, 0] * b[:, 1, 0] - a[:, 1, 0] * b[:, 0, 0], (a * b).sum(1)[:, 0])
        for a, b in pairwise(circle)
    ]
    boundary = circle[1]
    pull, harmonic = system.pull(boundary), system.harmonic(boundary)
    precondition = Preconditioner(harmonic, system.tables)
    f, maps = precondition(harmonic), []
    for _ in range(2):
        f, _ = system.solve(pull, f, 0.0, 1)
        maps.append(solver.finish(f, boundary))
    maps.append(solver.finish(f + precondition(system.residual(pull, f)), boundary))
    return maps, [U[:, 0, 1:] for U in potentials], angles


def harmonic_extension(solver, values):
    """Harmonic functions (B, C, nr, nt) off the centre with values (B, C, nt) on the circle."""
    tables, values = solver.tables(values), values[:, :, None]
    inside = values.new_zeros(*values.shape[:2], solver.nr - 1, solver.nt)
    load = torch.cat([inside, tables["rim"] * values], 2)
    return torch.cat([Preconditioner(load, tables)(load)[:, :, 1:], values], 2)
