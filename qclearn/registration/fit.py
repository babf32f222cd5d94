"""The best quasi-conformal map for given landmarks, without a network: Gauss-Newton on nodal coefficients.

Unknowns: a complex field nu at the vertices of a graded polar mesh, `mu = T(nu) = tanh(|nu|) nu / |nu|` on faces, and
a disk Möbius map M after the solver's f. Objective, to second order the paper's `L_CP`:
    `nu^* W nu + gamma mean |M(f(p)) - q|^2`,   `W = (alpha mass + beta Laplace) / pi`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np
from jaxtyping import Complex, Integer
from numpy import ndarray
from scipy import sparse
from threadpoolctl import threadpool_limits

from ..plane.beltrami import (
    BeltramiError,
    assemble,
    beltrami_coefficient,
    check_coefficient,
    check_mesh,
    complex_numbers,
    face_mean,
    factorise,
    signed_areas,
    stiffness,
)
from ..plane.bijectivity import check_bijective
from ..plane.disk import BeltramiDiskSolver, unfold
from ..plane.diskmesh import locate, polar_disk
from ..plane.mobius import best_mobius, compose_mobius, mobius, mobius_slope

FIRST_GAMMA = 1e2  # continuation: one step at each power of ten from here to gamma
STEPS_AT_GAMMA = 5
LINEARISATIONS, CHORDS = 12, 1  # at most, on the caller's mesh: each serves a step and so many more
SHARES, FAIR = (1.0, 0.5, 0.25, 0.125), 0.3  # of a damped step
FEWEST_RINGS = 4  # of the polar mesh; half of them on the coarse one
SETTLED_ON_GRID, SETTLED = 0.8, 0.92  # a step that keeps more than this share of the objective is the last one
TANGENTIAL_WEIGHT = 0.1  # of a sliding landmark's residual along its target curve
LANDMARKS_AT_ONCE = 16  # bounds the memory of the adjoint solves
LARGEST = 1 - 1e-10  # of |mu|: tanh rounds to 1 from 19 on, where a step that is too long may lead
DAMPINGS = 10.0 ** np.arange(-1, 10)  # of the steps of a fit that is taken up again, in parts of W
TRUST, TRIES = 0.3, 4  # the largest change of nu in such a step, and how many of them are tried
ROUNDING = 1e-9  # by which an objective may exceed another and count as equal
MOBIUS_PRIOR = 1e-6  # weak, keeps the step of the three Möbius parameters bounded


class LandmarkError(ValueError):
    """Landmarks that cannot be fitted: says which, where and what to do."""


@dataclass(frozen=True)
class LandmarkFit:
    """Result of `fit_landmarks`.

    f (V,): the map, Möbius part included; mu (F,): its measured coefficient; mobius: (a, theta); landmark_error: mean
    |f(p) - q|; bijective, flipped: its certificate; steps: Gauss-Newton steps on the polar mesh and on the given one;
    losses: L_mu, L_grad_mu, L_Landmark, L_CP of the coefficient field; fallbacks: words, empty if none was needed.
    """

    f: Complex[ndarray, " V"]
    mu: Complex[ndarray, " F"]
    mobius: tuple
    landmark_error: float
    bijective: bool
    flipped: Integer[ndarray, " k"]
    steps: tuple
    losses: dict
    fallbacks: tuple


def bounded(nu):
    """The paper's activation `T(nu) = tanh(|nu|) nu / |nu|`: any complex field becomes one with |mu| < 1."""
    size = abs(nu)
    return np.divide(np.minimum(np.tanh(size), LARGEST), size, out=np.ones_like(size), where=size > 0) * nu


def unbounded(mu):
    """Inverse of `bounded`: `artanh(|mu|) mu / |mu|`."""
    size = abs(mu)
    return np.divide(np.arctanh(size), size, out=np.ones_like(size), where=size > 0) * mu


def bounded_pullback(nu, grad_mu):
    """Gradient with respect to nu of a loss whose gradient with respect to mu = T(nu) is grad_mu."""
    size = abs(nu)
    across = np.divide(np.tanh(size), size, out=np.ones_like(size), where=size > 0)
    along = 1 - np.tanh(size) ** 2
    direction = np.divide(nu, size, out=np.ones_like(nu), where=size > 0)
    return 0.5 * ((along + across) * grad_mu + (along - across) * direction**2 * np.conj(grad_mu))


def sampling_matrix(z, faces, points):
    """The sparse real matrix (P, V) that evaluates a piecewise linear function of the disk mesh at points (P,)."""
    face, weights = locate(z, faces, points)
    rows = np.repeat(np.arange(len(weights)), 3)
    return sparse.csr_array((weights.ravel(), (rows, np.asarray(faces)[face].ravel())), shape=(len(weights), len(z)))


class Landmarks:
    """The scaled residual of mapped landmarks, as points or sliding along their target curves.

    Residual of one landmark: `sqrt(gamma / M) conj(t) (w - q)`, real part along the target's tangent t (weighted down
    where it slides), imaginary part across it.
    """

    def __init__(self, target, curve, sliding):
        self.target, self.tangent = target, np.ones(len(target), complex)
        self.weights = np.ones((2, len(target)))
        if sliding:
            for label in np.unique(curve):
                on = np.flatnonzero(curve == label)
                inner = on[1:-1]
                along = target[on[2:]] - target[on[:-2]]
                self.tangent[inner] = along / abs(along)
                self.weights[0, inner] = TANGENTIAL_WEIGHT

    def components(self, change, gamma):
        """Complex changes of the points (M, ...) as scaled residual components (2 M, ...)."""
        shape = (-1,) + (1,) * (change.ndim - 1)
        turned = self.tangent.conj().reshape(shape) * change
        along, across = (self.weights[k].reshape(shape) for k in (0, 1))
        return np.sqrt(gamma / len(self.target)) * np.concatenate([along * turned.real, across * turned.imag])

    def error(self, w):
        """Mean distance of mapped points w (M,) from their targets."""
        return abs(w - self.target).mean()

    def jacobian(self, grad_re, grad_im, gamma):
        """Gradients of the components (2 M, n) from those of Re w and Im w, (M, n)."""
        turn = self.tangent.conj()[:, None]
        along, across = self.weights[0][:, None], self.weights[1][:, None]
        return np.sqrt(gamma / len(self.target)) * np.concatenate(
            [along * (turn.real * grad_re - turn.imag * grad_im), across * (turn.imag * grad_re + turn.real * grad_im)]
        )


class Forward:
    """Landmarks seen through one disk mesh: nodal nu on the polar mesh -> mapped points, with the adjoint."""

    def __init__(self, z, faces, points, to_faces):
        self.z, self.faces, self.to_faces = z, faces, to_faces
        self.solver, self.nu = BeltramiDiskSolver(z, faces), None
        self.evaluate = sampling_matrix(z, faces, points)

    def map(self, nu, parameters):
        """M after f at every vertex, (V,); the mapped landmarks stay in `points`."""
        if nu is not self.nu:  # the last map of a step is the first of the next, with no need to solve it again
            self.nu, self.f = nu, self.solver.solve(bounded(self.to_faces @ nu))
        self.slope = mobius_slope(self.f, *parameters)
        self.mapped = self.finish(mobius(self.f, *parameters))
        self.points = self.evaluate @ self.mapped
        return self.mapped

    def finish(self, f):
        return f

    def gradients(self, nu):
        """Gradients of Re w and Im w of the mapped landmarks with respect to nu at the last map, complex (M, n) each."""
        parts, points = [], (self.evaluate @ sparse.diags_array(self.slope.conj())).tocsr()
        chains = [self.chain(self.to_faces @ nu, x) for x in self.solver.parts]
        for rows in range(0, points.shape[0], LANDMARKS_AT_ONCE):
            adjoints = self.solver.adjoints(points[rows : rows + LANDMARKS_AT_ONCE])
            real, imaginary = np.split(sum(chain @ adjoint for chain, adjoint in zip(chains, adjoints)), 2)
            parts.append((real + 1j * imaginary).T.reshape(2, -1, len(nu)))
        return np.concatenate(parts, axis=1)

    def chain(self, nu_faces, x):
        """Sparse real (2 N, V): from an adjoint of the potential x to the gradient with respect to nu, Re above Im.

        In one product what would otherwise take a dense array of faces by landmarks.
        """
        by_mu = self.solver.sensitivity(x).tocoo()
        data = bounded_pullback(nu_faces[by_mu.row], by_mu.data)
        chain = self.to_faces.T.tocsr() @ sparse.csr_array((data, (by_mu.row, by_mu.col)), shape=by_mu.shape)
        return sparse.vstack([chain.real, chain.imag]).tocsr()

    def mobius_columns(self):
        """Changes of the mapped landmarks (M, 3) with a Möbius increment (theta, Re a, Im a) after the last map.

        As a composition: `dw = i w dtheta - da + conj(da) w^2`.
        """
        w = self.mapped
        return self.evaluate @ np.stack([1j * w, w**2 - 1, -1j * (1 + w**2)], axis=1)


class MeshForward(Forward):
    """The same on the caller's mesh, finished: where a face is flipped, rows are switched and the map solved again."""

    switched = 0

    def plain(self, parameters):
        """The Möbius map alone at every vertex, (V,), mended where it folds triangles; its landmarks in `points`."""
        self.nu, self.solver.mu, self.solver.floored = None, np.zeros(len(self.faces), complex), 0
        f = mobius(self.z, *parameters)
        f[self.solver.loop] /= abs(f[self.solver.loop])
        self.mapped = self.finish(f)
        self.points = self.evaluate @ self.mapped
        return self.mapped

    def words(self):
        """What the last map needed to stay one, in words, empty if nothing."""
        words = [f"{self.switched} rows switched"] * bool(self.switched)
        return (*words, *[f"{self.solver.floored} boundary steps raised"] * bool(self.solver.floored))

    def finish(self, f):
        f, rows = unfold(self.solver, f)
        self.switched = len(rows)
        return f


class GaussNewton:
    """State of the fit (nu, Möbius parameters) and one dual Gauss-Newton step; W is factored once."""

    def __init__(self, z, faces, landmarks, alpha, beta):
        self.landmarks = landmarks
        self.mass, self.laplace = mass_matrix(z, faces) / np.pi, stiffness(z, faces, np.zeros(len(faces))) / np.pi
        self.W = alpha * self.mass + beta * self.laplace
        self.factors = factorise(self.W)

    def prior(self, nu):
        return (nu.conj() @ (self.W @ nu)).real

    def objective(self, nu, w, gamma):
        return self.prior(nu) + (self.landmarks.components(w - self.landmarks.target, gamma) ** 2).sum()

    def prepare(self, nu, forward, parameters, gamma):
        """The linearisation at nu: returns `step(nu, w)`, which may be called again with later mapped points w.

        `step(nu, w, damping)` adds `damping (change^* W change)` to what is minimised (Levenberg), and its like for the
        Möbius part: a shorter step, turned towards the steepest descent.
        """
        forward.map(nu, parameters)
        J = self.landmarks.jacobian(*forward.gradients(nu), gamma)
        Jm = self.landmarks.components(forward.mobius_columns(), gamma)
        lifted = self.factors.solve(np.ascontiguousarray(J.real.T)) + 1j * self.factors.solve(
            np.ascontiguousarray(J.imag.T)
        )
        gram = (J.conj() @ lifted).real

        def step(nu, w, damping=0.0):
            share, weight = 1 / (1 + damping), MOBIUS_PRIOR + damping
            S = np.eye(len(J)) + share * gram + Jm @ Jm.T / weight
            residual = self.landmarks.components(w - self.landmarks.target, gamma)
            constant = residual - share * (J.conj() @ nu).real
            y = np.linalg.solve(S, constant)  # undamped, the model's least objective is constant . y
            turn, real, imaginary = -Jm.T @ y / weight
            return -share * (lifted @ y + nu), complex(real, imaginary), turn, constant @ y

        return step


def mass_matrix(z, faces):
    """Consistent mass matrix of piecewise linear functions on a planar mesh, sparse (V, V)."""
    blocks = signed_areas(z, faces)[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12
    return assemble(faces, blocks, len(z))


def descend(newton, forward, step, nu, parameters, gamma, shares=SHARES):
    """One damped step: (nu, parameters, f) with the objective lowered, or None where no share of it lowers it.

    A share s of the step is taken once it brings a fair part of what the quadratic model promises, `(2s - s^2)` of
    the full step's gain; the promise fails where the map is far from linear in nu.
    """
    before = newton.objective(nu, forward.points, gamma)
    change, da, dtheta, promised = step(nu, forward.points)
    for share in shares:
        candidate, moved = nu + share * change, compose_mobius(parameters, (share * da, share * dtheta))
        f = forward.map(candidate, moved)
        gain = before - newton.objective(candidate, forward.points, gamma)
        if gain > FAIR * (2 * share - share**2) * (before - promised):
            return candidate, moved, f
    if gain > 0:
        return candidate, moved, f
    forward.map(nu, parameters)
    return None


def descend_damped(newton, forward, step, nu, parameters, gamma):
    """One Levenberg step, of the least damping that keeps it small and lowers the objective: (nu, parameters, f), or None.

    Which are small enough to trust the linearisation costs no map to find out.
    """
    before, points = newton.objective(nu, forward.points, gamma), forward.points
    steps = (step(nu, points, damping) for damping in DAMPINGS)
    small = (found for found in steps if abs(found[0]).max() <= TRUST)
    for change, da, dtheta, _ in islice(small, TRIES):
        candidate, moved = nu + change, compose_mobius(parameters, (da, dtheta))
        f = forward.map(candidate, moved)
        if newton.objective(candidate, forward.points, gamma) < before:
            return candidate, moved, f
    forward.map(nu, parameters)
    return None


@threadpool_limits.wrap(limits=1)  # on matrices of this size BLAS threads wait for each other: up to five times slower
def fit_landmarks(
    z: Complex[ndarray, " V"],
    faces: Integer[ndarray, " F 3"],
    moving: Complex[ndarray, " M"],
    target: Complex[ndarray, " M"],
    alpha: float = 1.0,
    beta: float = 1e-2,
    gamma: float = 1e5,
    curve: Integer[ndarray, " M"] | None = None,
    sliding: bool = False,
    start: Complex[ndarray, " F"] | None = None,
    rings: int | None = None,
    watch: Callable | None = None,
    enough: float = 0.0,
) -> LandmarkFit:
    """The quasi-conformal disk map that takes landmarks `moving` to `target`: a LandmarkFit, certified or reported.

    Minimises `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2` (means over the unit disk and over
    the M landmarks), to second order in nu the paper's L_CP. Neither this nor the mean squared distance ends above
    that of the best Möbius map: a fit that would is taken up again from there with damped steps, or the Möbius map is
    the result, and `fallbacks` says so. z (V,) complex with its boundary on the unit circle;
    moving, target (M,) complex in the closed disk; curve (M,) int labels, points of a curve in order; sliding lets
    inner points of a curve move along the target curve. start: mu (F,) on the faces to begin from; rings of the polar
    mesh that carries nu (default: from the mesh's size); watch() is called before each step and may raise to stop it;
    enough: landmark error below which no further step is taken on the mesh (0: steps until they settle).
    Errors: LandmarkError, BeltramiError, SurfaceError. Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    z, faces = check_mesh(z, faces)
    moving, target, curve = check_landmarks(moving, target, curve, sliding)
    check_weights(alpha, beta, gamma)
    if rings is not None and not (isinstance(rings, (int, np.integer)) and rings >= FEWEST_RINGS):
        raise LandmarkError(f"rings = {rings!r}: give an integer from {FEWEST_RINGS}, or None to go by the mesh's size")
    rings = rings or int(np.clip(np.sqrt(len(z) / 3), 8, 32))
    landmarks, weights = Landmarks(target, curve, sliding), (alpha, beta, gamma)
    grid, triangles = polar_disk(rings // 2, 3 * (rings // 2), power=1.4)
    newton = GaussNewton(grid, triangles, landmarks, alpha, beta)
    coarse = Forward(grid, triangles, moving, face_mean(triangles, len(grid)))
    field = partial(start_field, z, faces, start)
    best = best_mobius(moving, target)
    nu, parameters, steps = fit_on_grid(newton, coarse, field(coarse.z), best, gamma / 10, watch)
    grid, triangles = polar_disk(rings, 3 * rings, power=1.4)
    newton = GaussNewton(grid, triangles, landmarks, alpha, beta)
    # Only what the steps have changed comes from the coarse mesh, so that a start keeps its details.
    nu = sampling_matrix(coarse.z, coarse.faces, grid) @ (nu - field(coarse.z)) + field(grid)
    fine = MeshForward(z, faces, moving, sampling_matrix(grid, triangles, z[faces].mean(1)))
    f, nu, parameters, polished = fit_on_mesh(newton, fine, nu, parameters, gamma, watch, enough)
    fit = report_fit(newton, fine, z, faces, f, nu, parameters, (steps, polished), weights)
    points = fine.evaluate @ mobius(z, *best)
    if not exceeds(newton, nu, fine.points, points, gamma):
        return fit
    return fit_from_mobius(newton, fine, fit, points, best, weights, watch)


def exceeds(newton, nu, mapped, points, gamma):
    """Whether a fit ends above the best Möbius map, which takes the landmarks to `points`: in its objective, or in the
    mean squared distance alone."""
    target, most = newton.landmarks.target, 1 + ROUNDING
    objectives = newton.objective(nu, mapped, gamma), newton.objective(np.zeros_like(nu), points, gamma)
    squares = [(abs(w - target) ** 2).mean() for w in (mapped, points)]
    return not (objectives[0] <= most * objectives[1] and squares[0] <= most * squares[1])


def fit_from_mobius(newton, fine, astray, points, best, weights, watch):
    """What takes the place of a fit that ended above the best Möbius map: damped steps from there, or that map itself.

    The fit that went astray is kept where the Möbius map folds the mesh and cannot be mended, but it is a bijection.
    """
    z, faces, gamma = fine.z, fine.faces, weights[2]
    zero = np.zeros(newton.W.shape[0], complex)
    f, nu, parameters, steps = fit_on_mesh(newton, fine, zero, best, gamma, watch, damped=True)
    fit = report_fit(newton, fine, z, faces, f, nu, parameters, (astray.steps[0], astray.steps[1] + steps), weights)
    word = "the fit ended above the best Möbius map: "
    if fit.bijective and not exceeds(newton, nu, fine.points, points, gamma):
        return replace(fit, fallbacks=(*fit.fallbacks, word + f"{steps} damped steps from there"))
    fit = report_fit(newton, fine, z, faces, fine.plain(best), zero, best, (fit.steps[0], fit.steps[1]), weights)
    if fit.bijective or not astray.bijective:
        return replace(fit, fallbacks=(*fit.fallbacks, word + "that map is returned"))
    return replace(astray, fallbacks=(*astray.fallbacks, word + "kept, as that map folds the mesh"))


def fit_on_grid(newton, forward, nu, parameters, gamma, watch):
    """Steps on a polar mesh, from nu = 0 with continuation in gamma: (nu, parameters, steps)."""
    low = gamma if nu.any() else min(FIRST_GAMMA, gamma)
    levels = [*10.0 ** np.arange(np.log10(low), np.log10(gamma) - 1e-9), *[gamma] * STEPS_AT_GAMMA]
    for taken, level in enumerate(levels, 1):
        if watch:
            watch()
        step = newton.prepare(nu, forward, parameters, level)
        before = newton.objective(nu, forward.points, level)
        result = descend(newton, forward, step, nu, parameters, level)
        if result:
            nu, parameters, _ = result
        if level == gamma and (
            result is None or newton.objective(nu, forward.points, gamma) > SETTLED_ON_GRID * before
        ):
            break
    return nu, parameters, taken


def fit_on_mesh(newton, fine, nu, parameters, gamma, watch, enough=0.0, damped=False):
    """Last steps, on the caller's mesh, until they settle or the error is below `enough`: (f, nu, parameters, steps).

    damped: Levenberg steps, one a linearisation, for a fit that has gone astray without.
    """
    f, steps = fine.map(nu, parameters), 0
    for _ in range(LINEARISATIONS):
        if newton.landmarks.error(fine.points) < enough:
            break
        step, start = newton.prepare(nu, fine, parameters, gamma), newton.objective(nu, fine.points, gamma)
        # A further step with the same linearisation costs one solve: it is tried whole or not at all.
        for shares in [None] if damped else [SHARES, *[(1.0,)] * CHORDS]:
            if watch:
                watch()
            before = newton.objective(nu, fine.points, gamma)
            way = descend_damped if damped else partial(descend, shares=shares)
            result = way(newton, fine, step, nu, parameters, gamma)
            if result is None:
                break
            (nu, parameters, f), steps = result, steps + 1
            settled = newton.objective(nu, fine.points, gamma) > SETTLED * before
            if settled or newton.landmarks.error(fine.points) < enough:
                break
        if newton.objective(nu, fine.points, gamma) > SETTLED * start:
            break
    return f, nu, parameters, steps


def start_field(z, faces, mu, grid):
    """nu at the polar mesh's vertices from a coefficient mu (F,) on the faces of another disk mesh; 0 from None."""
    if mu is None:
        return np.zeros(len(grid), complex)
    face, _ = locate(z, faces, grid)
    return unbounded(check_coefficient(mu, len(faces))[face])


def report_fit(newton, fine, z, faces, f, nu, parameters, steps, weights):
    """Certify the map and gather what `fit_landmarks` returns."""
    certificate = check_bijective(z, faces, f)
    mu, mapped = bounded(nu), fine.evaluate @ f
    terms = [float((mu.conj() @ (matrix @ mu)).real) for matrix in (newton.mass, newton.laplace)]
    terms.append(float((abs(mapped - newton.landmarks.target) ** 2).mean()))
    losses = dict(zip(("L_mu", "L_grad_mu", "L_Landmark"), terms), L_CP=float(np.dot(weights, terms)))
    return LandmarkFit(
        f,
        beltrami_coefficient(z, faces, f),
        parameters,
        float(newton.landmarks.error(mapped)),
        certificate.bijective,
        certificate.flipped,
        steps,
        losses,
        fine.words(),
    )


def check_weights(alpha, beta, gamma):
    """LandmarkError unless alpha > 0, beta >= 0 and gamma > 0 are finite."""
    for name, value in (("alpha", alpha), ("beta", beta), ("gamma", gamma)):
        number = isinstance(value, (int, float, np.integer, np.floating)) and np.isfinite(value)
        if not (number and (value > 0 or (value == 0 and name == "beta"))):
            raise LandmarkError(f"{name} = {value!r}: alpha and gamma must be positive and finite, beta not negative")


def check_landmarks(moving, target, curve, sliding):
    """Landmarks as complex arrays and curve labels, or LandmarkError."""
    try:
        moving, target = (
            np.atleast_1d(complex_numbers(points, name))
            for points, name in ((moving, "moving landmarks"), (target, "target landmarks"))
        )
    except BeltramiError as error:
        raise LandmarkError(str(error)) from None
    if moving.ndim != 1 or moving.shape != target.shape or len(moving) == 0:
        raise LandmarkError(f"{moving.shape} moving and {target.shape} target landmarks: give one target a landmark")
    for name, points in (("moving", moving), ("target", target)):
        outside = np.flatnonzero(~(abs(points) <= 1 + 1e-9))
        if len(outside):
            raise LandmarkError(
                f"{name} landmarks {outside[:5].tolist()} are not in the closed unit disk "
                f"({points[outside[0]]:.4g}); map them with the surface's disk map first"
            )
        order = np.lexsort((points.imag, points.real))
        twice = np.flatnonzero(abs(np.diff(points[order])) < 1e-12)
        if len(twice):
            pair = sorted(order[twice[0] : twice[0] + 2].tolist())
            raise LandmarkError(
                f"{name} landmarks {pair[0]} and {pair[1]} coincide at {points[pair[0]]:.4g}; "
                "drop one of them (a bijection cannot part or merge points)"
            )
    if curve is None and sliding:
        raise LandmarkError("sliding landmarks need the curve each belongs to: give curve (M,) of integer labels")
    curve = np.zeros(len(moving), int) if curve is None else label_array(curve)
    if curve.shape != moving.shape:
        raise LandmarkError(f"{curve.shape} curve labels for {len(moving)} landmarks: give one label a landmark")
    return moving, target, curve


def label_array(curve):
    """Curve labels as an array of integers, or LandmarkError."""
    try:
        labels = np.asarray(curve)
    except ValueError:
        raise LandmarkError("curve labels are lists of unequal lengths: give integers (M,)") from None
    if labels.dtype.kind not in "iu":
        raise LandmarkError(f"curve labels have type {labels.dtype}: give integers (M,)")
    return labels
