"""The best quasi-conformal map for landmarks and features, without a network: Gauss-Newton steps,
mesh after mesh.

Objective: `nu^* W nu + gamma mean |M(f(p)) - q|^2 + delta sum_c a_c sum_k w_k (I_c(x_k) - J_c(M
f(x_k)))^2`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Complex, Integer
from numpy import ndarray
from threadpoolctl import threadpool_limits

from ..plane.bijectivity import BijectivityError, unfold
from ..plane.coefficients import bounded
from ..plane.disk import Disk
from ..plane.mobius import best_mobius, mobius
from ..plane.solver import DiskSolver
from .features import PLACED, Features, Placed, best_by_features
from .multiresolution import COARSE, MultiresolutionFit, feature_levels, landmark_levels, run_level
from .problem import LandmarkError, Problem, Weights

FEWEST_RINGS = 4  # of the polar mesh; half of them on the coarse one
ROUNDING = 1e-9  # by which an objective may exceed another and count as equal
APART = 0.15  # mean distance in the disk of two starts that are tried both
OVERFITS = 10.0  # delta above which a word is said
ABOVE = "the fit ended above the best Möbius map"
SPENT = "the fit was stopped: it took over twice the work of the slowest good landmarks, so these are probably wrong"


@dataclass(frozen=True)
class CertifiedMap:
    """A disk map of a problem with its certificate.

    f: the map, Möbius part included; mu: its measured coefficient; mobius: (a, theta);
    landmark_error: mean |f(p) - q|, 0 without landmarks; bijective, flipped: the certificate;
    fallbacks: words on what was done besides; switched: at how many vertices rows were, the most of
    the maps tried.
    """

    f: Complex[ndarray, " V"]
    mu: Complex[ndarray, " F"]
    mobius: tuple
    landmark_error: float
    bijective: bool
    flipped: Integer[ndarray, " k"]
    fallbacks: tuple
    switched: int


@dataclass(frozen=True)
class LandmarkFit(CertifiedMap):
    """Result of `fit_landmarks`: a `CertifiedMap` and how it was found.

    steps: Gauss-Newton steps on the polar mesh and on the given one; losses: L_mu, L_grad_mu,
    L_Landmark, L_CP of the coefficient field, and L_features; r: feature -> correlation after the
    best Möbius map and after this one.
    """

    steps: tuple
    losses: dict
    start: str = ""
    r: dict = field(default_factory=dict)


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
    watch: Callable | None = None,
    enough: float = 0.0,
) -> LandmarkFit:
    """The quasi-conformal disk map that takes landmarks `moving` to `target`: a LandmarkFit,
    certified or reported.

    Minimises `alpha mean|nu|^2 + beta mean|grad nu|^2 + gamma mean|M(f(p)) - q|^2` (means over the
    unit disk and over the M landmarks), to second order in nu the paper's L_CP. Neither this nor
    the mean squared distance ends above that of the best Möbius map: a fit that would starts again
    from there, or that map is the result; see `fallbacks`. z (V,): boundary on the unit circle;
    moving, target (M,): in the closed disk; curve (M,): labels, points of a curve in order;
    sliding: inner points of a curve may move along the target curve; start: mu (F,) to begin from;
    rings: of the polar mesh of nu (None: by the mesh's size); watch() is called before each step
    and may raise to stop it; enough: landmark error below which no further step is taken on the
    mesh (0: steps until they settle). Errors: LandmarkError, BeltramiError, SurfaceError. Source:
    paper, eq. RegLoss; Gauss-Newton in its dual form.
    """
    problem, weights = (
        Problem(Disk(z, faces), moving, target, curve, sliding),
        Weights(alpha, beta, gamma),
    )
    return fit_problem(problem, weights, start, rings, watch, enough)


@threadpool_limits.wrap(
    limits=1
)  # on matrices of this size BLAS threads wait for each other: up to five times slower
def fit_problem(problem, weights, start=None, rings=None, watch=None, enough=0.0):
    """`fit_landmarks` of a `Problem`, or of the `MultiresolutionFit` of a fitted one, with
    `Weights`."""
    if rings is not None and not (isinstance(rings, (int, np.integer)) and rings >= FEWEST_RINGS):
        raise LandmarkError(
            f"rings = {rings!r}: give an integer from {FEWEST_RINGS}, or None to go by the mesh's "
            "size"
        )
    climb = problem if isinstance(problem, MultiresolutionFit) else MultiresolutionFit(problem)
    problem = climb.problem
    levels = list(landmark_levels(problem.disk, rings or rings_for(problem.disk)))
    engine, state, (*coarse, polished) = climb.run(
        levels, weights, start, watch=watch, enough=enough
    )
    fit = report_fit(engine, state, (sum(coarse), polished))
    best = problem.samples @ mobius(problem.disk.z, *problem.mobius)
    if exceeds(engine, state, best):
        fit = fit_from_mobius(engine, fit, best, levels[-1], watch)
    return within_budget(engine, fit)


@threadpool_limits.wrap(limits=1)
def fit_registration(
    problem: Problem,
    weights: Weights,
    features: Features,
    start: Complex[ndarray, " F"] | None = None,
    watch: Callable | None = None,
    levels: Sequence | None = None,
) -> LandmarkFit:
    """The disk map of a `Problem` that takes landmarks and `Features` to theirs, with `Weights`
    (delta > 0): LandmarkFit.

    Gauss-Newton from coarse features on a coarse mesh to fine ones on the problem's own; `r` of the
    result has the features' correlations. start: mu (F,) on the faces to begin from; watch() is
    called before each step and may raise to stop it. A problem without landmarks begins at the
    identity: align its disk by features first.
    """
    if not weights.delta > 0:
        raise LandmarkError(
            f"delta = {weights.delta:g}: the features would take no part; give 0.1 to 1"
        )
    levels = feature_levels(problem.disk) if levels is None else levels
    most, led = rings_for(problem.disk), start is not None or not len(problem.moving)
    levels = [
        level._replace(rings=min(level.rings, most)) for level in levels if level.sigma or not led
    ]
    engine, state, steps, begun = best_start(
        MultiresolutionFit(problem), levels, weights, features, start, watch
    )
    fit = replace(report_fit(engine, state, steps), start=begun)
    plain = engine.at_mobius(problem.mobius)
    if not engine.objective(state, weights.gamma) <= (1 + ROUNDING) * engine.objective(
        plain, weights.gamma
    ):
        fit = instead(fit, report_fit(engine, plain, steps))
    fit = within_budget(engine, fit)
    words = [f"delta = {weights.delta:g} overfits: choose it by held-out curves"] * (
        weights.delta > OVERFITS
    )
    r = np.transpose([features.correlation(plain.f), features.correlation(fit.f)]).tolist()
    return replace(fit, fallbacks=(*fit.fallbacks, *words), r=dict(zip(features.names, r)))


def best_start(climb, levels, weights, features, start, watch):
    """GaussNewtonObjective, state and steps of the last level, and words on where the fit began.

    Without landmarks the folds alone may lead a map into a valley that is not theirs. Where the
    Möbius map of features and of the vertices' places in space lies APART from where the disk was
    laid, a second way begins there, and places lead on its coarsest levels, too. The way whose
    objective, one and the same, ends lower on the finest polar mesh goes on.
    """
    few = [level for level in levels if not (level.own_mesh or level.proxy_rings)]
    guiding = [level for level in few if (level.sigma or 0) >= COARSE]
    if not (weights.eta and guiding) or start is not None or len(climb.problem.moving):
        return *climb.run(levels, weights, start, features, watch), ""
    sides, z = climb.problem.sides, climb.problem.disk.z
    placed = Placed(features, sides.moving, sides.control)
    parameters = best_by_features(placed, z, PLACED)
    apart = features.areas @ abs(mobius(z, *parameters) - z)
    if apart < APART:
        found = climb.run(levels, weights, None, features, watch)
        return (
            *found,
            f"by features; with places in space the start lies {apart:.2g} from there in the disk",
        )
    first = climb.engine(guiding[0], weights, placed)
    laid = first, first.at(np.zeros(len(first.link.mesh.z), complex), parameters)
    begun = climb.run(guiding, weights, None, placed, watch, begun=laid)
    other = climb.run(few[len(guiding) :], weights, None, features, watch, begun=begun)
    ways = [climb.run(few, weights, None, features, watch), (*other[:2], begun[2] + other[2])]
    ends = [engine.objective(state, engine.weights.gamma) for engine, state, _ in ways]
    best = int(ends[1] < ends[0])
    words = [
        f"{name} (objective {end:.4g})"
        for name, end in zip(("features", "features and places"), ends)
    ]
    engine, state, last = climb.run(
        levels[len(few) :], weights, None, features, watch, begun=ways[best]
    )
    return engine, state, ways[best][2] + last, f"by {words[best]}, not by {words[1 - best]}"


def rings_for(disk):
    """How many rings the polar mesh of nu has for a `Disk`, by its vertices."""
    return int(np.clip(np.sqrt(len(disk.z) / 3), 8, 32))


def exceeds(engine, state, best):
    """Whether a fit ends above the best Möbius map, landmarks at `best` (M,), in objective or mean
    squared distance."""
    gamma, target, most = engine.weights.gamma, engine.problem.target, 1 + ROUNDING
    squares = [(abs(points - target) ** 2).mean() for points in (state.points, best)]
    fitted = engine.objective(state, gamma)
    plain = (engine.landmarks.residual(best, gamma) ** 2).sum()
    if engine.areas is not None:
        plain += (
            engine.areas.residual(mobius(engine.problem.disk.z, *engine.problem.mobius)) ** 2
        ).sum()
    return not (fitted <= most * plain and squares[0] <= most * squares[1])


def fit_from_mobius(engine, astray, best, level, watch):
    """The fit by steps from the best Möbius map in place of one that ended above it, or else
    `instead` of that one."""
    parameters = engine.problem.mobius
    begin = engine.at(
        np.zeros(len(engine.link.mesh.z), complex), parameters
    )  # what was preconditioner far from here is gone
    state, steps = run_level(engine, begin, level, watch)
    taken = astray.steps[0], astray.steps[1] + steps
    fit = report_fit(engine, state, taken)
    if fit.bijective and not exceeds(engine, state, best):
        return replace(fit, fallbacks=(*fit.fallbacks, f"{ABOVE}: {steps} steps from there"))
    return instead(astray, report_fit(engine, engine.at_mobius(parameters), taken))


def within_budget(engine, fit):
    """The fit; where its engine's work is spent, with a word, and the best Möbius map in place of
    one that folds."""
    if not engine.spent:
        return fit
    if not fit.bijective:
        plain = report_fit(engine, engine.at_mobius(engine.problem.mobius), fit.steps)
        fit = replace(
            plain, fallbacks=(*plain.fallbacks, "the fit folds: the best Möbius map is returned")
        )
    return replace(fit, fallbacks=(*fit.fallbacks, SPENT))


def instead(fit, plain):
    """The best Möbius map in place of a fit that ended above it, unless that map alone folds the
    mesh."""
    if plain.bijective or not fit.bijective:
        return replace(plain, fallbacks=(*plain.fallbacks, f"{ABOVE}: that map is returned"))
    return replace(fit, fallbacks=(*fit.fallbacks, f"{ABOVE}: kept, as that map folds the mesh"))


def report_fit(engine, state, steps):
    """Certify a state's map and gather what `fit_landmarks` returns."""
    mu, weights, link = bounded(state.nu), engine.weights, engine.link
    off = state.points - engine.problem.target
    terms = {
        "L_mu": float((mu.conj() @ (engine.mass @ mu)).real),
        "L_grad_mu": float((mu.conj() @ (link.laplace @ mu)).real),
        "L_Landmark": float((abs(off) ** 2).mean()) if len(off) else 0.0,
    }
    terms["L_CP"] = float(sum(factor * terms[name] for name, factor in weights.factors.items()))
    if engine.features is not None:
        terms["L_features"] = float((engine.features.residual(state.f) ** 2).sum() / weights.delta)
    if engine.areas is not None:
        terms["L_area"] = float((engine.areas.residual(state.f) ** 2).sum() / weights.eta)
    words = solver_messages(state.solution, state.switched)
    found = certified(engine.problem, state.f, state.mobius, words, state.switched)
    return LandmarkFit(**vars(found), steps=steps, losses=terms)


def certified(problem, f, parameters, fallbacks=(), switched=0):
    """The CertifiedMap of a problem's map f (V,), which holds the Möbius parameters."""
    found, mu = problem.disk.certify(f), problem.disk.coefficient(f)
    off = abs(problem.samples @ f - problem.target)
    error = float(off.mean()) if len(off) else 0.0
    return CertifiedMap(
        f, mu, parameters, error, found.bijective, found.flipped, tuple(fallbacks), switched
    )


def moved_map(problem, f, fallbacks=()):
    """M after f (V,), M the disk Möbius map with the least `mean |M(f(p)) - q|^2`: CertifiedMap."""
    parameters = best_mobius(problem.samples @ f, problem.target)
    f = mobius(f, *parameters)
    f[problem.disk.loop] /= abs(f[problem.disk.loop])
    return certified(problem, f, parameters, fallbacks)


def exact_map(problem, mu):
    """`moved_map` of the exact solver's map for mu (F,), solved again with switched rows where it
    folds."""
    solver = DiskSolver(problem.disk)
    solved = solver.solve(mu)
    found = moved_map(problem, solved, solver_messages(solver))
    if found.bijective:
        return found
    f, rows, _ = unfold(solver, mobius(solved, *found.mobius))
    return certified(problem, f, found.mobius, solver_messages(solver, len(rows)), len(rows))


def solver_messages(solver, switched=0):
    """Words on what a solver's last map needed to stay one."""
    told = (switched, "rows switched"), (solver.floored, "boundary steps raised")
    return tuple(f"{count} {word}" for count, word in told if count)


def fit_with_fallbacks(problem, weights, start=None, enough=0.0, features=None):
    """`fit_problem`, or with `Features` `fit_registration`, at the first `weight_fallbacks` of
    weights whose map is bijective."""
    for rung in weight_fallbacks(weights, problem, features):
        if features is None:
            fit = fit_problem(problem, rung, start=start, enough=enough)
        else:
            fit = fit_registration(problem, rung, features, start)
        if fit.bijective:
            lowered = [
                name for name in ("delta", "gamma") if getattr(rung, name) < getattr(weights, name)
            ]
            words = [f"{name} lowered to {getattr(rung, name):g}" for name in lowered]
            return replace(fit, fallbacks=(*fit.fallbacks, *words))
    found = f"gamma = {rung.gamma:g}" if len(problem.moving) else f"delta = {rung.delta:g}"
    advice = (
        "no two curves cross or are swapped"
        if len(problem.moving)
        else "the features of both sides agree"
    )
    raise BijectivityError(
        f"no bijective map for these {'landmarks' if len(problem.moving) else 'features'} down to "
        f"{found} "
        f"({len(fit.flipped)} faces flipped); check that {advice}"
    )


def weight_fallbacks(weights, problem, features):
    """The weights to try in turn: lower delta once, then gamma by powers of ten; without landmarks
    delta alone."""
    yield weights
    if features is not None:
        for _ in range(1 if len(problem.moving) else 4):
            weights = replace(weights, delta=weights.delta / 4)
            yield weights
    if len(problem.moving):
        for power in range(1, 5):
            yield weights.at(weights.gamma / 10**power)
