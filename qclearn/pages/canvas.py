"""The figure of the live page: landmarks, deformed grid, |mu| and its histogram, one row a solver."""

import io

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..plane.diskmesh import sampling_matrix
from .plot import CURVE_STYLES, FLIPPED_COLOUR, disk_axes, disk_plot, lines_plot, square_lines

BINS = np.linspace(0, 1, 41)


class Canvas:
    """The figure of an `Example`, one row a solver, whose artists are made once and only moved afterwards."""

    def __init__(self, example, solvers):
        self.example, self.problem, radius = example, example.problem, example.radius
        self.scale = radius.to_image if radius else np.asarray
        self.figure = Figure(figsize=(9.6, 2.8 * len(solvers)), dpi=100)
        axes = self.figure.subplots(
            len(solvers),
            4,
            squeeze=False,
            gridspec_kw={
                "left": 0.005,
                "right": 0.985,
                "bottom": 0.18 / len(solvers),
                "top": 1 - 0.09 / len(solvers),
                "wspace": 0.03,
                "hspace": 0.35,
                "width_ratios": (1, 1, 1, 0.8),
            },
        )
        lines = [radius.from_image(line) if radius else line for line in square_lines(15, 61)]
        self.ends = np.cumsum([len(line) for line in lines])[:-1]
        self.to_lines = sampling_matrix(self.problem.z, self.problem.faces, np.concatenate(lines))
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
                row[0].plot(
                    curve.real,
                    curve.imag,
                    color=CURVE_STYLES[style]["color"],
                    linewidth=1,
                    linestyle=CURVE_STYLES[style]["linestyle"],
                )
        target = self.scale(problem.target)
        row[0].plot(
            target.real,
            target.imag,
            "s",
            color=CURVE_STYLES["target"]["color"],
            fillstyle="none",
            markersize=6,
            label="target",
            zorder=6,
        )
        (points,) = row[0].plot(
            [],
            [],
            "o",
            color=CURVE_STYLES["registered"]["color"],
            markeredgecolor="black",
            markersize=4,
            zorder=5,
            label="registered",
        )
        row[0].legend(loc="upper center", bbox_to_anchor=(0.5, 0.03), ncols=2, frameon=False, fontsize=9)
        flipped = PolyCollection([], facecolor=FLIPPED_COLOUR, hatch="//", edgecolor="black", zorder=8)
        row[0].add_collection(flipped)
        grid = lines_plot(row[1], [problem.z[:2]], "#1F4E79")
        colours = disk_plot(
            row[2], self.scale(problem.z), problem.faces, np.zeros(len(problem.faces)), cmap="YlGnBu", vmin=0, vmax=1
        )  # light where there is little to see: it is most of the disk
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
        mapped, lines = (self.scale(points @ fit.f) for points in (self.problem.samples, self.to_lines))
        points.set_data(mapped.real, mapped.imag)
        corners = self.scale(fit.f)[self.problem.faces[fit.flipped]]
        flipped.set_verts(np.stack([corners.real, corners.imag], axis=-1))
        grid.set_segments([np.stack([line.real, line.imag], axis=-1) for line in np.split(lines, self.ends)])
        colours.set_array(abs(fit.mu))
        counts = np.histogram(np.minimum(abs(fit.mu), 1), BINS)[0]
        bars.set_data(counts)
        bars.axes.set_ylim(0, 1.05 * counts.max())
