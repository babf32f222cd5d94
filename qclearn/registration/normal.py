"""A Gauss-Newton step with more residuals than a dual matrix can hold: conjugate gradients on the normal equations.

Landmarks and features are one residual r of the mapped mesh, `dr = Re(conj(R) dw)`. Its derivative by nu goes through
`pushforward`, its transpose through `pullback`: two rounds of solves a product, however many residuals there are.
"""

import numpy as np
from scipy import sparse

from ..plane.fields import bounded_pullback
from ..plane.mobius import mobius_fields, mobius_slope

MOBIUS_PRIOR = 1e-6  # weak, keeps the step of the three Möbius parameters bounded
RELIEF = 1e-3  # share of the landmarks' part on the Möbius parameters that P counts twice
STEPS = 40  # of conjugate gradients, at most
ACCURACY = 0.1  # the residual that they leave, in the preconditioner's norm, up to gamma = 1e3; beyond, less by decades


class NormalEquations:
    """`(W + J^T J) x = -(W nu + J^T r)` at a state of an engine, x = change of nu and of the Möbius parameters, real.

    Preconditioned by `P = diag(W, B) + J_L^T J_L` with quick rows J_L of the landmarks and the features' part B on the
    Möbius parameters, inverted by Woodbury's formula. Landmarks of a large gamma would else cost a step each.
    """

    def __init__(self, engine, state, gamma):
        self.engine, self.state, solution = engine, state, state.solution
        self.accuracy = ACCURACY / max(1.0, np.log10(gamma) - 2) if len(state.points) else ACCURACY
        self.slope, self.fields = mobius_slope(solution.f, *state.mobius), mobius_fields(state.f)
        self.nu_faces = engine.to_faces @ state.nu
        landmarks, self.residual = engine.landmarks.rows(engine.samples, gamma), engine.residual(state, gamma)
        self.rows, self.B = landmarks, MOBIUS_PRIOR * np.eye(3)
        if engine.dense is not None:
            features = engine.dense.rows(state.f)
            by_mobius = (features.conj() @ self.fields).real
            self.rows, self.B = sparse.vstack([landmarks, features]).tocsr(), self.B + by_mobius.T @ by_mobius
        self.rows_conj, self.rows_T = self.rows.conj(), self.rows.T.tocsr()
        J = np.ascontiguousarray(engine.quick_jacobian(state, gamma)).view(float)
        self.J = np.hstack([J, (landmarks.conj() @ self.fields).real])
        self.B += RELIEF * self.J[:, -3:].T @ self.J[:, -3:]  # else Woodbury's formula would lose all digits
        self.lifted = self.lift(self.J.T)
        self.S = np.linalg.inv(np.eye(len(self.J)) + self.J @ self.lifted)

    def lift(self, g):
        """`diag(W, B)^-1 g` for g (2 N + 3, ...)."""
        nodal, mobius = g[:-3], g[-3:]
        pairs = nodal.reshape(len(self.state.nu), -1)
        solved = self.engine.factors.solve(np.ascontiguousarray(pairs)).reshape(nodal.shape)
        return np.concatenate([solved, np.linalg.solve(self.B, mobius)])

    def precondition(self, g):
        x = self.lift(g)
        return x - self.lifted @ (self.S @ (self.J @ x))

    def prior(self, x):
        """W x, and the weak prior of the Möbius parameters."""
        return np.concatenate([(self.engine.W @ x[:-3].view(complex)).view(float), MOBIUS_PRIOR * x[-3:]])

    def forward(self, x):
        """The change of the residual with x: J x."""
        dmu = bounded_pullback(self.nu_faces, self.engine.to_faces @ x[:-3].view(complex))
        dw = self.slope * self.state.solution.pushforward(dmu) + self.fields @ x[-3:]
        return (self.rows_conj @ dw).real

    def adjoint(self, y):
        """J^T y."""
        grad_w = self.rows_T @ y
        grad_mu = self.state.solution.pullback(self.slope.conj() * grad_w)
        by_nu = self.engine.to_faces.T @ bounded_pullback(self.nu_faces, grad_mu)
        return np.concatenate([by_nu.view(float), (self.fields.conj().T @ grad_w).real])

    def propose(self, state):
        """(change of nu, da, dtheta, least objective of the model) at the state that the equations are of."""
        x = np.zeros(2 * len(state.nu) + 3)
        nu = np.concatenate([state.nu.view(float), np.zeros(3)])
        rest = -self.prior(nu) - self.adjoint(self.residual)
        promised = nu @ self.prior(nu) + self.residual @ self.residual
        z = p = self.precondition(rest)
        size = first = rest @ z
        for _ in range(STEPS):
            if size <= self.accuracy**2 * first:
                break
            Hp = self.prior(p) + self.adjoint(self.forward(p))
            share = size / (p @ Hp)
            x += share * p
            promised -= share * size
            rest -= share * Hp
            z, before = self.precondition(rest), size
            size = rest @ z
            p = z + size / before * p
        return x[:-3].view(complex), complex(x[-2], x[-1]), x[-3], promised
