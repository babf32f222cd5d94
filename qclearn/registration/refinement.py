"""CoefficientRefinement at the truth: an exact map on the caller's mesh, and one Gauss-Newton step
with its derivative in closed form.

A look at nu solves for its map f, refits the Möbius map M after it, and proposes a step whose
derivative needs no solve (plane.tangent). nu lives on the rings of a polar mesh, in whose
eigenvectors the prior is diagonal.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..plane.mobius import compose_mobius, mobius, mobius_fields, mobius_slope
from ..plane.tangent import Tangent

MOST = 0.6  # of |change of nu| that one step may make: beyond, it is damped
LOWER, LEAST = 0.3, 1e-7  # by how much at once, and how far at most
RISE, BACK = (
    1.02,
    0.4,
)  # a look whose objective is that much higher is taken back to this share of its step
TURNS = 6  # Gauss-Newton steps of the Möbius map at each look
RIDGE = 1e-9  # relative, of the Möbius columns: fewer than two landmarks leave some of them free


@dataclass(frozen=True, eq=False)
class Proposal:
    """A field nu (N,) on the polar mesh that is not looked at yet, and its whitened coefficients x;
    cut: whether it is less than a whole step; left (2 M,): what the step would leave of the
    residual, to first order."""

    nu: np.ndarray
    x: np.ndarray
    cut: bool = False
    left: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Iterate:
    """A `Proposal` with the solver's map f (V,), the Möbius map after it, and the scaled residual r
    (2 M,)."""

    proposal: Proposal
    f: np.ndarray
    mobius: tuple
    r: np.ndarray

    @property
    def objective(self):
        """`|x|^2 + |r|^2`, L_CP / alpha to second order in nu."""
        return self.proposal.x @ self.proposal.x + self.r @ self.r


class CoefficientRefinement:
    """CoefficientRefinement at points (p, q), (M,) each, on a `CoefficientMesh` with the mesh of a
    `Spectrum`; beta, gamma in parts of alpha.

    Whitened coefficients x (2 N - 2,): those of nu times sqrt(1 + beta Laplace), real and imaginary
    parts by turns. Residual r (2 M,): sqrt(gamma / M) times M(f(p)) - q, the real parts before the
    imaginary ones.
    """

    def __init__(self, link, spectrum, points, beta, gamma):
        p, self.target = points
        self.link, self.spectrum, self.scale = link, spectrum, np.sqrt(gamma / len(p))
        self.root = np.sqrt(1 + beta * spectrum.values)
        self.samples, _ = link.carrier.values_at(p)
        self.tangent = Tangent(link, self.samples)

    def run(self, start, count):
        """(proposal, best look so far) before any look and after each of `count`, which cost one
        exact map each; start: nu (N,), or None for one step from nu = 0. After a look that is
        worse, the next lies nearer to the best one."""
        best, share = self.at_zero(), 1.0
        wanted = proposal = self.step(best) if start is None else self.proposal(start)
        yield proposal, best
        for _ in range(count):
            f = self.link.solver.solve(self.link.coefficient(proposal.nu))
            look = self.seen(proposal, f, best.mobius)
            if look.objective < RISE * best.objective:
                best, share = look, 1.0
                wanted = proposal = self.step(look)
            else:
                share *= BACK
                x = best.proposal.x + share * (wanted.x - best.proposal.x)
                proposal = Proposal(self.field(x), x, True)
            yield proposal, best

    def born(self):
        """The step at nu = 0, nu (N,); how far the landmarks should go in the moving disk (M,);
        what it leaves."""
        look = self.at_zero()
        proposal, slope = (
            self.step(look),
            self.scale * (self.samples @ mobius_slope(look.f, *look.mobius)),
        )
        wanted, left = (
            -(r[: len(slope)] + 1j * r[len(slope) :]) / slope for r in (look.r, proposal.left)
        )
        return proposal.nu, wanted, left

    def proposal(self, nu):
        return Proposal(nu, (self.root * self.spectrum.coefficients(nu)).view(float))

    def field(self, x):
        """nu (N,) of whitened coefficients."""
        return self.spectrum.field(x.view(complex) / self.root)

    def at_zero(self):
        """The look at nu = 0, without a solve."""
        nowhere = Proposal(np.zeros(len(self.root) + 1, complex), np.zeros(2 * len(self.root)))
        return self.seen(nowhere, self.link.disk.z, None)

    def seen(self, proposal, f, parameters):
        parameters = refit(self.samples @ f, self.target, parameters)
        return Iterate(
            proposal,
            f,
            parameters,
            self.components(self.samples @ mobius(f, *parameters) - self.target),
        )

    def components(self, change):
        """Changes of the mapped landmarks (M, ...) as those of the residual (2 M, ...)."""
        return self.scale * np.concatenate([change.real, change.imag])

    def step(self, look):
        """The dual Gauss-Newton step, by Levenberg's `d |x - x_0|^2` damped to MOST; share = 1 / (1
        + d)."""
        (rows, off), x, share = self.rows(look), look.proposal.x, 1.0
        gram, moved = off(off(rows @ rows.T).T), off(rows @ x)
        while True:
            y = cho_solve(cho_factor(np.eye(len(gram)) + share * gram), off(look.r) - share * moved)
            change = -share * (off(y) @ rows + x)
            nu = self.field(x + change)
            if abs(nu - look.proposal.nu).max() <= MOST or share < LEAST:
                return Proposal(nu, x + change, share < 1, y)
            share *= LOWER

    def rows(self, look):
        """dr/dx, (2 M, 2 N - 2), up to Möbius maps, and `off(r)`, which takes these out of
        residuals (2 M, ...)."""
        P, Q = (
            part[:-2] for part in self.tangent.variation(look.proposal.nu, look.f, np.complex64)
        )
        slope = (self.scale * (self.samples @ mobius_slope(look.f, *look.mobius))[:, None]).astype(
            P.dtype
        )
        white = (1 / self.root).astype(slope.real.dtype)
        P, Q = (self.spectrum.gradients(part) * white for part in ((slope * P).conj(), slope * Q))
        fields = mobius_fields(self.samples @ mobius(look.f, *look.mobius))
        columns, _ = np.linalg.qr(self.components(fields))
        rows = np.concatenate([P + Q, 1j * (P - Q)]).astype(complex).view(float)
        return rows, lambda r: r - columns @ (columns.T @ r)


def refit(f, q, parameters=None):
    """(a, theta) of the disk Möbius map that brings f (M,) nearest to q, by steps from
    `parameters`."""
    parameters = parameters or (0j, float(np.angle((q * f.conj()).sum())))
    for _ in range(TURNS):
        w = mobius(f, *parameters)
        columns, left = (
            np.concatenate([part.real, part.imag]) for part in (mobius_fields(w), q - w)
        )
        normal = columns.T @ columns
        normal += RIDGE * (np.trace(normal) + RIDGE) * np.eye(3)
        turn, real, imaginary = np.linalg.solve(normal, columns.T @ left)
        a = complex(real, imaginary)
        parameters = compose_mobius(
            parameters, (a / max(1.0, 2 * abs(a)), turn)
        )  # no further than 1/2 at once
    return parameters
