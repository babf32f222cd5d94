"""The objective of a fit on one pair of meshes, and Gauss-Newton steps that lower it.

A `GaussNewtonObjective` is `nu^* W nu + |r|^2`: a prior of the coefficient field nu, and residuals
r of the mapped mesh, `dr = Re(conj(R) dw)`, from landmarks, features and areas. Its `step`
linearises r at a `State`, solves the quadratic model, and searches along the solution.

Two classes solve the model; `propose()` returns a `Change`. `DualStep` (landmarks alone) and
`PrimalStep` (features or areas) multiply by D, the derivative of r, through `pushforward` and by
its transpose through `pullback`, two solves of the map's equations per product, in conjugate
gradients. The landmarks' rows of D on the mesh of nu precondition these, and the products of one
step correct the preconditioner of the next.
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
from ..plane.mobius import best_mobius, compose_mobius, mobius, mobius_fields, mobius_slope
from ..plane.solver import DiskSolver, on_itself
from .residuals import LandmarkTerm

# A weak prior that bounds the step of the three Möbius parameters.
MOBIUS_PRIOR = 1e-6
# The preconditioner counts the landmarks' block on the Möbius parameters 1 + RELIEF times: without
# this, Woodbury's formula loses all digits.
RELIEF = 1e-3

# Share of the other terms' block on the Möbius parameters that it counts. A change of nu can undo
# nearly all of a Möbius map; with the whole block, conjugate gradients find such directions last.
MOBIUS_SHARE = 0.02

# Conjugate gradients: how many steps at most (dual steps are few, unless gamma is extreme).
PRIMAL_STEPS = 80
DUAL_STEPS = 200
# Share of the objective by which the model of a step on the caller's mesh or its proxy must lower
# it.
MIN_DECREASE = 1e-3
# A dual step's conjugate gradients end where it can gain at most this share of the objective.
SMALL_GAIN = 1e-3
# Share of its gain by which a dual step may miss the model's least objective.
FORCING = 0.1
# Residual that a primal step leaves, in the preconditioner's norm, up to gamma = 1e3; beyond, less
# by decades.
ACCURACY = 0.1
# The same with areas: steps that are less exact promise too little, and the fit ends early.
ACCURACY_WITH_AREAS = 0.03
# Least singular value of the directions that correct a preconditioner, in parts of the largest.
INDEPENDENT = 1e-6

# Line search: shares of a step, tried in turn, and the share of the gain that the quadratic model
# promises there which a step has to reach.
SHARES = (1.0, 0.5, 0.25, 0.125)
SUFFICIENT_DECREASE = 0.3
# Where the line search fails: dampings of the step, in parts of W; the largest change of nu that a
# damped step may make; how many of them are tried.
DAMPINGS = 10.0 ** np.arange(-1, 10)
TRUST = 0.3
TRIES = 4

# Work of a level, in parts of one exact map: of a product with D and its transpose, and of a round
# of the repair.
PRODUCT_WORK = 0.35
REPAIR_WORK = 1.4
# The most that one level on the caller's mesh or its proxy may take: MOST_WORK up to LOW_GAMMA,
# growing above by the power GROWTH of gamma. The slowest of twenty good problems took 8, 30, 94,
# 164 and 290 at gamma = 1e3, 1e5, 1e6, 1e7 and 1e8, and 70 with folds.
MOST_WORK = 120.0
LOW_GAMMA = 1e5
GROWTH = 0.25


class Change(NamedTuple):
    """A step: changes of nu (N,) and of the Möbius parameters, and the objective that the quadratic
    model promises after them."""

    nu: np.ndarray
    da: complex
    dtheta: float
    promised: float


class ProductStep:
    """Products with D, the residuals' derivative at a state, by changes x of nu and of the Möbius
    parameters, real (2 N + 3,); learnt: what the last step learnt of its equations."""

    def __init__(self, objective, state, gamma):
        self.objective, self.state, self.gamma = objective, state, gamma
        self.learnt = state.learnt
        # dw = slope df + fields @ (dtheta, Re da, Im da), w = M(f).
        self.slope = mobius_slope(state.solution.f, *state.mobius)
        self.fields = mobius_fields(state.f)
        # dmu = P dnu + Q conj(dnu) on the faces.
        self.to_faces = objective.coefficient_mesh.to_faces
        self.to_faces_T = self.to_faces.T
        along, across = (bounded_pullback(self.to_faces @ state.nu, unit) for unit in (1.0, 1j))
        self.activation = (along - 1j * across) / 2, (along + 1j * across) / 2
        self.nu = np.concatenate([state.nu.view(float), np.zeros(3)])
        self.residual = objective.residual(state, gamma)
        # The residuals change by `Re(conj(rows) dw)`, the landmarks' first.
        self.landmarks = objective.landmarks.rows(objective.samples, gamma)
        terms = [term.rows(state.f) for term in objective.terms]
        self.rows = sparse.vstack([self.landmarks, *terms]).tocsr()
        self.rows_conj, self.rows_T = self.rows.conj(), self.rows.T.tocsr()
        self.by_mobius = (self.landmarks.conj() @ self.fields).real
        # The model's objective without a step.
        self.before = self.nu @ self.prior(self.nu) + self.residual @ self.residual

    def activated(self, change):
        """`bounded_pullback` of a change (F,) at the state's nu."""
        P, Q = self.activation
        return P * change + Q * change.conj()

    def forward(self, x):
        """D x, the change of the residual with x."""
        self.objective.work += PRODUCT_WORK
        dmu = self.activated(self.to_faces @ x[:-3].view(complex))
        dw = self.slope * self.state.solution.pushforward(dmu) + self.fields @ x[-3:]
        return (self.rows_conj @ dw).real

    def adjoint(self, y):
        """D^T y."""
        grad_w = self.rows_T @ y
        grad_mu = self.state.solution.pullback(self.slope.conj() * grad_w)
        by_nu = self.to_faces_T @ self.activated(grad_mu)
        return np.concatenate([by_nu.view(float), (self.fields.conj().T @ grad_w).real])

    def lift(self, g, B):
        """`diag(W, B)^-1 g` for g (2 N + 3, ...)."""
        pairs = np.ascontiguousarray(g[:-3].reshape(len(self.state.nu), -1))
        solved = self.objective.factors.solve(pairs).reshape(g[:-3].shape)
        return np.concatenate([solved, np.linalg.solve(B, g[-3:])])

    def prior(self, x):
        """W x, and the weak prior of the Möbius parameters."""
        by_nu = self.objective.W @ x[:-3].view(complex)
        return np.concatenate([by_nu.view(float), MOBIUS_PRIOR * x[-3:]])


def conjugate_gradients(product, precondition, load, most, enough):
    """x of `A x = load`, what is left of the load, and the directions (p, A p, p A p), by at most
    `most` steps of preconditioned conjugate gradients.

    They end where `enough(x, rest, size)`: size is the rest's squared norm in the preconditioner's,
    in parts of the load's; or where it is 0, and what is left is rounding.
    """
    x, rest, directions, first = np.zeros(len(load)), load, [], None
    while len(directions) < most:
        p = precondition(rest)
        size = rest @ p
        first = size if first is None else first
        if not size > 0 or enough(x, rest, size / first):
            break
        # Conjugate to all earlier directions: to the last one alone, rounding would grow tenfold a
        # step, until directions repeat.
        for earlier, A_earlier, curvature in directions:
            p = p - A_earlier @ p / curvature * earlier
        Ap = product(p)
        directions.append((p, Ap, p @ Ap))
        length = p @ rest / (p @ Ap)
        x, rest = x + length * p, rest - length * Ap
    return x, rest, directions


class DualStep(ProductStep):
    """Landmarks alone: the dual equations `S y = r - D nu`, `S = 1 + D diag(W, B)^-1 D^T`, whose
    solution y is the residual that the step leaves.

    A matrix near S preconditions well at any gamma; one near `W + D^T D` does not, because that is
    large where D is not quite 0. learnt: about `D W^-1 D^T` at gamma = 1, (2 M, 2 M).
    """

    def __init__(self, objective, state, gamma):
        super().__init__(objective, state, gamma)
        if self.learnt is None:  # at the first state, from the mesh of nu
            D = objective.jacobian(state, 1.0)
            parts = np.ascontiguousarray(D.T).view(float)
            lifted = np.ascontiguousarray(objective.factors.solve(parts)).view(complex)
            self.learnt = (D.conj() @ lifted).real

    def propose(self, damping=0.0):
        """The `Change` by conjugate gradients; damping d adds `d (change^* W change)` to the model,
        and the same for the Möbius part."""
        share, weight = 1 / (1 + damping), MOBIUS_PRIOR + damping
        B = share * weight * np.eye(3)
        mobius_part = self.by_mobius @ self.by_mobius.T / weight
        constant = self.residual - share * self.forward(self.nu)

        def product(y):
            return y + self.forward(share * self.lift(self.adjoint(y), B))

        def enough(y, rest, _):
            # The dual problem's value at y is a lower bound of the model's least objective, which
            # the step of this y exceeds by `left` at most.
            least, left = y @ (constant + rest), rest @ rest
            gain = self.before - least
            small = gain < SMALL_GAIN * self.before or left <= FORCING * (gain - left)
            return small or self.objective.spent

        one = np.eye(len(constant))
        inverse = np.linalg.inv(one + share * self.gamma * self.learnt + mobius_part)
        y, rest, directions = conjugate_gradients(
            product, inverse.__matmul__, constant, DUAL_STEPS, enough
        )
        if directions:
            products = [(p, (Sp - p - mobius_part @ p) / share) for p, Sp, _ in directions]
            self.learnt = corrected(self.learnt, products, self.gamma)
        x = -share * (self.nu + self.lift(self.adjoint(y), B))
        promised = y @ (constant + rest) + rest @ rest
        return Change(x[:-3].view(complex), complex(x[-2], x[-1]), x[-3], promised)


def corrected(gram, products, gamma):
    """A matrix H (n, n) corrected (BFGS) to be exact in directions Y: `H - HY (Y^T HY)^-1 (HY)^T +
    AY (Y^T AY)^-1 (AY)^T`, from pairs of y (n,) and gamma A y, A the exact matrix."""
    one = np.eye(len(gram)) / gamma  # with it, as in S, nothing is singular
    Y, AY = (np.stack(side, axis=1) for side in zip(*products))
    # An orthonormal basis of the directions, of which many steps repeat some.
    sizes = np.linalg.norm(Y, axis=0)
    basis, parts, turned = np.linalg.svd(Y / sizes, full_matrices=False)
    kept = parts > INDEPENDENT * parts[0]
    basis, turned = basis[:, kept], (turned[kept] / parts[kept, None]).T
    # H and A, with `one` added, times this basis.
    HY, AY = (gram + one) @ basis, (AY / sizes @ turned + basis) / gamma
    old, new = (side @ np.linalg.solve(basis.T @ side, side.T) for side in (HY, AY))
    return gram - old + new


class CurvaturePairs(NamedTuple):
    """What a `PrimalStep` learns: directions y as columns, `H y` of its matrix H, and `y H y`."""

    Y: np.ndarray
    HY: np.ndarray
    curvatures: np.ndarray


class PrimalStep(ProductStep):
    """`(W + D^T D) x = -(W nu + D^T r)` with features or areas, x the change of nu and of the
    Möbius parameters, real.

    `P = diag(W, B) + D_L^T D_L`, by Woodbury's formula, preconditions it: each of the landmarks'
    rows D_L of a large gamma would else cost a step; B: the other terms' part on the Möbius
    parameters. learnt: the last step's `CurvaturePairs`.
    """

    def __init__(self, objective, state, gamma):
        super().__init__(objective, state, gamma)
        self.accuracy = ACCURACY if objective.area_term is None else ACCURACY_WITH_AREAS
        if len(state.points):
            self.accuracy /= max(1.0, np.log10(gamma) - 2)
        by_mobius = (self.rows_conj[len(self.by_mobius) :] @ self.fields).real
        self.B = MOBIUS_PRIOR * np.eye(3) + MOBIUS_SHARE * by_mobius.T @ by_mobius
        self.B += RELIEF * self.by_mobius.T @ self.by_mobius
        # Elsewhere than on nu's mesh the landmarks' gradients by nu are solved for once a level.
        for_gamma, by_nu = objective.by_nu
        if objective.on_nu_mesh or for_gamma != gamma:
            by_nu = np.ascontiguousarray(objective.jacobian(state, gamma)).view(float)
            objective.by_nu = gamma, by_nu
        self.D_L = np.hstack([by_nu, self.by_mobius])
        self.lifted = self.lift(self.D_L.T, self.B)
        self.S = np.linalg.inv(np.eye(len(self.D_L)) + self.D_L @ self.lifted)

    def product(self, x):
        """The equations' left side."""
        return self.prior(x) + self.adjoint(self.forward(x))

    def precondition(self, g):
        """`P^-1 g`, corrected (BFGS) to be exact in the last step's directions."""
        if self.learnt is not None:
            Y, HY, curvatures = self.learnt
            along = Y.T @ g / curvatures
            g = g - HY @ along
        x = self.lift(g, self.B)
        x = x - self.lifted @ (self.S @ (self.D_L @ x))
        return x if self.learnt is None else x + Y @ (along - HY.T @ x / curvatures)

    def propose(self):
        """The `Change` by conjugate gradients."""

        def enough(x, rest, size):
            return size <= self.accuracy**2 or (x.any() and self.objective.spent)

        load = -self.prior(self.nu) - self.adjoint(self.residual)
        x, rest, directions = conjugate_gradients(
            self.product, self.precondition, load, PRIMAL_STEPS, enough
        )
        if directions:
            self.learnt = CurvaturePairs(*(np.stack(part, axis=-1) for part in zip(*directions)))
        promised = self.before - x @ (load + rest)
        return Change(x[:-3].view(complex), complex(x[-2], x[-1]), x[-3], promised)


@dataclass(frozen=True, eq=False)
class State:
    """nu (N,) and Möbius parameters, and the map that they give.

    f (V,): M after the solver's map on the mapped mesh; points (M,): the mapped landmarks;
    solution: the solver with its factors; switched: how many rows the repair switched, in so many
    rounds; learnt: what the step to it learnt of its equations, a `DualStep`'s matrix or a
    `PrimalStep`'s `CurvaturePairs`; None at first.
    """

    nu: np.ndarray
    mobius: tuple
    f: np.ndarray
    points: np.ndarray
    solution: DiskSolver
    switched: int = 0
    rounds: int = 0
    learnt: np.ndarray | CurvaturePairs | None = None

    @cached_property
    def folded(self):
        """Whether rows were switched and faces stay flipped."""
        return self.switched > 0 and len(self.solution.disk.at(self.f).maybe_flipped) > 0


class GaussNewtonObjective:
    """The objective of a `Problem` on a `CoefficientMesh`, with `Weights` and maybe a `FeatureTerm`
    and an `AreaTerm`: `state = at(nu, mobius)`, `value(state, gamma)`, `step(state, gamma)`.

    on_nu_mesh: the polar mesh of nu is mapped itself, not the problem's disk or its proxy; there
    folds are not repaired. `work` counts what the steps cost and is bounded on the other two.
    """

    def __init__(
        self, problem, coefficient_mesh, weights, on_nu_mesh, feature_term=None, area_term=None
    ):
        self.problem, self.weights, self.on_nu_mesh = problem, weights, on_nu_mesh
        self.coefficient_mesh = mesh = coefficient_mesh
        self.feature_term, self.area_term = feature_term, area_term
        self.terms = [term for term in (feature_term, area_term) if term is not None]
        self.samples = mesh.disk.interpolation(problem.moving)
        self.polar_samples = self.samples if on_nu_mesh else mesh.mesh.interpolation(problem.moving)
        self.landmarks = LandmarkTerm(problem.target, problem.curve, problem.sliding)
        self.mass = mesh.mass
        if area_term is not None:
            # `S^T diag(w) S`, S from nu's mesh to the moving vertices, w their shares of the moving
            # surface's area.
            moving = problem.pair.moving
            S = mesh.mesh.interpolation(moving.disk.z)
            self.mass = (S.T @ sparse.diags_array(moving.vertex_shares) @ S).tocsc()
        self.W = weights.alpha * self.mass + weights.beta * mesh.laplace
        self.factors = factorise(self.W)
        self.work, self.most_work = 0.0, np.inf
        self.last = None, None, None  # map, gamma and residual
        self.by_nu = None, None  # gamma, and gradients that precondition a `PrimalStep`
        if not on_nu_mesh:
            gamma = weights.gamma if len(problem.moving) else LOW_GAMMA
            self.most_work = MOST_WORK * max(gamma / LOW_GAMMA, 1.0) ** GROWTH

    @property
    def spent(self):
        """Whether the steps on this mesh have taken all the work that they may."""
        return self.work > self.most_work

    def at(self, nu, parameters):
        """The state with nu (N,) and Möbius parameters (a, theta): one solve."""
        state = self.state(nu, parameters, self.coefficient_mesh.solution(nu))
        self.work += 1 + REPAIR_WORK * state.rounds
        return state

    def aligned(self, state):
        """The state with the same nu and the Möbius map that then fits the landmarks best: no
        solve."""
        best = best_mobius(self.samples @ state.solution.f, self.problem.target)
        return self.state(state.nu, best, state.solution)

    def at_mobius(self, parameters):
        """The state with nu = 0 and the Möbius map itself at each vertex, repaired where it folds
        triangles."""
        solution = copy(self.coefficient_mesh.solver)
        solution.mu, solution.floored = np.zeros(len(solution.disk.faces), complex), 0
        f = mobius(solution.disk.z, *parameters)
        f[solution.loop] /= abs(f[solution.loop])
        nu = np.zeros(len(self.coefficient_mesh.mesh.z), complex)
        return self.state(nu, parameters, solution, f)

    def state(self, nu, parameters, solution, f=None):
        """The `State` of the solver's map of nu and the Möbius map after it, or of a map f (V,) in
        the place of both, repaired where it folds a mesh that is not that of nu."""
        switched, rounds = (), 0
        if f is None:
            f = mobius(solution.f, *parameters)
        if not self.on_nu_mesh:
            f, switched, rounds = unfold(solution, f)
        return State(nu, parameters, f, self.samples @ f, solution, len(switched), rounds)

    def prior(self, nu):
        return (nu.conj() @ (self.W @ nu)).real

    def residual(self, state, gamma):
        """All residuals of a state: of the landmarks, and of the terms over the whole surface. Kept
        for the last map, of which several ask."""
        f, weight, residual = self.last
        if f is not state.f or weight != gamma:
            landmarks = self.landmarks.residual(state.points, gamma)
            residual = np.concatenate([landmarks, *(term.residual(state.f) for term in self.terms)])
            self.last = state.f, gamma, residual
        return residual

    def value(self, state, gamma):
        """The objective at a state."""
        return self.prior(state.nu) + (self.residual(state, gamma) ** 2).sum()

    def moved(self, state):
        """Where the moving vertices lie after a state's map, (V,)."""
        disk = self.coefficient_mesh.disk
        return disk.interpolate(state.f, disk.locate(self.problem.disk.z))

    def error(self, state):
        """Mean distance of a state's landmarks from their targets."""
        return abs(state.points - self.problem.target).mean()

    def jacobian(self, state, gamma):
        """Gradients of the landmarks' residual by nu, complex (2 M, N), by adjoint solves on the
        mesh of nu: the exact ones there, and elsewhere near enough to precondition with."""
        on_polar, solution = self.coefficient_mesh, state.solution
        if not self.on_nu_mesh:
            on_polar = on_itself(on_polar.mesh)
            solution = on_polar.solution(state.nu)
        gradients = on_polar.gradients(state.nu, solution, self.polar_samples, state.mobius)
        return self.landmarks.components(*gradients, gamma)

    def linearise(self, state, gamma):
        """The quadratic model at a state, ready to `propose` a `Change`."""
        return (PrimalStep if self.terms else DualStep)(self, state, gamma)

    def step(self, state, gamma, min_predicted_decrease=0.0):
        """The state after one step; None where none lowers the objective or the model promises less
        than that share of it.

        A share s of the Gauss-Newton step is taken once it reaches a sufficient part of the model's
        gain `(2s - s^2)` of that of the full step; if none does, the best of these and, with
        landmarks alone, of some damped steps.
        """
        before = self.value(state, gamma)
        linearised = self.linearise(state, gamma)
        full = linearised.propose()
        gain = before - full.promised
        if gain < min_predicted_decrease * before:
            return None
        tried = []  # (objective, state)

        def attempt(change, share=1.0):
            nu = state.nu + share * change.nu
            after = self.at(
                nu, compose_mobius(state.mobius, (share * change.da, share * change.dtheta))
            )
            # A map that folds may not follow one that does not.
            new_fold = after.folded and not state.folded
            tried.append((np.inf if new_fold else self.value(after, gamma), after))
            return tried[-1]

        for share in SHARES:
            value, after = attempt(full, share)
            if before - value > SUFFICIENT_DECREASE * (2 * share - share**2) * gain:
                return replace(after, learnt=linearised.learnt)
            if self.spent:
                break
        # The line search has failed. With terms over the surface each damped step would solve large
        # equations anew.
        if not (self.terms or self.spent):
            damped = (linearised.propose(damping) for damping in DAMPINGS)
            short = (change for change in damped if abs(change.nu).max() <= TRUST)
            for change in islice(short, TRIES):
                attempt(change)
                if self.spent:
                    break
        value, best = min(tried, key=itemgetter(0))
        return replace(best, learnt=linearised.learnt) if value < before else None
