"""Gauss-Newton steps: linearisations of a fit, each made at a state of an `Engine`; `propose(damping)` gives a change.

Landmarks and features are one residual r of the mapped mesh, `dr = Re(conj(R) dw)`. A `DirectStep` holds its whole
derivative J by nu. The others multiply by J through `pushforward` and by its transpose through `pullback`, two rounds
of solves a product, in conjugate gradients that the landmarks' rows in closed form precondition; what a step learns of
its exact products, `learnt`, helps the next.
"""

from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..plane.coefficients import bounded_pullback
from ..plane.mobius import mobius_fields, mobius_slope

MOBIUS_PRIOR = 1e-6  # weak, keeps the step of the three Möbius parameters bounded
RELIEF = 1e-3  # share of the landmarks' part on the Möbius parameters that P counts twice
STEPS, DUAL_STEPS = 80, 200  # of conjugate gradients, at most; the dual's are few, unless gamma is extreme
WORTH = 1e-3  # the share of the objective that a step has to promise
FORCING = 0.1  # share of its gain by which a step of landmarks alone may miss the model's least objective
ACCURACY = 0.1  # the residual that they leave, in the preconditioner's norm, up to gamma = 1e3; beyond, less by decades
WITH_AREAS = 0.01  # the same with areas: steps that are less exact promise too little, and the fit ends early
PRODUCT = 0.35  # work of a product, in parts of one exact map
INDEPENDENT = 1e-6  # singular values of the directions learnt from, in parts of the largest


class Change(NamedTuple):
    """What `propose(d)` says: changes of nu (N,) and of the Möbius parameters, and the model's objective there; d adds
    `d (change^* W change)` to what is minimised, and its like for the Möbius part."""

    nu: np.ndarray
    da: complex
    dtheta: float
    promised: float


class DirectStep:
    """Landmarks alone with their Jacobian, by the dual equations `S y = r - J nu`, `S = 1 + J W^-1 J^T`."""

    learnt = None

    def __init__(self, engine, state, gamma):
        self.nu, landmarks, solve = state.nu, engine.landmarks, engine.factors.solve
        self.residual, self.J = engine.residual(state, gamma), engine.jacobian(state, gamma)
        self.Jm = landmarks.components(engine.samples @ mobius_fields(state.f), gamma)
        real, imaginary = (solve(np.ascontiguousarray(part.T)) for part in (self.J.real, self.J.imag))
        self.lifted = real + 1j * imaginary
        self.gram = (self.J.conj() @ self.lifted).real

    def propose(self, damping=0.0):
        """The `Change`, one dense solve of the landmarks' size."""
        share, weight = 1 / (1 + damping), MOBIUS_PRIOR + damping
        S = np.eye(len(self.J)) + share * self.gram + self.Jm @ self.Jm.T / weight
        constant = self.residual - share * (self.J.conj() @ self.nu).real
        y = np.linalg.solve(S, constant)  # undamped, the model's least objective is constant . y
        turn, real, imaginary = -self.Jm.T @ y / weight
        return Change(-share * (self.lifted @ y + self.nu), complex(real, imaginary), turn, constant @ y)


class ProductStep:
    """Products with J, the residuals' derivative at a state, by changes x of nu and M's parameters, real (2 N + 3,)."""

    def __init__(self, engine, state, gamma):
        self.engine, self.state, self.gamma, solution = engine, state, gamma, state.solution
        self.learnt, self.to_faces = state.learnt, engine.link.to_faces
        self.slope, self.fields = mobius_slope(solution.f, *state.mobius), mobius_fields(state.f)
        self.nu, nu_faces = np.concatenate([state.nu.view(float), np.zeros(3)]), self.to_faces @ state.nu
        along, across = (bounded_pullback(nu_faces, unit) for unit in (1.0, 1j))
        self.activation = (along - 1j * across) / 2, (along + 1j * across) / 2
        self.landmarks, self.residual = engine.landmarks.rows(engine.samples, gamma), engine.residual(state, gamma)
        self.by_mobius = (self.landmarks.conj() @ self.fields).real
        self.use(self.landmarks)

    def use(self, rows):
        """Take the residuals that change by `Re(conj(rows) dw)`."""
        self.rows_conj, self.rows_T = rows.conj().tocsr(), rows.T.tocsr()

    def activated(self, change):
        """`bounded_pullback` of a change (F,) at the state's nu."""
        P, Q = self.activation
        return P * change + Q * change.conj()

    def forward(self, x):
        """The change of the residual with x: J x."""
        self.engine.work += PRODUCT
        dmu = self.activated(self.to_faces @ x[:-3].view(complex))
        dw = self.slope * self.state.solution.pushforward(dmu) + self.fields @ x[-3:]
        return (self.rows_conj @ dw).real

    def adjoint(self, y):
        """J^T y."""
        grad_w = self.rows_T @ y
        grad_mu = self.state.solution.pullback(self.slope.conj() * grad_w)
        by_nu = self.to_faces.T @ self.activated(grad_mu)
        return np.concatenate([by_nu.view(float), (self.fields.conj().T @ grad_w).real])

    def lift(self, g, B):
        """`diag(W, B)^-1 g` for g (2 N + 3, ...)."""
        pairs = np.ascontiguousarray(g[:-3].reshape(len(self.state.nu), -1))
        solved = self.engine.factors.solve(pairs).reshape(g[:-3].shape)
        return np.concatenate([solved, np.linalg.solve(B, g[-3:])])

    def prior(self, x):
        """W x, and the weak prior of the Möbius parameters."""
        return np.concatenate([(self.engine.W @ x[:-3].view(complex)).view(float), MOBIUS_PRIOR * x[-3:]])

    def model(self):
        """The model's objective without a step."""
        return self.nu @ self.prior(self.nu) + self.residual @ self.residual

    def change(self, x, promised):
        return Change(x[:-3].view(complex), complex(x[-2], x[-1]), x[-3], promised)


class DualStep(ProductStep):
    """Landmarks alone: `S y = r - J nu`, `S = 1 + J diag(W, B)^-1 J^T`, for the residual y that the step leaves.

    A matrix near S preconditions well at any gamma; one near `W + J^T J` does not, because that is large where J is not
    quite 0. learnt: about `J W^-1 J^T` at gamma = 1, (2 M, 2 M).
    """

    def __init__(self, engine, state, gamma):
        super().__init__(engine, state, gamma)
        if self.learnt is None:  # of rows in closed form, at the first state
            J = np.ascontiguousarray(engine.jacobian(state, 1.0))
            lifted = engine.factors.solve(np.ascontiguousarray(J.T).view(float).reshape(len(state.nu), -1))
            self.learnt = (J.conj() @ np.ascontiguousarray(lifted).view(complex)).real

    def propose(self, damping=0.0):
        """The `Change`, by conjugate gradients of four rounds of solves each."""
        share, weight, Jm = 1 / (1 + damping), MOBIUS_PRIOR + damping, self.by_mobius
        before = self.model()
        S = np.eye(len(Jm)) + share * (self.gamma * self.learnt) + Jm @ Jm.T / weight
        inverse, B = np.linalg.inv(S), share * weight * np.eye(3)
        wanted = rest = self.residual - share * self.forward(self.nu)
        x, y, p, size, tried = -share * self.nu, np.zeros(len(rest)), 0.0, 1.0, []
        for _ in range(DUAL_STEPS):
            least, left = y @ wanted + y @ rest, rest @ rest  # the model's least objective is no less
            z, last = inverse @ rest, size
            size = rest @ z
            done = before - least < WORTH * before or left <= FORCING * (before - least - left)
            if done or not size > 0 or self.engine.spent:  # 0: what is left is rounding
                break
            p = z + size / last * p
            lifted = share * self.lift(self.adjoint(p), B)
            Sp = p + self.forward(lifted)
            tried.append((p, (Sp - p - Jm @ (Jm.T @ p) / weight) / share))
            length = size / (p @ Sp)
            x, y, rest = x - length * lifted, y + length * p, rest - length * Sp
        if tried:
            self.learnt = corrected(self.learnt, tried, self.gamma)
        return self.change(x, least + left)


def corrected(gram, products, gamma):
    """A matrix (n, n) corrected (BFGS) by pairs of y (n,) and gamma times the exact matrix's product with y."""
    one = np.eye(len(gram)) / gamma  # with it, as in S, nothing is singular
    Y, exact = (np.stack(side, axis=1) for side in zip(*products))
    sizes = np.linalg.norm(Y, axis=0)
    Y, parts, turned = np.linalg.svd(Y / sizes, full_matrices=False)
    whole = parts > INDEPENDENT * parts[0]  # many steps repeat their directions
    Y, turned = Y[:, whole], (turned[whole] / parts[whole, None]).T
    known, exact = (gram + one) @ Y, (exact / sizes @ turned + Y) / gamma
    old, new = (side @ np.linalg.solve(Y.T @ side, side.T) for side in (known, exact))
    return gram - old + new


class PrimalStep(ProductStep):
    """`(W + J^T J) x = -(W nu + J^T r)` with features or areas, x = change of nu and of the Möbius parameters, real.

    `P = diag(W, B) + J_L^T J_L`, by Woodbury's formula, preconditions it: landmarks' rows J_L of a large gamma would
    else cost a step each; B: the other terms' part on M's parameters. learnt: the last directions, products and sizes.
    """

    def __init__(self, engine, state, gamma):
        super().__init__(engine, state, gamma)
        self.accuracy = ACCURACY if engine.areas is None else WITH_AREAS
        if len(state.points):
            self.accuracy /= max(1.0, np.log10(gamma) - 2)
        surface = sparse.vstack([term.rows(state.f) for term in engine.terms]).tocsr()
        by_mobius = (surface.conj() @ self.fields).real
        self.B = MOBIUS_PRIOR * np.eye(3) + by_mobius.T @ by_mobius
        self.use(sparse.vstack([self.landmarks, surface]))
        self.J = np.hstack([np.ascontiguousarray(engine.jacobian(state, gamma)).view(float), self.by_mobius])
        self.B += RELIEF * self.by_mobius.T @ self.by_mobius  # else Woodbury's formula would lose all digits
        self.lifted = self.lift(self.J.T, self.B)
        self.S = np.linalg.inv(np.eye(len(self.J)) + self.J @ self.lifted)

    def precondition(self, g):
        """`P^-1 g`, exact in the directions that were learnt (BFGS)."""
        if self.learnt is None:
            return self.plain(g)
        Y, HY, sizes = self.learnt
        along = Y.T @ g / sizes
        x = self.plain(g - HY @ along)
        return x + Y @ (along - HY.T @ x / sizes)

    def plain(self, g):
        x = self.lift(g, self.B)
        return x - self.lifted @ (self.S @ (self.J @ x))

    def propose(self, damping=0.0):
        """The `Change`, by conjugate gradients of two rounds of solves each."""
        x, rest, tried = np.zeros(len(self.nu)), -self.prior(self.nu) - self.adjoint(self.residual), []
        promised, z = self.model(), self.precondition(rest)
        p, size = z, rest @ z
        first = size
        for _ in range(STEPS):
            if size <= self.accuracy**2 * first or self.engine.spent:
                break
            Hp = (1 + damping) * self.prior(p) + self.adjoint(self.forward(p))
            tried.append((p, Hp, p @ Hp))
            share = size / tried[-1][-1]
            x += share * p
            promised -= share * size
            rest -= share * Hp
            z, before = self.precondition(rest), size
            size = rest @ z
            p = z + size / before * p
        if tried:
            self.learnt = [np.stack(part, axis=-1) for part in zip(*tried)]
        return self.change(x, promised)
