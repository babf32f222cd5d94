"""The Gauss-Newton engine of the landmark fit: a problem, a mesh that carries nu, and states that steps lead on from.

Unknowns: a complex field nu at the vertices of a graded polar mesh, `mu = T(nu) = tanh(|nu|) nu / |nu|` on faces, and
a disk Möbius map M after the solver's f. Objective, to second order the paper's `L_CP`:
    `nu^* W nu + gamma mean |M(f(p)) - q|^2`,   `W = (alpha mass + beta Laplace) / pi`.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from operator import itemgetter

import numpy as np
from scipy import sparse

from ..plane.beltrami import face_mean, factorise, stiffness
from ..plane.bijectivity import flipped_faces
from ..plane.disk import BeltramiDiskSolver, unfold
from ..plane.diskmesh import sampling_matrix
from ..plane.fields import bounded, bounded_pullback, mass_matrix
from ..plane.mobius import compose_mobius, mobius, mobius_fields, mobius_slope
from ..plane.tangent import Tangent
from .certified import solver_words
from .landmarkterm import Landmarks
from .normal import MOBIUS_PRIOR, DualEquations, NormalEquations

SHARES = (1.0, 0.5, 0.25, 0.125)  # of a step, tried in turn by the line search
SUFFICIENT_DECREASE = 0.3  # share of what the quadratic model promises that a step has to gain
LANDMARKS_AT_ONCE = 16  # bounds the memory of the adjoint solves
DAMPINGS = 10.0 ** np.arange(-1, 10)  # of the steps that are tried where the line search fails, in parts of W
TRUST, TRIES = 0.3, 4  # the largest change of nu in a damped step, and how many of them are tried
INDEPENDENT = 1e-6  # singular values of the directions learnt from, in parts of the largest


@dataclass(frozen=True, eq=False)
class State:
    """One place of a fit: nu (N,) and the Möbius parameters, and the map that they give.

    f (V,): M after the solver's map at every vertex of the mapped mesh; points (M,): the mapped landmarks; solution:
    the solver that found it, with its factors, for the adjoint; switched: rows that were, so that f does not fold.
    """

    nu: np.ndarray
    mobius: tuple
    f: np.ndarray
    points: np.ndarray
    solution: BeltramiDiskSolver
    switched: int = 0

    @property
    def words(self):
        """What this map needed to stay one, in words, empty if nothing."""
        return solver_words(self.solution, self.switched)

    @cached_property
    def folded(self):
        """Whether rows were switched and faces stay flipped."""
        return self.switched > 0 and len(flipped_faces(self.solution.faces, self.f)) > 0


class GaussNewton:
    """The fit of a `Problem` with `Weights` on a polar mesh (z, faces) that carries nu and is mapped; W factored once.

    `at(nu, mobius)` is the state there, `step(state, gamma)` the next one, or None where no step lowers the objective.
    """

    def __init__(self, problem, mesh, weights, dense=None):
        (self.z, self.faces), self.problem, self.dense = mesh, problem, dense
        self.landmarks = Landmarks(problem.target, problem.curve, problem.sliding)
        flat = np.zeros(len(self.faces))
        self.mass, self.laplace = mass_matrix(*mesh) / np.pi, stiffness(*mesh, flat) / np.pi
        self.weigh(weights)
        self.solver, self.to_faces, self.samples = self.mapping()
        _ = self.solver.calibration  # cached, so that the copies in the states need not find it again

    def weigh(self, weights):
        self.weights, self.W = weights, weights.alpha * self.mass + weights.beta * self.laplace
        self.factors = factorise(self.W)
        self.known_gram = self.known_directions = None  # of the last linearisation

    def weighed(self, weights):
        """The engine of the same problem with other weights, which has learnt nothing yet."""
        other = copy(self)
        other.weigh(weights)
        return other

    def mapping(self):
        """The solver on the mapped mesh, and the sparse matrices from nu to its faces and from its map to landmarks."""
        mesh = self.z, self.faces
        return (
            BeltramiDiskSolver(*mesh),
            face_mean(self.faces, len(self.z)),
            sampling_matrix(*mesh, self.problem.moving),
        )

    def at(self, nu, parameters):
        """The state with nodal nu (N,) and Möbius parameters (a, theta): one solve."""
        solution = copy(self.solver)
        solution.solve(bounded(self.to_faces @ nu))
        return self.finished(nu, parameters, solution, mobius(solution.f, *parameters))

    def moved(self, state, parameters):
        """The state with the same nu and other Möbius parameters: no solve."""
        return self.finished(state.nu, parameters, state.solution, mobius(state.solution.f, *parameters))

    def finished(self, nu, parameters, solution, f):
        return State(nu, parameters, f, self.samples @ f, solution)

    def prior(self, nu):
        return (nu.conj() @ (self.W @ nu)).real

    def mismatch(self, points, gamma):
        return (self.landmarks.residual(points, gamma) ** 2).sum()

    def residual(self, state, gamma):
        """All residuals of a state: of the landmarks, and of the features if there are any."""
        landmarks = self.landmarks.residual(state.points, gamma)
        return landmarks if self.dense is None else np.concatenate([landmarks, self.dense.residual(state.f)])

    def objective(self, state, gamma):
        return self.prior(state.nu) + (self.residual(state, gamma) ** 2).sum()

    def merit(self, found, state, gamma):
        """The objective of a state that may follow another; infinite where its map folds and that one's does not."""
        return np.inf if found.folded and not state.folded else self.objective(found, gamma)

    def error(self, state):
        """Mean distance of a state's landmarks from their targets."""
        return self.landmarks.error(state.points)

    def jacobian(self, state, gamma):
        """Gradients of the residual's components with respect to nu, complex (2 M, N), by adjoint solves."""
        return self.landmarks.jacobian(*self.gradients(state), gamma)

    def quick_jacobian(self, state, gamma):
        """The same, or what is near enough to precondition with: on a polar mesh solves cost little."""
        return self.jacobian(state, gamma)

    def gradients(self, state):
        """Gradients of Re w and Im w of the mapped landmarks with respect to nu, complex (M, N) each."""
        solution, slope = state.solution, mobius_slope(state.solution.f, *state.mobius)
        parts, points = (
            [np.zeros((2, 0, len(state.nu)), complex)],
            (self.samples @ sparse.diags_array(slope.conj())).tocsr(),
        )
        chains = [self.chain(state, by_mu) for by_mu in solution.sensitivities]
        for rows in range(0, points.shape[0], LANDMARKS_AT_ONCE):
            adjoints = solution.adjoints(points[rows : rows + LANDMARKS_AT_ONCE])
            real, imaginary = np.split(sum(chain @ adjoint for chain, adjoint in zip(chains, adjoints)), 2)
            parts.append((real + 1j * imaginary).T.reshape(2, -1, len(state.nu)))
        return np.concatenate(parts, axis=1)

    def chain(self, state, sensitivity):
        """Sparse real (2 N, V): from an adjoint of a potential to the gradient with respect to nu, Re above Im.

        In one product what would otherwise take a dense array of faces by landmarks.
        """
        by_mu = sensitivity.tocoo()
        data = bounded_pullback((self.to_faces @ state.nu)[by_mu.row], by_mu.data)
        chain = self.to_faces.T.tocsr() @ sparse.csr_array((data, (by_mu.row, by_mu.col)), shape=by_mu.shape)
        return sparse.vstack([chain.real, chain.imag]).tocsr()

    def mobius_columns(self, state):
        """Changes of the mapped landmarks (M, 3) with a Möbius increment (theta, Re a, Im a) after the map."""
        return self.samples @ mobius_fields(state.f)

    def linearise(self, state, gamma):
        """The linearisation at a state: returns `propose(state, damping)`, which may be asked again at later states.

        Of landmarks alone on a polar mesh, whose Jacobian costs little; with features that of `NormalEquations`.
        It gives (change of nu, da, dtheta, least objective of the model). damping adds `damping (change^* W change)` to
        what is minimised (Levenberg), and its like for the Möbius part: a shorter step, turned towards the steepest
        descent.
        """
        if self.dense is not None:
            return NormalEquations(self, state, gamma).propose
        J = self.jacobian(state, gamma)
        Jm = self.landmarks.components(self.mobius_columns(state), gamma)
        lifted = self.factors.solve(np.ascontiguousarray(J.real.T)) + 1j * self.factors.solve(
            np.ascontiguousarray(J.imag.T)
        )
        gram = (J.conj() @ lifted).real

        def propose(state, damping=0.0):
            share, weight = 1 / (1 + damping), MOBIUS_PRIOR + damping
            S = np.eye(len(J)) + share * gram + Jm @ Jm.T / weight
            constant = self.landmarks.residual(state.points, gamma) - share * (J.conj() @ state.nu).real
            y = np.linalg.solve(S, constant)  # undamped, the model's least objective is constant . y
            turn, real, imaginary = -Jm.T @ y / weight
            return -share * (lifted @ y + state.nu), complex(real, imaginary), turn, constant @ y

        return propose

    def step(self, state, gamma, worth=0.0):
        """The state after one step, or None where none lowers the objective, or the model promises less than the share
        `worth` of it.

        A share s of the Gauss-Newton step is taken once it brings a sufficient part of what the quadratic model
        promises, `(2s - s^2)` of the full step's gain. Where the map is too far from linear in nu for that, the best of
        these and, with landmarks alone, of some damped steps. None leads from an unfolded map to a folded one.
        """
        before, propose = self.objective(state, gamma), self.linearise(state, gamma)
        *whole, promised = propose(state)
        if before - promised < worth * before:
            return None
        tried = []  # (objective, state)
        for share in SHARES:
            found = self.after(state, *(share * part for part in whole))
            tried.append((self.merit(found, state, gamma), found))
            if before - tried[-1][0] > SUFFICIENT_DECREASE * (2 * share - share**2) * (before - promised):
                return found
        if self.dense is None:  # with features, each would mean to solve large equations anew
            damped = (self.after(state, *change) for change in self.damped(state, propose))
            tried += [(self.merit(found, state, gamma), found) for found in damped]
        least, best = min(tried, key=itemgetter(0))
        return best if least < before else None

    def after(self, state, change, da, dtheta):
        """The state after a change of nu and of the Möbius parameters."""
        return self.at(state.nu + change, compose_mobius(state.mobius, (da, dtheta)))

    def damped(self, state, propose):
        """Levenberg steps, from the least damping that keeps nu where the linearisation can be trusted: which that is
        costs no map to find out."""
        steps = (propose(state, damping)[:-1] for damping in DAMPINGS)
        return islice((step for step in steps if abs(step[0]).max() <= TRUST), TRIES)


class SurfaceGaussNewton(GaussNewton):
    """The same with the problem's own disk mesh mapped: where a face is flipped, rows are switched, solved again."""

    def mapping(self):
        z, faces = self.problem.z, self.problem.faces
        to_faces = sampling_matrix(self.z, self.faces, z[faces].mean(1))
        return BeltramiDiskSolver(z, faces), to_faces, self.problem.samples

    def finished(self, nu, parameters, solution, f):
        f, rows = unfold(solution, f)
        return State(nu, parameters, f, self.samples @ f, solution, len(rows))

    def linearise(self, state, gamma):
        """The linearisation at a state, as on a polar mesh, but without a Jacobian: `propose` of equations."""
        return (DualEquations if self.dense is None else NormalEquations)(self, state, gamma).propose

    def gram(self, state, gamma):
        """About `J W^-1 J^T`, (2 M, 2 M): of quick rows J at the first state, and what was learnt."""
        if self.known_gram is None:
            J = self.quick_jacobian(state, 1.0)
            lifted = self.factors.solve(np.ascontiguousarray(J.T).view(float).reshape(len(state.nu), -1))
            self.known_gram = (J.conj() @ np.ascontiguousarray(lifted).view(complex)).real
        return gamma * self.known_gram

    def learn(self, products, gamma):
        """Correct `gram` by pairs of y (2 M,) and its exact product with y, as Broyden, Fletcher, Goldfarb and Shanno
        do."""
        if products:
            one = np.eye(len(self.known_gram)) / gamma  # with it, as in S, nothing is singular
            Y, exact = (np.stack(side, axis=1) for side in zip(*products))
            sizes = np.linalg.norm(Y, axis=0)
            Y, parts, turned = np.linalg.svd(Y / sizes, full_matrices=False)
            whole = parts > INDEPENDENT * parts[0]  # many steps repeat their directions
            Y, turned = Y[:, whole], (turned[whole] / parts[whole, None]).T
            known, exact = (self.known_gram + one) @ Y, (exact / sizes @ turned + Y) / gamma
            old, new = (side @ np.linalg.solve(Y.T @ side, side.T) for side in (known, exact))
            self.known_gram = self.known_gram - old + new

    def quick_jacobian(self, state, gamma):
        """The Jacobian in closed form: a few percent off, and without a solve, whatever the size of the mesh."""
        real, imaginary = self.tangent.gradients(state.nu, state.solution.f)
        slope = (self.samples @ mobius_slope(state.solution.f, *state.mobius))[:, None]
        turned = slope.real * real - slope.imag * imaginary, slope.imag * real + slope.real * imaginary
        return self.landmarks.jacobian(*turned, gamma)

    @cached_property
    def tangent(self):
        """The closed form of the derivative at the landmarks."""
        return Tangent(self.solver, (self.z, self.faces), self.samples)

    def mobius_alone(self, parameters):
        """The state with nu = 0 whose map is the Möbius map at every vertex itself, mended where it folds triangles."""
        solution = copy(self.solver)
        solution.mu, solution.floored = np.zeros(len(solution.faces), complex), 0
        f = mobius(solution.z, *parameters)
        f[solution.loop] /= abs(f[solution.loop])
        return self.finished(np.zeros(len(self.z), complex), parameters, solution, f)
