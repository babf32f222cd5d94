"""The training lab: a small network trained while the reader watches, with losses and weights of
the reader's own."""

import html
import os
import threading
import time

import ipywidgets
import numpy as np
from matplotlib.figure import Figure

from qcbook.figures import grid_plot, picture_html
from qclearn.plane.disk import Disk
from qclearn.registration.fit import exact_map

from .cells import drawn
from .examples import Example
from .fitstates import fit_state, sentences, states_figure
from .live import two_disks

WIDE = {"width": "34em", "max_width": "calc(100% - 4px)"}  # within its margins, where the page is narrow
EVERY = 0.7  # seconds between two pictures of the curves
WAITS = "The lab trains in JupyterLab, where a kernel runs. This is what {seconds:g} seconds of it look like."


def curves_figure(lesson):
    """A lesson's loss and its error on an unseen example, step by step: a Figure."""
    figure = Figure(figsize=(5.8, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for ax, name, title in zip(axes, ("loss", "unseen"), ("loss of the batch", lesson.what)):
        values = np.array([row[name] for row in lesson.history])
        ax.semilogy(np.arange(1, len(values) + 1), values, color="#0072B2")
        ax.set_title(title, fontsize=10)
    axes[1].set_xlabel("step")
    if lesson.least > 0:
        axes[1].axhline(lesson.least, color="#D55E00", linestyle="--", label="reference fit")
        axes[1].legend(frameon=False)
    return figure


def answer_of(lesson):
    """A lesson's answer to its unseen example beside the exact one: (picture, words as HTML)."""
    return {"CP-Net": landmarks_answer, "DBS-Net": map_answer}[lesson.name](lesson)


def landmarks_answer(lesson):
    """The network's coefficient through the exact solver beside the reference fit, drawn and measured."""

    def trained(problem, *_):
        return exact_map(problem, lesson.answer(problem.moving))

    example, given = Example("an unseen example", lesson.problem), lesson.weights
    weights = given.alpha, given.beta, given.gamma
    exact, answer = (fit_state(example, weights, solver=one) for one in (lesson.reference, trained))
    states = {"reference fit": exact, "CP-Net in training": answer}
    key = "<p>Green: the moving curves. Yellow: where the map takes them. Red, with squares: their targets.</p>"
    return states_figure(example, states), key + sentences(states)


def map_answer(lesson):
    """The network's map of a coefficient beside the exact one, as grids: how far they are apart,
    and folds."""
    f, z, faces = lesson.answer(lesson.mu), lesson.z, lesson.faces
    figure, axes = two_disks("exact map", "DBS-Net in training in red")
    for ax in axes:
        grid_plot(ax, z, faces, lesson.exact, color="#1F4E79" if ax is axes[0] else "0.7")
    grid_plot(axes[1], z, faces, f, color="#B22222")
    away, folds = abs(f - lesson.exact), len(Disk(f, faces).maybe_flipped)
    words = (
        f"<p>For an unseen coefficient the network's map is {away.mean():.3g} from the exact one on average, at most "
        f"{away.max():.3g}; {folds} of its {len(faces)} triangles are folded.</p>"
    )
    return figure, words


def power_slider(name, value, low, high, words):
    """A slider from 10^low to 10^high; `words` say what it sets."""
    told = {"description": name, "tooltip": words, "readout_format": ".1e"}
    return ipywidgets.FloatLogSlider(value=value, min=low, max=high, step=0.1, layout=WIDE, **told)


def image(figure, words):
    """A figure as HTML with a description."""
    png, width = drawn(figure)
    return picture_html(png, words, f' width={width} style="max-width:100%"')


class TrainingLab(ipywidgets.VBox):
    """Choose a network, its losses and their weights; start, stop and go on; see its answer beside
    the exact one.

    A thread trains the `lesson` in hand, `seconds` at a time; settings hold from the next start.
    """

    def __init__(self):
        self.lesson, self.thread, self.stopped = None, None, threading.Event()
        self.network = ipywidgets.Dropdown(options=["CP-Net", "DBS-Net"], description="network", layout=WIDE)
        self.alpha = power_slider("α", 1.0, -2, 2, "weight of |μ|²")
        self.beta = power_slider("β", 1e-2, -4, 1, "weight of |∇μ|²")
        self.gamma = power_slider("γ", 1e3, 0, 5, "weight of the landmark mismatch")
        equations = ["as corrected", "as printed"]
        self.equation = ipywidgets.Dropdown(options=equations, description="L_LBS", layout=WIDE)
        self.rho = power_slider("ρ", 1e-6, -9, -3, "weight of the boundary's angles")
        self.rate = power_slider("rate", 3e-3, -5, -1, "step of Adam")
        self.seconds = ipywidgets.IntSlider(value=10, min=1, max=60, description="seconds", layout=WIDE)
        labels = "Start anew", "Stop", "Go on"
        self.start, self.stop, self.go_on = (ipywidgets.Button(description=words) for words in labels)
        self.curves, self.picture, self.text = (ipywidgets.HTML() for _ in range(3))
        own = {"CP-Net": [self.alpha, self.beta, self.gamma], "DBS-Net": [self.equation, self.rho]}
        self.own = {name: ipywidgets.VBox(settings) for name, settings in own.items()}
        buttons = ipywidgets.HBox([self.start, self.stop, self.go_on])
        shown = [self.rate, self.seconds, buttons, self.text, self.curves, self.picture]
        super().__init__([self.network, *self.own.values(), *shown])
        self.network.observe(lambda change: self.choose(), "value")
        self.start.on_click(lambda _: self.begin())
        self.stop.on_click(lambda _: self.stopped.set())
        self.go_on.on_click(lambda _: self.train())
        self.choose()
        self.say("Choose losses and weights, guess where the curves will be after that many seconds, and start.")

    def choose(self):
        """Show the settings of the chosen network alone."""
        for name, box in self.own.items():
            box.layout.display = "" if name == self.network.value else "none"

    def say(self, words):
        """Show words; a screen reader speaks them."""
        self.text.value = f'<div role="status">{words}</div>'

    def begin(self):
        """Train a new network with the settings as they are."""
        from .lessons import lesson  # torch, which takes a second

        names = "alpha", "beta", "gamma", "equation", "rho", "rate"
        self.halt()
        self.lesson = lesson(self.network.value, {name: getattr(self, name).value for name in names})
        self.train()

    def train(self):
        """Train the network in hand for `seconds`, unless there is none or it trains already."""
        if self.lesson is None:
            self.say("There is no network yet: start one.")
        elif self.thread is None or not self.thread.is_alive():
            self.stopped.clear()
            self.thread = threading.Thread(target=self._train, daemon=True)
            self.thread.start()

    def halt(self):
        """Stop the training and wait for its end."""
        self.stopped.set()
        self.wait()

    def wait(self):
        """Return once no training runs."""
        if self.thread is not None:
            self.thread.join()

    def _train(self):
        lesson, shown = self.lesson, time.monotonic()

        def watch():
            nonlocal shown
            if time.monotonic() - shown > EVERY:
                self.show_curves(lesson)
                shown = time.monotonic()

        try:
            lesson.train(self.seconds.value, self.stopped.is_set, watch)
        except ValueError as error:  # TrainingError
            self.say(f"<b>Stopped</b>: {html.escape(str(error))}")
            return
        self.show_curves(lesson)
        picture, words = answer_of(lesson)
        self.picture.value = image(picture, "The network's answer beside the exact one, words below.")
        self.say(f"{len(lesson.history)} steps. {words}")

    def show_curves(self, lesson):
        """Draw the figures so far."""
        last = lesson.history[-1]
        words = f"After {len(lesson.history)} steps: loss {last['loss']:.3g}, {lesson.what} {last['unseen']:.3g}"
        self.curves.value = image(curves_figure(lesson), words)
        self.say(f"{words}.")


class LabPicture:
    """The lab on an executed page: the curves of a short run, and the answer after it."""

    def __init__(self, seconds=3.0):
        from .lessons import lesson

        self.seconds = seconds
        self.lesson = lesson("CP-Net", {"alpha": 1.0, "beta": 1e-2, "gamma": 1e3, "rate": 3e-3})
        self.lesson.train(seconds)

    def _repr_html_(self):
        picture, words = answer_of(self.lesson)
        waits = html.escape(WAITS.format(seconds=self.seconds))
        curves = image(curves_figure(self.lesson), "The loss and an unseen example over the steps of a short run.")
        answer = "Landmarks on the grid, |μ| and its histogram: reference fit on the left, network on the right."
        return f"<p>{waits}</p>{curves}{image(picture, answer)}{words}"


def training_lab():
    """The lab as a widget; while the book is made, a picture of a short run instead."""
    return LabPicture() if os.environ.get("QCLEARN_PAGES") == "static" else TrainingLab()
