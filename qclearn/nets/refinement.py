"""Refines a predicted coefficient: solve the exact map on the caller's mesh, take one Gauss-Newton
step, repeat.

An iterate solves for the map f of a field nu, refits the Möbius map M after it, and proposes a step
whose derivative needs no solve (tangent.py). nu lies on the rings of a polar mesh, in whose
eigenvectors the prior is diagonal.
"""

from dataclasses import dataclass

import numpy as np

from ..plane.mobius import best_mobius, mobius, mobius_fields, mobius_slope
from .tangent import Tangent

# Largest |change of nu| of a step; a longer one is damped by this factor again and again, down to
# LEAST of itself.
MOST = 0.6
LOWER = 0.3
LEAST = 1e-7
# An iterate whose objective is so many times the best one's is rejected, and the next lies at this
# share of its step.
RISE = 1.02
BACK = 0.4


@dataclass(frozen=True, eq=False)
class Proposal:
    """A field nu (N,) on the polar mesh that is not solved for yet, and its whitened coefficients
    x; cut: whether it is less than a full step; left (2 M,): what the step would leave of the
    residual, to first order."""

    nu: np.ndarray
    x: np.ndarray
    cut: bool = False
    left: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Iterate:
    """A `Proposal` with the solver's map f (V,), the mapped landmarks w (M,) after the best Möbius
    map, its slope dw / df there, and the scaled residual r (2 M,)."""

    proposal: Proposal
    f: np.ndarray
    w: np.ndarray
    slope: np.ndarray
    r: np.ndarray

    @property
    def objective(self):
        """`|x|^2 + |r|^2`, L_CP / alpha to second order in nu."""
        return self.proposal.x @ self.proposal.x + self.r @ self.r


class CoefficientRefinement:
    """Refinement for points (p, q), (M,) each, on a `CoefficientMesh` with the mesh of a
    `Spectrum`; beta, gamma in parts of alpha.

    Whitened coefficients x (2 N - 2,): those of nu times sqrt(1 + beta Laplace), real and imaginary
    parts by turns. Residual r (2 M,): sqrt(gamma / M) times M(f(p)) - q, the real parts before the
    imaginary ones.
    """

    def __init__(self, coefficient_mesh, spectrum, points, beta, gamma):
        p, self.target = points
        self.coefficient_mesh, self.spectrum = coefficient_mesh, spectrum
        self.scale = np.sqrt(gamma / len(p))
        self.root = np.sqrt(1 + beta * spectrum.values)
        self.samples = coefficient_mesh.disk.interpolation(p)
        self.tangent = Tangent(coefficient_mesh, self.samples)

    def run(self, start, count):
        """(proposal, best iterate so far) before the first and after each of `count` iterations,
        one exact map each; start: nu (N,), or None for one step from nu = 0."""
        best, share = self.at_zero(), 1.0
        full = proposal = self.step(best) if start is None else self.proposal(start)
        yield proposal, best
        for _ in range(count):
            mu = self.coefficient_mesh.coefficient(proposal.nu)
            iterate = self.iterate(proposal, self.coefficient_mesh.solver.solve(mu))
            if iterate.objective < RISE * best.objective:
                best, share = iterate, 1.0
                full = proposal = self.step(best)
            else:  # worse: the next lies nearer to the best one
                share *= BACK
                x = best.proposal.x + share * (full.x - best.proposal.x)
                proposal = Proposal(self.field(x), x, True)
            yield proposal, best

    def born(self):
        """The Born step, which is that at nu = 0: nu (N,); how far the landmarks should go in the
        moving disk (M,); what the step leaves of that."""
        iterate = self.at_zero()
        proposal, count = self.step(iterate), len(iterate.w)
        wanted, left = (
            -(r[:count] + 1j * r[count:]) / (self.scale * iterate.slope)
            for r in (iterate.r, proposal.left)
        )
        return proposal.nu, wanted, left

    def proposal(self, nu):
        return Proposal(nu, (self.root * self.spectrum.coefficients(nu)).view(float))

    def field(self, x):
        """nu (N,) of whitened coefficients."""
        return self.spectrum.field(x.view(complex) / self.root)

    def at_zero(self):
        """The iterate at nu = 0, without a solve."""
        nu, x = np.zeros(len(self.root) + 1, complex), np.zeros(2 * len(self.root))
        return self.iterate(Proposal(nu, x), self.coefficient_mesh.disk.z)

    def iterate(self, proposal, f):
        """The `Iterate` of a proposal and the solver's map for it."""
        parameters = best_mobius(self.samples @ f, self.target)
        w = self.samples @ mobius(f, *parameters)
        slope = self.samples @ mobius_slope(f, *parameters)
        return Iterate(proposal, f, w, slope, self.components(w - self.target))

    def components(self, change):
        """Changes of the mapped landmarks (M, ...) as those of the residual (2 M, ...)."""
        return self.scale * np.concatenate([change.real, change.imag])

    def step(self, iterate):
        """The dual Gauss-Newton step, by Levenberg's `d |x - x_0|^2` damped to MOST; share = 1 / (1
        + d)."""
        rows, project = self.rows(iterate)
        x, share = iterate.proposal.x, 1.0
        gram, along = project(project(rows @ rows.T).T), project(rows @ x)
        while True:
            constant = project(iterate.r) - share * along
            y = np.linalg.solve(np.eye(len(gram)) + share * gram, constant)
            after = x - share * (project(y) @ rows + x)
            nu = self.field(after)
            if abs(nu - iterate.proposal.nu).max() <= MOST or share < LEAST:
                return Proposal(nu, after, share < 1, y)
            share *= LOWER

    def rows(self, iterate):
        """dr/dx, (2 M, 2 N - 2), up to Möbius maps, and `project(r)`, which takes these out of
        residuals (2 M, ...)."""
        # Single precision: four digits of the derivative are enough.
        P, Q = self.tangent.variation(iterate.proposal.nu, iterate.f, np.complex64)
        slope = (self.scale * iterate.slope[:, None]).astype(P.dtype)
        white = (1 / self.root).astype(P.real.dtype)
        # dw = P dnu + Q conj(dnu), but for the last two points, 0 and 1.
        P = self.spectrum.gradients((slope * P[:-2]).conj()) * white
        Q = self.spectrum.gradients(slope * Q[:-2]) * white
        rows = np.concatenate([P + Q, 1j * (P - Q)]).astype(complex).view(float)
        columns, _ = np.linalg.qr(self.components(mobius_fields(iterate.w)))
        return rows, lambda r: r - columns @ (columns.T @ r)
