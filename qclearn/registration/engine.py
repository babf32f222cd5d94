"""The Gauss-Newton engine of every fit: states of a problem on a mesh that carries nu, and steps between them.

Unknowns: a complex field nu at the vertices of a polar mesh, `mu = T(nu) = tanh(|nu|) nu / |nu|` on faces, and a disk
Möbius map M after the solver's f. Objective, to second order the paper's `L_CP`:
    `nu^* W nu + gamma mean |M(f(p)) - q|^2 + delta (the features' mismatch) + eta mean (log J)^2`,
    `W = alpha A + beta Laplace / pi`, A the mass over pi or, with eta > 0, by shares of the moving surface's area.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice
from operator import itemgetter

import numpy as np
from scipy import sparse

from ..plane.bijectivity import unfold
from ..plane.coefficients import bounded_pullback
from ..plane.linear import factorise
from ..plane.mobius import compose_mobius, mobius, mobius_slope
from ..plane.solver import DiskSolver
from ..plane.tangent import Tangent
from .steps import DirectStep, DualStep, PrimalStep
from .terms import LandmarkTerm

SHARES = (1.0, 0.5, 0.25, 0.125)  # of a step, tried in turn by the line search
SUFFICIENT_DECREASE = 0.3  # share of what the quadratic model promises that a step has to gain
LANDMARKS_AT_ONCE = 16  # bounds the memory of the adjoint solves
DAMPINGS = 10.0 ** np.arange(-1, 10)  # of the steps that are tried where the line search fails, in parts of W
TRUST, TRIES = 0.3, 4  # the largest change of nu in a damped step, and how many of them are tried
# Work in parts of one exact map, and how much of it one level on the problem's own mesh may take: up to LOW_GAMMA, and
# growing by the power GROWTH above. The slowest of 60 good problems (book/studies/effort.py) took 8, 30, 94, 164 and
# 290 at gamma = 1e3, 1e5, 1e6, 1e7 and 1e8, with folds 70.
REPAIR = 1.4
MOST_WORK, LOW_GAMMA, GROWTH = 120.0, 1e5, 0.25


@dataclass(frozen=True, eq=False)
class State:
    """nu (N,) and Möbius parameters, and the map that they give.

    f (V,): M after the solver's map on the mapped mesh; points (M,): the mapped landmarks; solution: the solver with
    its factors; switched: how many rows were; learnt: what earlier steps know of the linearisation (steps.py).
    """

    nu: np.ndarray
    mobius: tuple
    f: np.ndarray
    points: np.ndarray
    solution: DiskSolver
    switched: int = 0
    learnt: object = None

    @cached_property
    def folded(self):
        """Whether rows were switched and faces stay flipped."""
        return self.switched > 0 and len(self.solution.disk.at(self.f).flipped) > 0


class Setting:
    """What no weight changes of a `Problem` on a `Link`; own: the problem's disk is mapped, not the polar mesh."""

    def __init__(self, problem, link, own):
        self.problem, self.link, self.own = problem, link, own
        self.samples = problem.samples if self.own else link.disk.sampling(problem.moving)
        self.landmarks = LandmarkTerm(problem.target, problem.curve, problem.sliding)

    @cached_property
    def mass_by_area(self):
        """`S^T diag(w) S`, S from nu's mesh to the moving vertices, w their shares of the moving surface's area."""
        moving = self.problem.sides.moving
        S = self.link.mesh.sampling(moving.disk.z)
        return (S.T @ sparse.diags_array(moving.surface.vertex_areas / moving.surface.area) @ S).tocsc()

    @cached_property
    def shares(self):
        """Sparse (F, G): the G moving faces' shares of their area, in the F faces of the mapped mesh that hold them."""
        moving = self.problem.sides.moving
        shares, count = moving.surface.face_areas / moving.surface.area, len(self.link.disk.faces)
        inside = np.arange(count) if self.link.disk is moving.disk else self.link.disk.locate(moving.disk.centroids)[0]
        return sparse.csr_array((shares, (inside, np.arange(len(shares)))), shape=(count, len(shares)))

    def by_area(self, values):
        """The moving area's shares (F,) in the mapped faces, and means (F,) there of values (V,) of its vertices."""
        shares = self.shares.sum(1)
        sums = self.shares @ values[self.problem.sides.moving.disk.faces].mean(1)
        return shares, np.divide(sums, shares, out=np.zeros(len(sums)), where=shares > 0)

    @cached_property
    def tangent(self):
        """The derivative at the landmarks in closed form."""
        return Tangent(self.link.solver, self.link.mesh, self.samples, self.link.carrier)


class Engine:
    """The fit of a `Setting` with `Weights`, maybe a `FeatureTerm` and an `AreaTerm`: `at(nu, mobius)`, `step(state)`.

    closed: take the derivative by nu in closed form, a few percent off and without a solve, to precondition exact
    products; else from adjoint solves, which cost little on a polar mesh. Rows are switched where a face of the
    problem's own mesh is flipped.
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

    def moved(self, state, parameters):
        """The state with the same nu and other Möbius parameters: no solve."""
        return self.finished(state.nu, parameters, state.solution, mobius(state.solution.f, *parameters))

    def mobius_alone(self, parameters):
        """The state with nu = 0 and the Möbius map itself at each vertex, mended where it folds triangles."""
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
        """The objective of a state that may follow another; infinite where its map folds and that one's does not."""
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
        turned = slope.real * real - slope.imag * imaginary, slope.imag * real + slope.real * imaginary
        return self.landmarks.jacobian(*turned, gamma)

    def gradients(self, state):
        """Exact gradients of Re w and Im w of the mapped landmarks by nu, complex (M, N) each."""
        solution, slope = state.solution, mobius_slope(state.solution.f, *state.mobius)
        parts = [np.zeros((2, 0, len(state.nu)), complex)]
        points = (self.samples @ sparse.diags_array(slope.conj())).tocsr()
        chains = [self.chain(state, by_mu) for by_mu in solution.sensitivities]
        for rows in range(0, points.shape[0], LANDMARKS_AT_ONCE):
            adjoints = solution.adjoints(points[rows : rows + LANDMARKS_AT_ONCE])
            real, imaginary = np.split(sum(chain @ adjoint for chain, adjoint in zip(chains, adjoints)), 2)
            parts.append((real + 1j * imaginary).T.reshape(2, -1, len(state.nu)))
        return np.concatenate(parts, axis=1)

    def chain(self, state, sensitivity):
        """Sparse real (2 N, V): an adjoint of a potential to the gradient by nu, Re above Im, without a dense array."""
        by_mu, to_faces = sensitivity.tocoo(), self.link.to_faces
        data = bounded_pullback((to_faces @ state.nu)[by_mu.row], by_mu.data)
        chain = to_faces.T.tocsr() @ sparse.csr_array((data, (by_mu.row, by_mu.col)), shape=by_mu.shape)
        return sparse.vstack([chain.real, chain.imag]).tocsr()

    def linearise(self, state, gamma):
        """The linearisation of steps.py at a state."""
        kind = DualStep if self.setting.own else DirectStep
        return (PrimalStep if self.terms else kind)(self, state, gamma)

    def step(self, state, gamma, worth=0.0):
        """The state after one step; None where none lowers the objective or the model promises less than `worth` of it.

        A share s of the Gauss-Newton step is taken once it brings a sufficient part of the model's `(2s - s^2)` of the
        full step's gain; if none does, the best of these and, with landmarks alone, of some damped steps.
        """
        before, linearised = self.objective(state, gamma), self.linearise(state, gamma)
        *whole, promised = linearised.propose()
        if before - promised < worth * before:
            return None
        tried = []  # (objective, state)
        for share in SHARES:
            found = self.after(state, *(share * part for part in whole))
            tried.append((self.merit(found, state, gamma), found))
            if before - tried[-1][0] > SUFFICIENT_DECREASE * (2 * share - share**2) * (before - promised):
                return replace(found, learnt=linearised.learnt)
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
        return replace(best, learnt=linearised.learnt) if least < before else None

    def after(self, state, change, da, dtheta):
        """The state after a change of nu and of the Möbius parameters."""
        return self.at(state.nu + change, compose_mobius(state.mobius, (da, dtheta)))


def damped_changes(linearised):
    """Levenberg steps from the least damping that changes nu by at most TRUST, found without a map."""
    steps = (linearised.propose(damping)[:-1] for damping in DAMPINGS)
    return islice((step for step in steps if abs(step[0]).max() <= TRUST), TRIES)
