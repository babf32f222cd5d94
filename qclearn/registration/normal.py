"""Gauss-Newton steps without a Jacobian: conjugate gradients, with two rounds of solves a product.

Landmarks and features are one residual r of the mapped mesh, `dr = Re(conj(R) dw)`. Its derivative J by nu goes through
`pushforward`, its transpose through `pullback`, however many residuals there are. The equations are exact: what is near
enough, the landmarks' rows in closed form, preconditions them.
"""

import numpy as np
from scipy import sparse

from ..plane.fields import bounded_pullback
from ..plane.mobius import mobius_fields, mobius_slope

MOBIUS_PRIOR = 1e-6  # weak, keeps the step of the three Möbius parameters bounded
RELIEF = 1e-3  # share of the landmarks' part on the Möbius parameters that P counts twice
STEPS, DUAL_STEPS = 40, 200  # of conjugate gradients, at most; the dual's are few, unless gamma is extreme
WORTH = 1e-3  # the share of the objective that a step has to promise
FORCING = 0.1  # share of its gain by which a step of landmarks alone may miss the model's least objective
ACCURACY = 0.1  # the residual that they leave, in the preconditioner's norm, up to gamma = 1e3; beyond, less by decades


class Linearisation:
    """The derivative J of the residuals at a state of an engine, by changes x of nu and of the Möbius parameters, real
    (2 N + 3,)."""

    def __init__(self, engine, state, gamma):
        self.engine, self.state, self.gamma, solution = engine, state, gamma, state.solution
        self.slope, self.fields = mobius_slope(solution.f, *state.mobius), mobius_fields(state.f)
        self.nu, nu_faces = np.concatenate([state.nu.view(float), np.zeros(3)]), engine.to_faces @ state.nu
        along, across = (bounded_pullback(nu_faces, unit) for unit in (1.0, 1j))
        self.activation = (along - 1j * across) / 2, (along + 1j * across) / 2
        self.landmarks, self.residual = engine.landmarks.rows(engine.samples, gamma), engine.residual(state, gamma)
        self.by_mobius = (self.landmarks.conj() @ self.fields).real
        self.use(self.landmarks)

    def use(self, rows):
        """Take the residuals that change by `Re(conj(rows) dw)`."""
        self.rows_conj, self.rows_T = rows.conj().tocsr(), rows.T.tocsr()

    def activated(self, change):
        """`bounded_pullback` of a change (F,) at the state's nu: which is linear in its real and imaginary parts."""
        P, Q = self.activation
        return P * change + Q * change.conj()

    def forward(self, x):
        """The change of the residual with x: J x."""
        dmu = self.activated(self.engine.to_faces @ x[:-3].view(complex))
        dw = self.slope * self.state.solution.pushforward(dmu) + self.fields @ x[-3:]
        return (self.rows_conj @ dw).real

    def adjoint(self, y):
        """J^T y."""
        grad_w = self.rows_T @ y
        grad_mu = self.state.solution.pullback(self.slope.conj() * grad_w)
        by_nu = self.engine.to_faces.T @ self.activated(grad_mu)
        return np.concatenate([by_nu.view(float), (self.fields.conj().T @ grad_w).real])

    def lift(self, g, B):
        """`diag(W, B)^-1 g` for g (2 N + 3, ...)."""
        nodal, mobius = g[:-3], g[-3:]
        pairs = nodal.reshape(len(self.state.nu), -1)
        solved = self.engine.factors.solve(np.ascontiguousarray(pairs)).reshape(nodal.shape)
        return np.concatenate([solved, np.linalg.solve(B, mobius)])

    def prior(self, x):
        """W x, and the weak prior of the Möbius parameters."""
        return np.concatenate([(self.engine.W @ x[:-3].view(complex)).view(float), MOBIUS_PRIOR * x[-3:]])

    def parts(self, x):
        """(change of nu, da, dtheta) of x."""
        return x[:-3].view(complex), complex(x[-2], x[-1]), x[-3]


class DualEquations(Linearisation):
    """Landmarks alone: `S y = r - J nu`, `S = 1 + J diag(W, B)^-1 J^T`, for the residual y that the step leaves.

    Few unknowns, preconditioned by an S that is near enough, `engine.gram`: as good at any gamma, where what is near to
    W + J^T J is not, as that is large where J is not quite 0.
    """

    def propose(self, _, damping=0.0):
        """(change of nu, da, dtheta, the model's objective there) at the state that the equations are of.

        damping: adds `damping (change^* W change)` to what is minimised, and its like for the Möbius part.
        """
        share, weight, Jm = 1 / (1 + damping), MOBIUS_PRIOR + damping, self.by_mobius
        before = self.nu @ self.prior(self.nu) + self.residual @ self.residual
        S = np.eye(len(Jm)) + share * self.engine.gram(self.state, self.gamma) + Jm @ Jm.T / weight
        inverse, B = np.linalg.inv(S), share * weight * np.eye(3)
        wanted = rest = self.residual - share * self.forward(self.nu)
        x, y, p, size, tried = -share * self.nu, np.zeros(len(rest)), 0.0, 1.0, []
        for _ in range(DUAL_STEPS):
            least, left = y @ wanted + y @ rest, rest @ rest  # the model's least objective is no less
            z, last = inverse @ rest, size
            size = rest @ z
            done = before - least < WORTH * before or left <= FORCING * (before - least - left)
            if done or not size > 0:  # 0: what is left is rounding
                break
            p = z + size / last * p
            lifted = share * self.lift(self.adjoint(p), B)
            Sp = p + self.forward(lifted)
            tried.append((p, (Sp - p - Jm @ (Jm.T @ p) / weight) / share))
            length = size / (p @ Sp)
            x, y, rest = x - length * lifted, y + length * p, rest - length * Sp
        self.engine.learn(tried, self.gamma)
        return *self.parts(x), least + left


class NormalEquations(Linearisation):
    """`(W + J^T J) x = -(W nu + J^T r)` at a state of an engine, x = change of nu and of the Möbius parameters, real.

    Preconditioned by `P = diag(W, B) + J_L^T J_L` with quick rows J_L of the landmarks and the features' part B on the
    Möbius parameters, inverted by Woodbury's formula. Landmarks of a large gamma would else cost a step each.
    """

    def __init__(self, engine, state, gamma):
        super().__init__(engine, state, gamma)
        self.accuracy = ACCURACY / max(1.0, np.log10(gamma) - 2) if len(state.points) else ACCURACY
        self.B = MOBIUS_PRIOR * np.eye(3)
        if engine.dense is not None:
            features = engine.dense.rows(state.f)
            by_mobius = (features.conj() @ self.fields).real
            self.B += by_mobius.T @ by_mobius
            self.use(sparse.vstack([self.landmarks, features]))
        J = np.ascontiguousarray(engine.quick_jacobian(state, gamma)).view(float)
        self.J = np.hstack([J, self.by_mobius])
        self.B += RELIEF * self.by_mobius.T @ self.by_mobius  # else Woodbury's formula would lose all digits
        self.lifted = self.lift(self.J.T, self.B)
        self.S = np.linalg.inv(np.eye(len(self.J)) + self.J @ self.lifted)

    def precondition(self, g):
        x = self.lift(g, self.B)
        return x - self.lifted @ (self.S @ (self.J @ x))

    def corrected(self, g):
        """`precondition`, exact in the directions that the engine's last equations were solved in (BFGS)."""
        if self.engine.known_directions is None:
            return self.precondition(g)
        Y, HY, sizes = self.engine.known_directions
        along = Y.T @ g / sizes
        x = self.precondition(g - HY @ along)
        return x + Y @ (along - HY.T @ x / sizes)

    def propose(self, _):
        """(change of nu, da, dtheta, least objective of the model) at the state that the equations are of."""
        x, rest, tried = np.zeros(len(self.nu)), -self.prior(self.nu) - self.adjoint(self.residual), []
        promised = self.nu @ self.prior(self.nu) + self.residual @ self.residual
        z = p = self.corrected(rest)
        size = first = rest @ z
        for _ in range(STEPS):
            if size <= self.accuracy**2 * first:
                break
            Hp = self.prior(p) + self.adjoint(self.forward(p))
            tried.append((p, Hp, p @ Hp))
            share = size / tried[-1][-1]
            x += share * p
            promised -= share * size
            rest -= share * Hp
            z, before = self.corrected(rest), size
            size = rest @ z
            p = z + size / before * p
        if tried:
            self.engine.known_directions = [np.stack(part, axis=-1) for part in zip(*tried)]
        return *self.parts(x), promised
