"""The best quasi-conformal map for landmarks and features, without a network.

`fit_problem` (landmarks) and `fit_registration` (landmarks and features) run a
`MultiresolutionFit`, compare its answer with the best Möbius map, and certify it;
`fit_with_fallbacks` lowers the weights where no map is bijective. Objective:

    `nu^* W nu + gamma mean |M(f(p)) - q|^2
    + delta sum_c a_c sum_k w_k (s_c(x_k) - t_c(M f(x_k)))^2 + eta mean (log J)^2`

mu = T(nu): the coefficient, T the activation `bounded` of plane/coefficients.py; nu is a free
    complex field on a polar mesh, interpolated to the mapped mesh's faces before T is applied.
W = alpha mass + beta Laplace: the prior's matrix; with areas its mass is the moving surface's.
f, M: the solver's map of mu, and the disk Möbius map after it; a result's `f` is M f.
s_c, t_c: the c-th feature of the moving surface and of the control; a, w: as in `FeatureTerm`.
J: the areal scale from surface to surface. The residuals' derivative is D (gauss_newton.py).

What is minimised is the energy of nu; what is reported, L_mu and L_grad_mu, is that of mu = T(nu).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Integer
from numpy import ndarray
from threadpoolctl import threadpool_limits

from ..plane.bijectivity import BijectivityError, unfold
from ..plane.coefficients import bounded
from ..plane.disk import Disk
from ..plane.mobius import best_mobius, mobius
from ..plane.solver import DiskSolver
from .features import Features
from .levels import MultiresolutionFit, feature_levels, landmark_levels, rings_for, run_level
from .problem import DELTA, NOTHING, LandmarkError, Problem, Weights
from .start import from_starts

FEWEST_RINGS = 4  # of the polar mesh; half of them on the coarse one
ROUNDING = 1e-9  # by which an objective may exceed another and count as equal
OVERFITS = 10.0  # delta above which the result has a warning

ABOVE = "the fit ended above the best Möbius map"
SPENT = (
    "the fit was cut short: it took over twice the work of the slowest good one, so a weight or what "
    "it was given is probably wrong"
)


@dataclass(frozen=True)
class CheckedMap:
    """A disk map of a problem with the certificate's verdict, which may be that it folds.

    f: the map, Möbius part included; mu: its measured coefficient; mobius: (a, theta);
    landmark_error: mean |f(p) - q|, 0 without landmarks; bijective, flipped: the certificate's
    verdict and the flipped faces; fallbacks: messages on what else was done; switched: at how many
    vertices the repair switched rows, here or in the network's map, which is more.
    """

    f: Complex[ndarray, " V"]
    mu: Complex[ndarray, " F"]
    mobius: tuple
    landmark_error: float
    bijective: bool
    flipped: Integer[ndarray, " k"]
    fallbacks: tuple
    switched: int

    def with_messages(self, *messages: str) -> "CheckedMap":
        """The same with more `fallbacks`."""
        return replace(self, fallbacks=(*self.fallbacks, *messages))


@dataclass(frozen=True)
class LandmarkFit(CheckedMap):
    """Result of `fit_landmarks`: a `CheckedMap` and how the fit came to it.

    steps: Gauss-Newton steps on the polar mesh and on the given one, or with features those of each
    level; losses: L_mu, L_grad_mu, L_Landmark, L_CP of the coefficient field, L_features and
    L_area; start_message: which of two starts the fit of features without landmarks went on from.
    """

    steps: tuple
    losses: dict
    start_message: str = ""


def fit_landmarks(
    z: Complex[ndarray, " V"],
    faces: Integer[ndarray, " F 3"],
    moving: Complex[ndarray, " M"],
    target: Complex[ndarray, " M"],
    alpha: float = Weights.alpha,
    beta: float = Weights.beta,
    gamma: float = Weights.gamma,
    curve: Integer[ndarray, " M"] | None = None,
    sliding: bool = False,
    start: Complex[ndarray, " F"] | None = None,
    rings: int | None = None,
    enough: float = 0.0,
) -> LandmarkFit:
    """The quasi-conformal disk map that takes landmarks `moving` to `target`: a LandmarkFit, whose
    `bijective` says whether it is certified.

    Minimises `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2` (means over the
    unit disk and over the M landmarks), to second order in nu the paper's L_CP. If this or the mean
    squared distance ends above that of the best Möbius map, the fit restarts from that map; if that
    does not help, the Möbius map is returned; see `fallbacks`. z (V,): boundary on the unit circle;
    moving, target (M,): in the closed disk; curve (M,): labels, points of a curve in order;
    sliding: inner points of a curve may move along the target curve; start: mu (F,) to begin from;
    rings: of the polar mesh of nu (None: by the mesh's size); enough: landmark error below which no
    further step is taken on the mesh (0: steps until they settle). Errors: LandmarkError,
    BeltramiError, SurfaceError. Source: paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    problem = Problem(Disk(z, faces), moving, target, curve, sliding)
    return fit_problem(problem, Weights(alpha, beta, gamma), start, rings, enough)


# On matrices of this size BLAS threads wait for each other: up to five times slower.
@threadpool_limits.wrap(limits=1)
def fit_problem(problem, weights, start_mu=None, rings=None, enough=0.0):
    """`fit_landmarks` of a `Problem` with `Weights`; start_mu: its `start`."""
    if rings is not None and not (isinstance(rings, (int, np.integer)) and rings >= FEWEST_RINGS):
        raise LandmarkError(
            f"rings = {rings!r}: give an integer from {FEWEST_RINGS}, or None to go by the mesh's "
            "size"
        )
    # From a coarse polar mesh to the caller's own.
    levels = landmark_levels(problem.disk, rings or rings_for(problem.disk))
    objective, state, steps = MultiresolutionFit(problem).run(
        levels, weights, start_mu, enough=enough
    )
    # Landmarks alone need no guiding levels, so that steps on the last one may succeed.
    return better(objective, state, (sum(steps[:-1]), steps[-1]), levels[-1])


@threadpool_limits.wrap(limits=1)
def fit_registration(
    problem: Problem,
    weights: Weights,
    features: Features,
    start: Complex[ndarray, " F"] | None = None,
    levels: Sequence | None = None,
) -> LandmarkFit:
    """The disk map of a `Problem` that takes landmarks and `Features` to theirs, with `Weights`
    (delta > 0): LandmarkFit.

    Gauss-Newton from coarse features on a coarse mesh to fine ones on the problem's own. start: mu
    (F,) on the faces to begin from. A problem without landmarks begins at the identity: align its
    disk by features first.
    """
    if not weights.delta > 0:
        raise LandmarkError(
            f"delta = {weights.delta:g}: the features would take no part; give {DELTA:g}"
        )
    # Levels of landmarks alone have nothing to do where a start or features lead.
    by_landmarks = start is None and len(problem.moving)
    levels = feature_levels(problem.disk, levels)
    levels = [level for level in levels if level.sigma or by_landmarks]

    # From coarse features on a coarse mesh to fine ones; without landmarks from one of two starts.
    multiresolution, start_message = MultiresolutionFit(problem), ""
    if weights.eta and start is None and not len(problem.moving):
        fitted, start_message = from_starts(multiresolution, levels, weights, features)
    else:
        fitted = multiresolution.run(levels, weights, start, features)
    # No second fit from the Möbius map: on the last level alone features would lead it to the
    # nearest valley.
    fit = better(*fitted)
    if weights.delta > OVERFITS:
        fit = fit.with_messages(f"delta = {weights.delta:g} overfits: choose it by held-out curves")
    return replace(fit, start_message=start_message)


def better(objective, state, steps, level=None):
    """The LandmarkFit of a state, or of the best Möbius map where the state lies above that one: in
    objective or, without features, in the landmarks' mean squared distance. level: whose steps from
    the Möbius map are tried before it is returned."""

    def sizes(state):
        value = objective.value(state, objective.weights.gamma)
        if objective.feature_term is not None:
            return (value,)
        return value, (abs(state.points - objective.problem.target) ** 2).mean()

    fit = report_fit(objective, state, steps)
    mobius_state = objective.at_mobius(objective.problem.mobius)
    least = sizes(mobius_state)
    above = is_above(sizes(state), least)
    if above and level is not None:
        # A second fit, which may take as much work as the one before it.
        objective.work = 0.0
        state = objective.at(mobius_state.nu, mobius_state.mobius)
        state, taken = run_level(objective, state, level)
        steps = steps[0], steps[1] + taken
        second = report_fit(objective, state, steps)
        if second.bijective and not is_above(sizes(state), least):
            above, fit = False, second.with_messages(f"{ABOVE}: {taken} steps from there")
    if not above and not objective.spent:
        return fit
    plain = report_fit(objective, mobius_state, steps)
    if above and (plain.bijective or not fit.bijective):
        fit = plain.with_messages(f"{ABOVE}: that map is returned")
    elif above:
        fit = fit.with_messages(f"{ABOVE}: kept, as that map folds the mesh")
    if objective.spent:
        if not fit.bijective:
            fit = plain.with_messages("the fit folds: the best Möbius map is returned")
        fit = fit.with_messages(SPENT)
    return fit


def is_above(sizes, least):
    """Whether a map's sizes lie above those of the best Möbius map, beyond rounding, in any."""
    return not all(size <= (1 + ROUNDING) * best + NOTHING for size, best in zip(sizes, least))


def report_fit(objective, state, steps):
    """The LandmarkFit of a state: its map with the certificate's verdict, and its losses."""
    mu, weights = bounded(state.nu), objective.weights
    losses = weights.losses(
        (mu.conj() @ (objective.mass @ mu)).real,
        (mu.conj() @ (objective.coefficient_mesh.laplace @ mu)).real,
        abs(state.points - objective.problem.target),
    )
    for name, term, weight in (
        ("L_features", objective.feature_term, weights.delta),
        ("L_area", objective.area_term, weights.eta),
    ):
        if term is not None:
            losses[name] = float((term.residual(state.f) ** 2).sum() / weight)
    result = checked(objective.problem, state.f, state.mobius, state.solution, state.switched)
    return LandmarkFit(**vars(result), steps=steps, losses=losses)


def checked(problem, f, parameters, solver=None, switched=0):
    """The CheckedMap of a problem's map f (V,), which includes the Möbius map of these parameters;
    it may fold. solver, switched: what made f, and how many rows its repair switched."""
    certificate, mu = problem.disk.certify(f), problem.disk.coefficient(f)
    off = abs(problem.samples @ f - problem.target)
    error = float(off.mean()) if len(off) else 0.0
    raised = 0 if solver is None else solver.floored
    repairs = {"rows switched": switched, "boundary steps raised": raised}
    return CheckedMap(
        f=f,
        mu=mu,
        mobius=parameters,
        landmark_error=error,
        bijective=certificate.bijective,
        flipped=certificate.flipped,
        fallbacks=tuple(f"{count} {name}" for name, count in repairs.items() if count),
        switched=switched,
    )


def moved_map(problem, f, solver=None):
    """M after f (V,), M the disk Möbius map with the least `mean |M(f(p)) - q|^2`: CheckedMap,
    not repaired."""
    parameters = best_mobius(problem.samples @ f, problem.target)
    f = mobius(f, *parameters)
    f[problem.disk.loop] /= abs(f[problem.disk.loop])
    return checked(problem, f, parameters, solver)


def exact_map(problem, mu):
    """`moved_map` of the exact solver's map for mu (F,), solved again with switched rows where it
    folds; the CheckedMap may fold even then."""
    solver = DiskSolver(problem.disk)
    f = solver.solve(mu)
    result = moved_map(problem, f, solver)
    if result.bijective:
        return result
    f, rows, _ = unfold(solver, mobius(f, *result.mobius))
    return checked(problem, f, result.mobius, solver, len(rows))


def fit_with_fallbacks(problem, weights, start_mu=None, enough=0.0, features=None):
    """`fit_problem`, or with `Features` `fit_registration`, at the first weights whose map is
    bijective: these, then lower ones. start_mu: mu (F,) to begin from."""
    # Lower delta once, then gamma by powers of ten; without landmarks delta alone.
    fallbacks = [weights]
    if features is not None:
        for _ in range(1 if len(problem.moving) else 4):
            fallbacks.append(replace(fallbacks[-1], delta=fallbacks[-1].delta / 4))
    if len(problem.moving):
        last = fallbacks[-1]
        fallbacks += [replace(last, gamma=last.gamma / 10**power) for power in range(1, 5)]
    for tried in fallbacks:
        if features is None:
            fit = fit_problem(problem, tried, start_mu=start_mu, enough=enough)
        else:
            fit = fit_registration(problem, tried, features, start_mu)
        if fit.bijective:
            messages = [
                f"{name} lowered to {getattr(tried, name):g}"
                for name in ("delta", "gamma")
                if getattr(tried, name) < getattr(weights, name)
            ]
            return fit.with_messages(*messages)
    if len(problem.moving):
        given, last = "landmarks", f"gamma = {tried.gamma:g}"
        advice = "no two curves cross or are swapped"
    else:
        given, last = "features", f"delta = {tried.delta:g}"
        advice = "the features of both sides agree"
    raise BijectivityError(
        f"no bijective map for these {given} down to {last} ({len(fit.flipped)} faces flipped); "
        f"check that {advice}"
    )
