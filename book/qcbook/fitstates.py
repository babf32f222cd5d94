"""Fits to landmarks and folds at one choice of the weights: solvers, their answers in words, and a
figure."""

import html
import time
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from qcbook.figures import FLIPPED_COLOUR, square_lines
from qclearn.plot import CURVE_STYLES, disk_axes, disk_plot, lines_plot, map_curves
from qclearn.registration.features import FINEST
from qclearn.registration.fit import CheckedMap, fit_problem, fit_registration
from qclearn.registration.levels import STALL_RATIO, Level, guided
from qclearn.registration.problem import LandmarkError, Weights
from qclearn.registration.report import measured_losses
from qclearn.registration.residuals import FeatureTerm

from .cells import in_powers

RINGS = 24  # of the polar mesh that carries the fit's unknowns: more gain little here, and take longer
# Fewer levels than `register` has: a slider cannot wait.
FOLD_LEVELS = (guided(12, 16.0, 2), Level(RINGS, 8.0, 2, "own", STALL_RATIO))


@dataclass(frozen=True)
class FitState:
    """One solver's answer: fit (None where it failed), its terms of the loss, seconds, and a
    message in words.

    terms: name -> (value, weight, product), measured of the map: those of L_CP, and "L_features"
    with a fold weight.
    """

    fit: CheckedMap | None
    terms: dict
    seconds: float
    message: str

    @property
    def loss(self):
        """The sum of the weighted terms, NaN without a map."""
        return sum(product for *_, product in self.terms.values()) if self.terms else np.nan


def exact_fit(problem, weights, features=None):
    """`fit_landmarks` on a `Problem`, `fit_registration` with features."""
    if features is None:
        return fit_problem(problem, weights, rings=RINGS)
    return fit_registration(problem, weights, features, levels=FOLD_LEVELS)


def fit_state(example, weights, sliding=False, solver=exact_fit):
    """The answer to weights (alpha, beta, gamma, and delta for folds) by a solver like `exact_fit`:
    a FitState. Bad input becomes its message."""
    start, problem = time.perf_counter(), example.sliding if sliding else example.problem
    try:
        weights = Weights(*weights)
        features = features_of(example, weights)
        fit = solver(problem, weights, features)
    except ValueError as error:  # LandmarkError, BeltramiError, SurfaceError, WeightsError
        return FitState(None, {}, time.perf_counter() - start, str(error))
    seconds = time.perf_counter() - start
    losses, factors = (measured_losses(problem, weights, fit.mu, problem.samples @ fit.f), weights.factors)
    if features is not None:
        losses["L_features"] = float((FeatureTerm(features, FINEST, 1.0).residual(fit.f) ** 2).sum())
        factors["L_features"] = weights.delta
    terms = {name: (losses[name], factor, factor * losses[name]) for name, factor in factors.items()}
    folds = f"{len(fit.flipped)} of {len(problem.disk.faces)} triangles flipped"
    certificate = "certified bijective" if fit.bijective else f"not bijective: {folds}"
    return FitState(fit, terms, seconds, "; ".join([certificate, *fit.fallbacks]))


def features_of(example, weights):
    """An example's features, None if delta is 0; LandmarkError for a delta without features."""
    if weights.delta and example.features is None:
        raise LandmarkError(f"delta = {weights.delta:g}, but {example.name!r} has no folds; choose delta 0")
    return example.features if weights.delta else None


def describe(state):
    """A FitState in one sentence."""
    if state.fit is None:
        return f"No map: {state.message}"
    size = abs(state.fit.mu)
    error = in_powers(f"{state.fit.landmark_error:.1e}")
    measured = f"landmark error {error}, mean |μ| {size.mean():.3f}, largest {size.max():.3f}"
    return f"{measured}; {state.message}; {1000 * state.seconds:.0f} ms"


def sentences(states):
    """States (dict solver name -> FitState) as HTML: a sentence each, and the loss of each beside
    the first one's."""
    said = [f"<p><b>{html.escape(name)}</b>: {html.escape(describe(state))}</p>" for name, state in states.items()]
    (name, first), *others = states.items()
    for other, state in others:
        if state.fit is not None and first.fit is not None:
            said.append(f"<p>L_CP of {other} is {state.loss / first.loss:.3g} times that of {name}.</p>")
    return "".join(said)


def states_figure(example, states):
    """A Matplotlib figure of an `Example`'s states (dict name -> FitState), a column each, empty
    without a map: landmarks on the deformed grid, |mu| on the moving disk to one scale, and its histogram."""
    figure = Figure(figsize=(5.8, 7.6), layout="constrained")
    columns = figure.subplots(3, len(states), squeeze=False, gridspec_kw={"height_ratios": (3, 3, 2)}).T
    scale = example.radius.to_image if example.radius else np.asarray
    largest = max((abs(state.fit.mu).max() for state in states.values() if state.fit is not None), default=1)
    for (name, state), column in zip(states.items(), columns):
        for ax, title in zip(column, (name, "|μ| on the moving disk", "triangles by |μ|")):
            ax.set_title(title, fontsize=10)
        landmarks_plot(disk_axes(column[0]), example.problem, scale)
        if state.fit is not None:
            colours = fit_plot(column, example, state.fit, scale, largest)
            figure.colorbar(colours, ax=column[1], orientation="horizontal", shrink=0.7)
    return figure


def landmarks_plot(ax, problem, scale):
    """The curves of a `Problem` and their targets, and squares at the targets."""
    starts = np.flatnonzero(np.diff(problem.curve)) + 1
    for points, style in ((problem.moving, "detected"), (problem.target, "target")):
        look = {key: CURVE_STYLES[style][key] for key in ("color", "linestyle")}
        for curve in np.split(scale(points), starts):
            ax.plot(curve.real, curve.imag, linewidth=1, **look)
    target = scale(problem.target)
    ax.plot(target.real, target.imag, "s", color=CURVE_STYLES["target"]["color"], fillstyle="none", markersize=6)


def fit_plot(column, example, fit, scale, largest):
    """A map in a column of three Axes, with its landmarks and folds; returns what is coloured by |mu|."""
    problem, radius = example.problem, example.radius
    lines = [radius.from_image(line) if radius else line for line in square_lines(15, 61)]
    carried = map_curves(problem.disk, fit.f, lines)
    lines_plot(column[0], [scale(line) for line in carried], "0.8")
    mapped = scale(problem.samples @ fit.f)
    yellow = CURVE_STYLES["registered"]["color"]
    column[0].plot(mapped.real, mapped.imag, "o", color=yellow, markeredgecolor="black", markersize=4)
    for triangle in scale(fit.f)[problem.disk.faces[fit.flipped]]:
        column[0].fill(triangle.real, triangle.imag, facecolor=FLIPPED_COLOUR, hatch="//", edgecolor="black")
    column[2].hist(np.minimum(abs(fit.mu), largest), np.linspace(0, largest, 41), color="#0072B2")
    column[2].set(xlabel="|μ|", xlim=(0, largest), yticks=[])
    # A palette that is light where there is little to see: it is most of the disk.
    return disk_plot(column[1], scale(problem.disk.z), problem.disk.faces, abs(fit.mu), "YlGnBu", 0, largest)
