"""Live tuning of the landmark fit: problems, the callback as a plain function, and a thin ipywidgets shell."""

import base64
import html
import io
import threading
import time
from dataclasses import dataclass

import ipywidgets
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.spatial import Delaunay

from .beltrami import signed_areas
from .curvature import AreaRadius, area_radius
from .disk import disk_conformal_map
from .diskmesh import square_disk
from .fit import LandmarkFit, fit_landmarks, sampling_matrix
from .landmarks import fundus_metric, fundus_path, sample_curve
from .plot import CURVE_STYLES, FLIPPED_COLOUR, disk_axes, disk_plot, lines_plot, square_lines
from .register import align, check_curves

RINGS = 12  # of the polar mesh that carries the unknowns: enough for 1,000 vertices, and quick
BINS = np.linspace(0, 1, 41)


@dataclass(frozen=True)
class Problem:
    """Landmarks to fit on a small disk mesh: name, z (V,), faces, moving and target (M,) complex, curve (M,) labels.

    radius: the `AreaRadius` to draw it with, if the unit disk would crowd it.
    """

    name: str
    z: np.ndarray
    faces: np.ndarray
    moving: np.ndarray
    target: np.ndarray
    curve: np.ndarray
    radius: AreaRadius | None = None


def example_problems():
    """Three problems on a mesh of 1,089 vertices: list of `Problem`."""
    z, faces = square_disk(32)
    t = np.linspace(-1, 1, 9)
    three = [0.55 + 0.25j * t, -0.35 + 0.35j + 0.2 * t * np.exp(0.7j), -0.1 - 0.5j + 0.3 * t]
    two = [0.25j + 0.55 * t, -0.25j + 0.55 * t]
    close = [0.08j + 0.4 * t, -0.08j + 0.4 * t]
    shift = 0.35 * (1 - t**2) * 0.55
    return [
        _problem("a smooth twist", z, faces, three, [p * np.exp(0.9j * (1 - abs(p) ** 2)) for p in three]),
        _problem("points spaced anew along two curves", z, faces, two, [two[0] + shift, two[1] - shift]),
        _problem("two neighbours pulled apart", z, faces, close, [close[0] + 0.25, close[1] - 0.25]),
    ]


def _problem(name, z, faces, moving, target, radius=None):
    labels = np.repeat(np.arange(len(moving)), [len(curve) for curve in moving])
    return Problem(name, z, faces, np.concatenate(moving), np.concatenate(target), labels, radius)


def cortex_problem(name, moving, control, curves, vertices=1000, points=5):
    """The landmarks of two cortical surfaces on about 1,000 vertices of the moving one: a `Problem`.

    curves as in `register`, sulci between endpoints by `fundus_path`. The landmarks, `points` a curve, come from the
    full surfaces; the mesh joins vertices spread evenly over the moving surface, at their places in its disk (Delaunay).
    """
    entries = check_curves(curves, moving, control)
    z_moving, z_control = disk_conformal_map(moving), disk_conformal_map(control)
    z_moving = align(moving, z_moving, control, z_control, entries)
    landmarks = []
    for surface, z, side in ((moving, z_moving, "moving"), (control, z_control, "control")):
        metric = fundus_metric(surface)
        paths = [fundus_path(surface, *entry[side], metric) if entry["detect"][side] else entry[side]
                 for entry in entries]
        landmarks.append([sample_curve(surface, path, points) @ z for path in paths])
    z = z_moving[spread_vertices(moving, vertices)]
    faces = Delaunay(np.stack([z.real, z.imag], axis=1)).simplices.astype(np.int64)
    faces = np.where((signed_areas(z, faces) < 0)[:, None], faces[:, ::-1], faces)
    return _problem(name, z, faces, *landmarks, area_radius(moving, z_moving))


def spread_vertices(surface, count):
    """Indices (count,) of vertices spread evenly in space: every other boundary vertex, then always the farthest."""
    chosen = list(surface.boundary[::2])
    distance = np.full(len(surface.vertices), np.inf)
    for place in range(count):
        if place == len(chosen):
            chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((surface.vertices - surface.vertices[chosen[place]]) ** 2).sum(1))
    return np.array(chosen)


@dataclass(frozen=True)
class FitState:
    """One solver's answer: fit (None where it failed), its weighted loss terms, seconds, and a message in words."""

    fit: LandmarkFit | None
    terms: dict
    seconds: float
    message: str


def exact_fit(problem, alpha, beta, gamma, sliding=False, watch=None):
    """`fit_landmarks` on a Problem."""
    return fit_landmarks(problem.z, problem.faces, problem.moving, problem.target, alpha, beta, gamma, problem.curve, sliding,
                         rings=RINGS, watch=watch)


SOLVERS = {"exact fit": exact_fit}  # name -> callable like `exact_fit`; a network's answer goes beside it here


def fit_state(problem, alpha, beta, gamma, sliding=False, solver=exact_fit, watch=None):
    """The answer to one place of the sliders: a FitState; bad input becomes its message.

    It depends on the arguments alone, not on where the sliders were before.
    """
    start = time.perf_counter()
    try:
        fit = solver(problem, alpha, beta, gamma, sliding, watch)
    except ValueError as error:  # LandmarkError, BeltramiError, SurfaceError, BijectivityError
        return FitState(None, {}, time.perf_counter() - start, str(error))
    weights = {"L_mu": alpha, "L_grad_mu": beta, "L_Landmark": gamma}
    terms = {name: (fit.losses[name], weight, weight * fit.losses[name]) for name, weight in weights.items()}
    certificate = ("certified bijective" if fit.bijective else
                   f"not bijective: {len(fit.flipped)} of {len(problem.faces)} triangles flipped")
    return FitState(fit, terms, time.perf_counter() - start, "; ".join([certificate, *fit.fallbacks]))


def describe(state):
    """A FitState in one sentence."""
    if state.fit is None:
        return f"No map: {state.message}"
    size = abs(state.fit.mu)
    return (f"landmark error {state.fit.landmark_error:.2e}, mean |μ| {size.mean():.3f}, largest {size.max():.3f}; "
            f"{state.message}; {1000 * state.seconds:.0f} ms")


def table(states):
    """States (dict solver name -> FitState) as HTML: the loss terms, and a sentence each."""
    symbols = {"L_mu": "L<sub>μ</sub>, weight α", "L_grad_mu": "L<sub>∇μ</sub>, weight β",
               "L_Landmark": "L<sub>Landmark</sub>, weight γ"}
    parts = []
    for name, state in states.items():
        parts.append(f"<p><b>{html.escape(name)}</b>: {html.escape(describe(state))}</p>")
        if state.fit is not None:
            cells = "".join(f"<tr><td>{symbols[key]}</td>" + "".join(f"<td>{value:.3g}</td>" for value in row) + "</tr>"
                            for key, row in state.terms.items())
            total = sum(row[-1] for row in state.terms.values())
            parts.append("<table style='border-collapse: separate; border-spacing: 1.5em 0'><tr><th>term</th><th>value</th><th>weight</th><th>product</th></tr>"
                         f"{cells}<tr><td>L<sub>CP</sub></td><td></td><td></td><td>{total:.3g}</td></tr></table>")
    return "".join(parts)


class Canvas:
    """The figure of a Problem, one row a solver, whose artists are made once and only moved afterwards."""

    def __init__(self, problem, solvers):
        self.problem = problem
        self.scale = problem.radius.to_image if problem.radius else np.asarray
        self.figure = Figure(figsize=(9.6, 2.8 * len(solvers)), dpi=100)
        axes = self.figure.subplots(len(solvers), 4, squeeze=False, gridspec_kw={
            "left": 0.005, "right": 0.985, "bottom": 0.18 / len(solvers), "top": 1 - 0.09 / len(solvers),
            "wspace": 0.03, "hspace": 0.35, "width_ratios": (1, 1, 1, 0.8)})
        lines = [problem.radius.from_image(line) if problem.radius else line for line in square_lines(15, 61)]
        self.ends = np.cumsum([len(line) for line in lines])[:-1]
        self.to_lines = sampling_matrix(problem.z, problem.faces, np.concatenate(lines))
        self.to_landmarks = sampling_matrix(problem.z, problem.faces, problem.moving)
        self.rows = {name: self._row(name, row) for name, row in zip(solvers, axes)}

    def _row(self, name, row):
        problem = self.problem
        for ax in row[:3]:
            disk_axes(ax)
        for ax, title in zip(row, (name, "deformed grid", "|μ| on the moving disk", "faces by |μ|")):
            ax.set_title(title, fontsize=10, y=1.0)  # a fixed height spares a search for free room at every draw
        starts = np.flatnonzero(np.diff(problem.curve)) + 1
        for points, style in ((problem.moving, "detected"), (problem.target, "target")):
            for curve in np.split(self.scale(points), starts):
                row[0].plot(curve.real, curve.imag, color=CURVE_STYLES[style]["color"], linewidth=1,
                            linestyle=CURVE_STYLES[style]["linestyle"])
        target = self.scale(problem.target)
        row[0].plot(target.real, target.imag, "s", color=CURVE_STYLES["target"]["color"], fillstyle="none",
                    markersize=6, label="target", zorder=6)
        points, = row[0].plot([], [], "o", color=CURVE_STYLES["registered"]["color"], markeredgecolor="black",
                              markersize=4, zorder=5, label="registered")
        row[0].legend(loc="upper center", bbox_to_anchor=(0.5, 0.03), ncols=2, frameon=False, fontsize=9)
        flipped = PolyCollection([], facecolor=FLIPPED_COLOUR, hatch="//", edgecolor="black", zorder=8)
        row[0].add_collection(flipped)
        grid = lines_plot(row[1], [problem.z[:2]], "#1F4E79")
        colours = disk_plot(row[2], self.scale(problem.z), problem.faces, np.zeros(len(problem.faces)), vmin=0, vmax=1)
        bar = row[2].inset_axes((0.2, -0.04, 0.6, 0.03))
        self.figure.colorbar(colours, cax=bar, orientation="horizontal", ticks=(0, 0.5, 1))
        bars = row[3].stairs(np.zeros(len(BINS) - 1), BINS, fill=True, color="#0072B2")
        row[3].set(xlabel="|μ|", xlim=(0, 1), yticks=[])
        return points, flipped, grid, colours, bars

    def draw(self, states):
        """PNG bytes of the states (dict solver name -> FitState)."""
        for name, state in states.items():
            artists = self.rows[name]
            for artist in artists:
                artist.set_visible(state.fit is not None)
            if state.fit is not None:
                self._update(*artists, state.fit)
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", pil_kwargs={"compress_level": 1})
        return buffer.getvalue()

    def _update(self, points, flipped, grid, colours, bars, fit):
        mapped, lines = (self.scale(points @ fit.f) for points in (self.to_landmarks, self.to_lines))
        points.set_data(mapped.real, mapped.imag)
        corners = self.scale(fit.f)[self.problem.faces[fit.flipped]]
        flipped.set_verts(np.stack([corners.real, corners.imag], axis=-1))
        grid.set_segments([np.stack([line.real, line.imag], axis=-1) for line in np.split(lines, self.ends)])
        colours.set_array(abs(fit.mu))
        counts = np.histogram(np.minimum(abs(fit.mu), 1), BINS)[0]
        bars.set_data(counts)
        bars.axes.set_ylim(0, 1.05 * counts.max())


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


class Tuner(ipywidgets.VBox):
    """Sliders for alpha, beta and gamma over the landmark fit of a choice of problems (list of `Problem`).

    solvers: name -> callable like `exact_fit`; their answers stand one below the other. The first answer is computed
    at once, so that a page without a kernel shows it; later ones come from a worker thread.
    """

    def __init__(self, problems, solvers=None):
        self.problems, self.solvers = {problem.name: problem for problem in problems}, solvers or SOLVERS
        self.canvas, names = None, list(self.problems)
        self.problem = ipywidgets.Dropdown(options=names, value=names[0], description="problem",
                                           layout={"width": "34em"})
        self.landmarks = ipywidgets.Dropdown(options=["points", "sliding"], description="landmarks",
                                             layout={"width": "34em"})
        self.alpha = self._slider("α", 1.0, -2, 2, "weight of |μ|²")
        self.beta = self._slider("β", 1e-2, -4, 1, "weight of |∇μ|²")
        self.gamma = self._slider("γ", 1e5, 0, 7, "weight of the landmark mismatch")
        self.picture = ipywidgets.HTML()  # an Image widget could not carry the words for those who do not see it
        self.text = ipywidgets.HTML()
        controls = [self.problem, self.landmarks, self.alpha, self.beta, self.gamma]
        super().__init__([*controls, self.picture, self.text])
        self.worker = NewestOnly(self.answer, self.show)
        self.show(self.answer(*self.setting()))
        for control in controls:
            control.observe(lambda change: self.worker.submit(*self.setting()), "value")

    @staticmethod
    def _slider(name, value, low, high, tooltip):
        return ipywidgets.FloatLogSlider(value=value, min=low, max=high, step=0.1, description=name, tooltip=tooltip,
                                         readout_format=".1e", layout={"width": "34em"})

    def setting(self):
        """What the controls say: (problem name, alpha, beta, gamma, sliding)."""
        return (self.problem.value, self.alpha.value, self.beta.value, self.gamma.value,
                self.landmarks.value == "sliding")

    def answer(self, name, alpha, beta, gamma, sliding, watch=None):
        """(picture, text) as HTML for one setting; an error becomes text without a picture, never a traceback."""
        try:
            problem = self.problems[name]
            states = {solver: fit_state(problem, alpha, beta, gamma, sliding, solve, watch)
                      for solver, solve in self.solvers.items()}
            if self.canvas is None or self.canvas.problem is not problem:
                self.canvas = Canvas(problem, list(self.solvers))
            words = "; ".join(f"{solver}: {describe(state)}" for solver, state in states.items())
            alternative = html.escape(f"Landmarks, deformed grid, |μ| and its histogram for {name}. {words}")
            data = base64.b64encode(self.canvas.draw(states)).decode()
            return f'<img alt="{alternative}" src="data:image/png;base64,{data}">', table(states)
        except Superseded:
            raise
        except Exception as error:  # noqa: BLE001 - whatever is raised must reach the reader, who then moves on
            return "", f"<p><b>Error</b>: {html.escape(f'{type(error).__name__}: {error}')}</p>"

    def show(self, answer):
        """Put an answer on the page; the text is announced to those who listen to it."""
        self.picture.value, self.text.value = answer[0], f'<div role="status">{answer[1]}</div>'
