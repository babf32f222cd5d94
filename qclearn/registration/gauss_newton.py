"""Gauss-Newton steps: linearisations of a fit, each made at a state of a `GaussNewtonObjective`;
`propose(damping)` gives a change.

Landmarks and features are one residual r of the mapped mesh, `dr = Re(conj(R) dw)`. A `DirectStep`
holds its whole derivative J by nu. The others multiply by J through `pushforward` and by its
transpose through `pullback`, two rounds of solves a product, in conjugate gradients that the
landmarks' rows in closed form precondition; what a step learns of its exact products,
`preconditioner`, helps the next.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ..plane.bijectivity import unfold
from ..plane.coefficients import bounded_pullback
from ..plane.linear import factorise
from ..plane.mobius import compose_mobius, mobius, mobius_fields, mobius_slope
from ..plane.solver import DiskSolver
from ..plane.tangent import Tangent
from .residuals import LandmarkTerm

MOBIUS_PRIOR = 1e-6  # weak, keeps the step of the three Möbius parameters bounded
RELIEF = 1e-3  # share of the landmarks' part on the Möbius parameters that P counts twice
STEPS, DUAL_STEPS = (
    80,
    200,
)  # of conjugate gradients, at most; the dual's are few, unless gamma is extreme
WORTH = 1e-3  # the share of the objective that a step has to promise
FORCING = (
    0.1  # share of its gain by which a step of landmarks alone may miss the model's least objective
)
# The residual that they leave, in the preconditioner's norm, up to gamma = 1e3; beyond, less by
# decades.
ACCURACY = 0.1
# The same with areas: steps that are less exact promise too little, and the fit ends early.
WITH_AREAS = 0.01
PRODUCT = 0.35  # work of a product, in parts of one exact map
INDEPENDENT = 1e-6  # singular values of the directions preconditioner from, in parts of the largest


class Change(NamedTuple):
    """What `propose(d)` says: changes of nu (N,) and of the Möbius parameters, and the model's
    objective there; d adds `d (change^* W change)` to what is minimised, and its like for the
    Möbius part."""

    nu: np.ndarray
    da: complex
    dtheta: float
    promised: float


class DirectStep:
    """Landmarks alone with their Jacobian, by the dual equations `S y = r - J nu`, `S = 1 + J W^-1
    J^T`."""

    preconditioner = None

    def __init__(self, engine, state, gamma):
        self.nu, landmarks, solve = state.nu, engine.landmarks, engine.factors.solve
        self.residual, self.J = engine.residual(state, gamma), engine.jacobian(state, gamma)
        self.Jm = landmarks.components(engine.samples @ mobius_fields(state.f), gamma)
        real, imaginary = (
            solve(np.ascontiguousarray(part.T)) for part in (self.J.real, self.J.imag)
        )
        self.lifted = real + 1j * imaginary
        self.gram = (self.J.conj() @ self.lifted).real

    def propose(self, damping=0.0):
        """The `Change`, one dense solve of the landmarks' size."""
        share, weight = 1 / (1 + damping), MOBIUS_PRIOR + damping
        S = np.eye(len(self.J)) + share * self.gram + self.Jm @ self.Jm.T / weight
        constant = self.residual - share * (self.J.conj() @ self.nu).real
        y = np.linalg.solve(S, constant)  # undamped, the model's least objective is constant . y
        turn, real, imaginary = -self.Jm.T @ y / weight
        return Change(
            -share * (self.lifted @ y + self.nu), complex(real, imaginary), turn, constant @ y
        )


class ProductStep:
    """Products with J, the residuals' derivative at a state, by changes x of nu and M's parameters,
    real (2 N + 3,)."""

    def __init__(self, engine, state, gamma):
        self.engine, self.state, self.gamma, solution = engine, state, gamma, state.solution
        self.preconditioner, self.to_faces = state.preconditioner, engine.link.to_faces
        self.slope, self.fields = mobius_slope(solution.f, *state.mobius), mobius_fields(state.f)
        self.nu, nu_faces = (
            np.concatenate([state.nu.view(float), np.zeros(3)]),
            self.to_faces @ state.nu,
        )
        along, across = (bounded_pullback(nu_faces, unit) for unit in (1.0, 1j))
        self.activation = (along - 1j * across) / 2, (along + 1j * across) / 2
        self.landmarks, self.residual = (
            engine.landmarks.rows(engine.samples, gamma),
            engine.residual(state, gamma),
        )
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
        return np.concatenate(
            [(self.engine.W @ x[:-3].view(complex)).view(float), MOBIUS_PRIOR * x[-3:]]
        )

    def model(self):
        """The model's objective without a step."""
        return self.nu @ self.prior(self.nu) + self.residual @ self.residual

    def change(self, x, promised):
        return Change(x[:-3].view(complex), complex(x[-2], x[-1]), x[-3], promised)


class DualStep(ProductStep):
    """Landmarks alone: `S y = r - J nu`, `S = 1 + J diag(W, B)^-1 J^T`, for the residual y that the
    step leaves.

    A matrix near S preconditions well at any gamma; one near `W + J^T J` does not, because that is
    large where J is not quite 0. preconditioner: about `J W^-1 J^T` at gamma = 1, (2 M, 2 M).
    """

    def __init__(self, engine, state, gamma):
        super().__init__(engine, state, gamma)
        if self.preconditioner is None:  # of rows in closed form, at the first state
            J = np.ascontiguousarray(engine.jacobian(state, 1.0))
            lifted = engine.factors.solve(
                np.ascontiguousarray(J.T).view(float).reshape(len(state.nu), -1)
            )
            self.preconditioner = (J.conj() @ np.ascontiguousarray(lifted).view(complex)).real

    def propose(self, damping=0.0):
        """The `Change`, by conjugate gradients of four rounds of solves each."""
        share, weight, Jm = 1 / (1 + damping), MOBIUS_PRIOR + damping, self.by_mobius
        before = self.model()
        S = np.eye(len(Jm)) + share * (self.gamma * self.preconditioner) + Jm @ Jm.T / weight
        inverse, B = np.linalg.inv(S), share * weight * np.eye(3)
        wanted = rest = self.residual - share * self.forward(self.nu)
        x, y, p, size, tried = -share * self.nu, np.zeros(len(rest)), 0.0, 1.0, []
        for _ in range(DUAL_STEPS):
            least, left = (
                y @ wanted + y @ rest,
                rest @ rest,
            )  # the model's least objective is no less
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
            self.preconditioner = corrected(self.preconditioner, tried, self.gamma)
        return self.change(x, least + left)


def corrected(gram, products, gamma):
    """A matrix (n, n) corrected (BFGS) by pairs of y (n,) and gamma times the exact matrix's
    product with y."""
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
    """`(W + J^T J) x = -(W nu + J^T r)` with features or areas, x = change of nu and of the Möbius
    parameters, real.

    `P = diag(W, B) + J_L^T J_L`, by Woodbury's formula, preconditions it: landmarks' rows J_L of a
    large gamma would else cost a step each; B: the other terms' part on M's parameters.
    preconditioner: the last directions, products and sizes.
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
        self.J = np.hstack(
            [np.ascontiguousarray(engine.jacobian(state, gamma)).view(float), self.by_mobius]
        )
        self.B += (
            RELIEF * self.by_mobius.T @ self.by_mobius
        )  # else Woodbury's formula would lose all digits
        self.lifted = self.lift(self.J.T, self.B)
        self.S = np.linalg.inv(np.eye(len(self.J)) + self.J @ self.lifted)

    def precondition(self, g):
        """`P^-1 g`, exact in the directions that were preconditioner (BFGS)."""
        if self.preconditioner is None:
            return self.plain(g)
        Y, HY, sizes = self.preconditioner
        along = Y.T @ g / sizes
        x = self.plain(g - HY @ along)
        return x + Y @ (along - HY.T @ x / sizes)

    def plain(self, g):
        x = self.lift(g, self.B)
        return x - self.lifted @ (self.S @ (self.J @ x))

    def propose(self, damping=0.0):
        """The `Change`, by conjugate gradients of two rounds of solves each."""
        x, rest, tried = (
            np.zeros(len(self.nu)),
            -self.prior(self.nu) - self.adjoint(self.residual),
            [],
        )
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
            self.preconditioner = [np.stack(part, axis=-1) for part in zip(*tried)]
        return self.change(x, promised)


SHARES = (1.0, 0.5, 0.25, 0.125)  # of a step, tried in turn by the line search
SUFFICIENT_DECREASE = 0.3  # share of what the quadratic model promises that a step has to gain
LANDMARKS_AT_ONCE = 16  # bounds the memory of the adjoint solves
DAMPINGS = 10.0 ** np.arange(
    -1, 10
)  # of the steps that are tried where the line search fails, in parts of W
TRUST, TRIES = 0.3, 4  # the largest change of nu in a damped step, and how many of them are tried
# Work in parts of one exact map, and how much of it one level on the problem's own mesh may take:
# up to LOW_GAMMA, and growing by the power GROWTH above. The slowest good problems
# (book/studies/effort.py) took 8, 30, 94, 164 and 290 at gamma = 1e3, 1e5, 1e6, 1e7 and 1e8, with
# folds 70.
REPAIR = 1.4
MOST_WORK, LOW_GAMMA, GROWTH = 120.0, 1e5, 0.25


@dataclass(frozen=True, eq=False)
class State:
    """nu (N,) and Möbius parameters, and the map that they give.

    f (V,): M after the solver's map on the mapped mesh; points (M,): the mapped landmarks;
    solution: the solver with its factors; switched: how many rows were; preconditioner: what
    earlier steps know of the linearisation (steps.py).
    """

    nu: np.ndarray
    mobius: tuple
    f: np.ndarray
    points: np.ndarray
    solution: DiskSolver
    switched: int = 0
    preconditioner: object = None

    @cached_property
    def folded(self):
        """Whether rows were switched and faces stay flipped."""
        return self.switched > 0 and len(self.solution.disk.at(self.f).flipped) > 0


class Discretization:
    """What no weight changes of a `Problem` on a `CoefficientMesh`; own: the problem's disk is
    mapped, not the polar mesh."""

    def __init__(self, problem, link, own):
        self.problem, self.link, self.own = problem, link, own
        self.samples = problem.samples if self.own else link.disk.sampling(problem.moving)
        self.landmarks = LandmarkTerm(problem.target, problem.curve, problem.sliding)

    @cached_property
    def mass_by_area(self):
        """`S^T diag(w) S`, S from nu's mesh to the moving vertices, w their shares of the moving
        surface's area."""
        moving = self.problem.sides.moving
        S = self.link.mesh.sampling(moving.disk.z)
        return (
            S.T @ sparse.diags_array(moving.surface.vertex_areas / moving.surface.area) @ S
        ).tocsc()

    @cached_property
    def shares(self):
        """Sparse (F, G): the G moving faces' shares of their area, in the F faces of the mapped
        mesh that hold them."""
        moving = self.problem.sides.moving
        shares, count = moving.surface.face_areas / moving.surface.area, len(self.link.disk.faces)
        inside = (
            np.arange(count)
            if self.link.disk is moving.disk
            else self.link.disk.locate(moving.disk.centroids)[0]
        )
        return sparse.csr_array(
            (shares, (inside, np.arange(len(shares)))), shape=(count, len(shares))
        )

    def by_area(self, values):
        """The moving area's shares (F,) in the mapped faces, and means (F,) there of values (V,) of
        its vertices."""
        shares = self.shares.sum(1)
        sums = self.shares @ values[self.problem.sides.moving.disk.faces].mean(1)
        return shares, np.divide(sums, shares, out=np.zeros(len(sums)), where=shares > 0)

    @cached_property
    def tangent(self):
        """The derivative at the landmarks in closed form."""
        return Tangent(self.link, self.samples)


class GaussNewtonObjective:
    """The fit of a `Discretization` with `Weights`, maybe a `FeatureTerm` and an `AreaTerm`:
    `at(nu, mobius)`, `step(state)`.

    closed: take the derivative by nu in closed form, a few percent off and without a solve, to
    precondition exact products; else from adjoint solves, which cost little on a polar mesh. Rows
    are switched where a face of the problem's own mesh is flipped.
    """

    def __init__(self, setting, weights, features=None, areas=None, closed=None):
        self.setting, self.weights, self.features, self.areas = setting, weights, features, areas
        self.terms = [term for term in (features, areas) if term is not None]
        self.closed = setting.own if closed is None else closed
        self.problem, self.link, self.samples = setting.problem, setting.link, setting.samples
        self.landmarks = setting.landmarks
        self.mass = self.link.mass if areas is None else setting.mass_by_area
        self.W = weights.alpha * self.mass + weights.beta * self.link.laplace
        self.factors = factorise(self.W)
        self.work = 0.0
        growing = max(weights.gamma / LOW_GAMMA, 1.0) ** GROWTH if len(self.problem.moving) else 1.0
        self.most_work = MOST_WORK * growing if setting.own else np.inf

    @property
    def spent(self):
        """Whether the steps of this level have taken all the work that they may."""
        return self.work > self.most_work

    def at(self, nu, parameters):
        """The state with nu (N,) and Möbius parameters (a, theta): one solve."""
        solution = copy(self.link.solver)
        solution.solve(self.link.coefficient(nu))
        self.work += 1
        return self.finished(nu, parameters, solution, mobius(solution.f, *parameters))

    def with_mobius(self, state, parameters):
        """The state with the same nu and other Möbius parameters: no solve."""
        return self.finished(
            state.nu, parameters, state.solution, mobius(state.solution.f, *parameters)
        )

    def at_mobius(self, parameters):
        """The state with nu = 0 and the Möbius map itself at each vertex, mended where it folds
        triangles."""
        solution = copy(self.link.solver)
        solution.mu, solution.floored = np.zeros(len(solution.disk.faces), complex), 0
        f = mobius(solution.disk.z, *parameters)
        f[solution.loop] /= abs(f[solution.loop])
        return self.finished(np.zeros(len(self.link.mesh.z), complex), parameters, solution, f)

    def finished(self, nu, parameters, solution, f):
        f, rows, rounds = unfold(solution, f) if self.setting.own else (f, (), 0)
        self.work += REPAIR * rounds
        return State(nu, parameters, f, self.samples @ f, solution, len(rows))

    def prior(self, nu):
        return (nu.conj() @ (self.W @ nu)).real

    def residual(self, state, gamma):
        """All residuals of a state: of the landmarks, and of the terms over the whole surface."""
        landmarks = self.landmarks.residual(state.points, gamma)
        return np.concatenate([landmarks, *(term.residual(state.f) for term in self.terms)])

    def objective(self, state, gamma):
        return self.prior(state.nu) + (self.residual(state, gamma) ** 2).sum()

    def merit(self, found, state, gamma):
        """The objective of a state that may follow another; infinite where its map folds and that
        one's does not."""
        return np.inf if found.folded and not state.folded else self.objective(found, gamma)

    def error(self, state):
        """Mean distance of a state's landmarks from their targets."""
        return abs(state.points - self.problem.target).mean()

    def jacobian(self, state, gamma):
        """Gradients of the landmarks' residual by nu, complex (2 M, N), in closed form or exact."""
        if not self.closed:
            return self.landmarks.jacobian(*self.gradients(state), gamma)
        real, imaginary = self.setting.tangent.gradients(state.nu, state.solution.f)
        slope = (self.samples @ mobius_slope(state.solution.f, *state.mobius))[:, None]
        turned = (
            slope.real * real - slope.imag * imaginary,
            slope.imag * real + slope.real * imaginary,
        )
        return self.landmarks.jacobian(*turned, gamma)

    def gradients(self, state):
        """Exact gradients of Re w and Im w of the mapped landmarks by nu, complex (M, N) each."""
        solution, slope = state.solution, mobius_slope(state.solution.f, *state.mobius)
        parts = [np.zeros((2, 0, len(state.nu)), complex)]
        points = (self.samples @ sparse.diags_array(slope.conj())).tocsr()
        chains = [self.chain(state, by_mu) for by_mu in solution.sensitivities]
        for rows in range(0, points.shape[0], LANDMARKS_AT_ONCE):
            adjoints = solution.adjoints(points[rows : rows + LANDMARKS_AT_ONCE])
            real, imaginary = np.split(
                sum(chain @ adjoint for chain, adjoint in zip(chains, adjoints)), 2
            )
            parts.append((real + 1j * imaginary).T.reshape(2, -1, len(state.nu)))
        return np.concatenate(parts, axis=1)

    def chain(self, state, sensitivity):
        """Sparse real (2 N, V): an adjoint of a potential to the gradient by nu, Re above Im,
        without a dense array."""
        by_mu, to_faces = sensitivity.tocoo(), self.link.to_faces
        data = bounded_pullback((to_faces @ state.nu)[by_mu.row], by_mu.data)
        chain = to_faces.T.tocsr() @ sparse.csr_array(
            (data, (by_mu.row, by_mu.col)), shape=by_mu.shape
        )
        return sparse.vstack([chain.real, chain.imag]).tocsr()

    def linearise(self, state, gamma):
        """The linearisation of steps.py at a state."""
        kind = DualStep if self.setting.own else DirectStep
        return (PrimalStep if self.terms else kind)(self, state, gamma)

    def step(self, state, gamma, min_predicted_decrease=0.0):
        """The state after one step; None where none lowers the objective or the model promises less
        than that share of it.

        A share s of the Gauss-Newton step is taken once it brings a sufficient part of the model's
        `(2s - s^2)` of the full step's gain; if none does, the best of these and, with landmarks
        alone, of some damped steps.
        """
        before, linearised = self.objective(state, gamma), self.linearise(state, gamma)
        *whole, promised = linearised.propose()
        if before - promised < min_predicted_decrease * before:
            return None
        tried = []  # (objective, state)
        for share in SHARES:
            found = self.after(state, *(share * part for part in whole))
            tried.append((self.merit(found, state, gamma), found))
            if before - tried[-1][0] > SUFFICIENT_DECREASE * (2 * share - share**2) * (
                before - promised
            ):
                return replace(found, preconditioner=linearised.preconditioner)
            if self.spent:
                break
        if (
            not self.terms and not self.spent
        ):  # with terms over the surface, each would mean to solve large equations anew
            for change in damped_changes(linearised):
                found = self.after(state, *change)
                tried.append((self.merit(found, state, gamma), found))
                if self.spent:
                    break
        least, best = min(tried, key=itemgetter(0))
        return replace(best, preconditioner=linearised.preconditioner) if least < before else None

    def after(self, state, change, da, dtheta):
        """The state after a change of nu and of the Möbius parameters."""
        return self.at(state.nu + change, compose_mobius(state.mobius, (da, dtheta)))


def damped_changes(linearised):
    """Levenberg steps from the least damping that changes nu by at most TRUST, found without a map."""
    steps = (linearised.propose(damping)[:-1] for damping in DAMPINGS)
    return islice((step for step in steps if abs(step[0]).max() <= TRUST), TRIES)
