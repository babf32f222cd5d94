"""Live tuning of fits by landmarks and folds: solvers, the callback as a plain function, a thin ipywidgets shell."""

import html
import threading
import time
from dataclasses import dataclass, replace

import ipywidgets
import numpy as np

from ..registration.certified import CertifiedMap, exact_map
from ..registration.checked import gamma_words, predicted
from ..registration.dense import Dense
from ..registration.features import FINEST
from ..registration.fit import fit_problem
from ..registration.hybrid import Level, fit_registration
from ..registration.metrics import measured_losses
from ..registration.problem import LandmarkError, Weights
from ..registration.register import load
from .canvas import Canvas
from .cells import picture_html

RINGS = 24  # of the polar mesh that carries the fit's unknowns: more gain little here, and take longer
FOLD_LEVELS = (Level(12, 16.0, 2), Level(RINGS, 8.0, 2, True))  # fewer than `register` has: a slider cannot wait


@dataclass(frozen=True)
class FitState:
    """One solver's answer: fit (None where it failed), its terms of the loss, seconds, and a message in words.

    terms: name -> (value, weight, product) as measured of the map, so that solvers are compared alike: those of L_CP,
    and "L_features" where folds have a weight.
    """

    fit: CertifiedMap | None
    terms: dict
    seconds: float
    message: str

    @property
    def loss(self):
        """The sum of the weighted terms, NaN without a map."""
        return sum(product for *_, product in self.terms.values()) if self.terms else np.nan


def exact_fit(problem, weights, features=None, watch=None):
    """`fit_landmarks` on a `Problem`, `fit_registration` with features."""
    if features is None:
        return fit_problem(problem, weights, rings=RINGS, watch=watch)
    return fit_registration(problem, weights, features, watch=watch, levels=FOLD_LEVELS)


def network_fit(problem, weights, features=None, watch=None):
    """CP-Net's coefficient for a `Problem` and the exact solver's map for it: what differs is CP-Net's alone.

    It knows no folds: with features its answer is that without.
    """
    if problem.sliding:
        raise LandmarkError("CP-Net takes points to points, it knows no sliding; choose points")
    network = load("cpnet")
    if watch:
        watch()
    found = exact_map(problem, predicted(network.predict, problem, weights))
    return replace(found, fallbacks=(*gamma_words(network, weights), *found.fallbacks))


DELTAS = [("0 (no folds)", 0.0), *((f"{delta:g}", delta) for delta in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0))]
SOLVERS = {"exact fit": exact_fit, "CP-Net": network_fit}  # the first is what the others are compared with


def fit_state(example, weights, sliding=False, solver=exact_fit, watch=None):
    """The answer to one place of the sliders: a FitState; bad input or a missing network becomes its message.

    weights: alpha, beta, gamma and, if folds shall count, delta. It depends on the arguments alone, not on where the
    sliders were before. solver: a callable like `exact_fit`.
    """
    start, problem = time.perf_counter(), example.sliding if sliding else example.problem
    try:
        weights = Weights(*weights)
        features = features_of(example, weights)
        fit = solver(problem, weights, features, watch)
    except (ValueError, ImportError) as error:  # LandmarkError, BeltramiError, SurfaceError, WeightsError; no torch
        return FitState(None, {}, time.perf_counter() - start, str(error))
    seconds = time.perf_counter() - start
    losses, factors = measured_losses(problem, weights, fit.mu, problem.samples @ fit.f), weights.factors
    if features is not None:
        losses["L_features"] = float((Dense(features, FINEST, 1.0).residual(fit.f) ** 2).sum())
        factors["L_features"] = weights.delta
    terms = {name: (losses[name], factor, factor * losses[name]) for name, factor in factors.items()}
    certificate = (
        "certified bijective"
        if fit.bijective
        else f"not bijective: {len(fit.flipped)} of {len(problem.faces)} triangles flipped"
    )
    return FitState(fit, terms, seconds, "; ".join([certificate, *fit.fallbacks]))


def features_of(example, weights):
    """The features that a fit is given, None where they have no weight; LandmarkError where there are none to weigh."""
    if weights.delta and example.features is None:
        raise LandmarkError(f"delta = {weights.delta:g}, but {example.name!r} has no folds; choose delta 0")
    return example.features if weights.delta else None


def describe(state):
    """A FitState in one sentence."""
    if state.fit is None:
        return f"No map: {state.message}"
    size = abs(state.fit.mu)
    return (
        f"landmark error {state.fit.landmark_error:.2e}, mean |μ| {size.mean():.3f}, largest {size.max():.3f}; "
        f"{state.message}; {1000 * state.seconds:.0f} ms"
    )


def gaps(states):
    """One sentence for each solver after the first that has a map: its loss beside that of the first."""
    (name, first), *others = states.items()
    loss = "L_CP + δ L_Features" if "L_features" in first.terms else "L_CP"
    return [
        f"{loss} of {other} is {state.loss / first.loss:.3g} times that of {name}"
        for other, state in others
        if state.fit is not None and first.fit is not None
    ]


def states_table(states):
    """States (dict solver name -> FitState) as HTML: a sentence each, their loss terms side by side, and the gaps."""
    shown = {name: state for name, state in states.items() if state.fit is not None}
    parts = [f"<p><b>{html.escape(name)}</b>: {html.escape(describe(state))}</p>" for name, state in states.items()]
    return "".join(
        [*parts, loss_table(shown) if shown else "", *(f"<p>{html.escape(gap)}.</p>" for gap in gaps(states))]
    )


def loss_table(states):
    """The loss terms of states that have a map, as they are and weighted, side by side as HTML."""
    rows = []
    for key in next(iter(states.values())).terms:
        terms, symbol = [state.terms[key] for state in states.values()], SYMBOLS[key]
        rows.append(
            [
                symbol,
                f"{terms[0][1]:.3g}",
                *(f"{number:.3g}" for value, _, product in terms for number in (value, product)),
            ]
        )
    rows.append(["sum", "", *(cell for state in states.values() for cell in ("", f"{state.loss:.3g}"))])
    head = ["term", "weight", *(cell for name in states for cell in (html.escape(name), "weighted"))]
    lines = [
        "".join(f"<th>{cell}</th>" for cell in head),
        *("".join(f"<td>{cell}</td>" for cell in row) for row in rows),
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return f"<table style='border-collapse: separate; border-spacing: 1.5em 0'>{body}</table>"


SYMBOLS = {
    "L_mu": "L<sub>μ</sub>",
    "L_grad_mu": "L<sub>∇μ</sub>",
    "L_Landmark": "L<sub>Landmark</sub>",
    "L_features": "L<sub>Features</sub>",
}


class Superseded(Exception):
    """Raised inside a calculation whose request is no longer the newest."""


class NewestOnly:
    """Answers requests in one worker thread, the newest only: an older one is stopped at its next step.

    work(*request, watch) returns the answer and calls watch() now and then; deliver(answer) shows it. A short pause
    lets the many events of one slider move pass first.
    """

    def __init__(self, work, deliver, pause=0.03):
        self.work, self.deliver, self.pause = work, deliver, pause
        self.lock, self.thread, self.generation, self.request = threading.Lock(), None, 0, None

    def submit(self, *request):
        with self.lock:
            self.request, self.generation = request, self.generation + 1
            if self.thread is None:
                self.thread = threading.Thread(target=self._run, daemon=True)
                self.thread.start()

    def wait(self):
        """Return once the newest request has been answered."""
        thread = self.thread
        if thread is not None:
            thread.join()

    def _run(self):
        while True:
            time.sleep(self.pause)
            with self.lock:
                request, generation = self.request, self.generation

            def watch(generation=generation):
                if generation != self.generation:
                    raise Superseded

            try:
                self.deliver(self.work(*request, watch=watch))
            except Superseded:
                continue
            with self.lock:
                if generation == self.generation:
                    self.thread = None
                    return


WIDE = {"width": "34em", "max_width": "calc(100% - 4px)"}  # within its margins, where the page is narrow


def power_slider(name, value, low, high, words):
    """A slider over powers of ten from 10^low to 10^high, with words on what it sets."""
    return ipywidgets.FloatLogSlider(
        value=value,
        min=low,
        max=high,
        step=0.1,
        description=name,
        tooltip=words,
        readout_format=".1e",
        layout=WIDE,
    )


class Tuner(ipywidgets.VBox):
    """Sliders for alpha, beta, gamma and delta over the fit of a choice of examples (list of `Example`).

    delta weighs folds, where the example has any, and is 0 at first: landmarks alone.

    solvers: name -> callable like `exact_fit`; their answers stand one below the other, compared with the first. The
    first answer is computed at once, so that a page without a kernel shows it; later ones come from a worker thread.
    """

    def __init__(self, examples, solvers=None):
        self.examples, self.solvers = {example.name: example for example in examples}, solvers or SOLVERS
        self.canvas, names = None, list(self.examples)
        self.problem = ipywidgets.Dropdown(options=names, value=names[0], description="problem", layout=WIDE)
        self.landmarks = ipywidgets.Dropdown(options=["points", "sliding"], description="landmarks", layout=WIDE)
        self.alpha = power_slider("α", Weights.alpha, -2, 2, "weight of |μ|²")
        self.beta = power_slider("β", Weights.beta, -4, 1, "weight of |∇μ|²")
        self.gamma = power_slider("γ", Weights.gamma, 0, 7, "weight of the landmark mismatch")
        self.delta = ipywidgets.SelectionSlider(
            options=DELTAS, description="δ", tooltip="weight of the folds' mismatch", layout=WIDE
        )
        self.problem.observe(self.offer_folds, "value")
        self.offer_folds()
        self.picture = ipywidgets.HTML()  # an Image widget could not carry the words for those who do not see it
        self.text = ipywidgets.HTML()
        controls = [self.problem, self.landmarks, self.alpha, self.beta, self.gamma, self.delta]
        super().__init__([*controls, self.picture, self.text])
        self.worker = NewestOnly(self.answer, self.show)
        self.show(self.answer(*self.setting()))
        for control in controls:
            control.observe(lambda change: self.worker.submit(*self.setting()), "value")

    def offer_folds(self, change=None):
        """Nothing to weigh, nothing to move: where an example has no folds, delta is 0 and its slider disabled."""
        self.delta.disabled = self.examples[self.problem.value].features is None
        if self.delta.disabled:
            self.delta.value = 0.0

    def setting(self):
        """What the controls say: (problem name, weights, sliding)."""
        weights = self.alpha.value, self.beta.value, self.gamma.value, self.delta.value
        return self.problem.value, weights, self.landmarks.value == "sliding"

    def answer(self, name, *setting, watch=None):
        """(picture, text) as HTML for one `setting`; an error becomes text without a picture, never a traceback."""
        try:
            example = self.examples[name]
            states = {solver: fit_state(example, *setting, solve, watch) for solver, solve in self.solvers.items()}
            if self.canvas is None or self.canvas.example is not example:
                self.canvas = Canvas(example, list(self.solvers))
            words = "; ".join([f"{solver}: {describe(state)}" for solver, state in states.items()] + gaps(states))
            alternative = f"Landmarks, deformed grid, |μ| and its histogram for {name}. {words}"
            return picture_html(self.canvas.draw(states), alternative), states_table(states)
        except Superseded:
            raise
        except Exception as error:
            return "", f"<p><b>Error</b>: {html.escape(f'{type(error).__name__}: {error}')}</p>"

    def show(self, answer):
        """Put an answer on the page; the text is announced to those who listen to it."""
        self.picture.value, self.text.value = answer[0], f'<div role="status">{answer[1]}</div>'
