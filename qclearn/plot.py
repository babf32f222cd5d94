"""Figures: what is shown on the disk (matplotlib, no global state)."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from scipy import sparse

from .plane.checks import complex_numbers
from .plane.disk import Disk, pairs
from .plane.grids import thinned
from .surfaces.curvature import area_radius, grey_levels, mean_curvature

# The paper's colours, in shades that colour-blind readers tell apart; a dashed line is the second
# cue for a target.
CURVE_STYLES = {
    "detected": {"color": "#009E73", "linestyle": "-", "marker": "o"},
    "registered": {"color": "#F0E442", "linestyle": "-", "marker": "o"},
    "target": {"color": "#D62728", "linestyle": (0, (2.5, 1.5)), "marker": "s"},
}
DRAWN = 25_000  # vertices of a surface in the figure, at most: a pixel shows no more


def disk_axes(ax):
    """Prepare an Axes for the unit disk: equal scales, the circle, no ticks; returns it."""
    ax.set(aspect="equal", xlim=(-1.03, 1.03), ylim=(-1.03, 1.03))
    ax.axis("off")
    ax.add_patch(Circle((0, 0), 1, fill=False, edgecolor="0.4", linewidth=0.8, zorder=3))
    return ax


def disk_plot(ax, z, faces, values, cmap="viridis", vmin=None, vmax=None):
    """Colour a planar mesh z (V,) by values per vertex (V,) or per face (F,); the artist."""
    if len(values) == len(z) and np.asarray(values).dtype.kind in "biu":  # labels are not blended
        values = np.median(values[faces], axis=1)
    shading = "gouraud" if len(values) == len(z) else "flat"
    disk_axes(ax)
    look = {"shading": shading, "cmap": cmap, "vmin": vmin, "vmax": vmax}
    return ax.tripcolor(z.real, z.imag, faces, values, rasterized=True, **look)


def polar_lines(rings=10, spokes=24, samples=181):
    """Rings and spokes of the unit disk: list of complex curves."""
    turn = np.exp(2j * np.pi * np.linspace(0, 1, samples))
    along = np.linspace(0, 1, samples)
    circles = [r * turn for r in np.arange(1, rings + 1) / rings]
    return circles + [along * np.exp(2j * np.pi * k / spokes) for k in range(spokes)]


def map_curves(disk, f, curves):
    """Complex curves (list) of a `Disk` carried by the piecewise linear map f (V,), a list."""
    ends = np.cumsum([len(curve) for curve in curves])[:-1]
    return np.split(disk.interpolation(np.concatenate(curves)) @ f, ends)


def lines_plot(ax, curves, color):
    """Draw complex curves as thin lines; returns the LineCollection."""
    lines = LineCollection([pairs(curve) for curve in curves], colors=color, linewidths=0.6)
    return ax.add_collection(lines)


def curves_plot(ax, curves, style):
    """Draw complex curves in one of the `CURVE_STYLES`; a dark edge shows them on any ground."""
    look = CURVE_STYLES[style]
    color, dashes = look["color"], look["linestyle"]
    edge = {"color": "black", "linewidth": 2.6, "solid_capstyle": "round"}
    point = {"color": color, "markersize": 3.5, "markeredgecolor": "black", "markeredgewidth": 0.6}
    for curve in curves:
        ends = curve[[0, -1]]
        ax.plot(curve.real, curve.imag, linestyle=dashes, zorder=4, **edge)
        ax.plot(curve.real, curve.imag, linestyle=dashes, zorder=5, color=color, linewidth=1.7)
        ax.plot(ends.real, ends.imag, look["marker"], zorder=6, **point)


def curve_legend(ax, *styles, **labels):
    """A legend below the Axes for curve styles drawn in it; labels: words for a style's name."""
    looks = {style: CURVE_STYLES[style] | {"markeredgecolor": "black"} for style in styles}
    handles = [Line2D([], [], label=labels.get(style, style), **looks[style]) for style in styles]
    place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.02), "ncols": len(styles)}
    ax.legend(handles=handles, frameon=False, fontsize=8, handlelength=3, **place)


def mu_histogram(ax, mu, weights=None, bins=40):
    """Histogram of |mu| (F,) as shares, by face or by `weights` (F,), with the mean marked."""
    size = abs(complex_numbers(mu, "mu"))
    share = np.ones(len(size)) if weights is None else np.asarray(weights)
    share = share / share.sum()
    ax.hist(size, np.linspace(0, max(1, size.max()), bins + 1), weights=share, color="#0072B2")
    mean = size @ share
    ax.axvline(mean, color="black", linestyle="--", linewidth=1, label=f"mean {mean:.3f}")
    share_of = "share of faces" if weights is None else "share of area"
    ax.set(xlabel=r"$|\mu|$", ylabel=share_of, xlim=(0, None))
    ax.legend(frameon=False, fontsize=8)


def registration_figure(registration, moving, control):
    """The paper's figure of one `Registration`, its rows as columns: a Figure, ready for `savefig`.

    The moving disk's curvature with detected and target curves, without curves the control's; the
    mapped disk with its curves; the deformed grid; |mu| on the disk; its histogram. First row: unit
    disk. Second row: equal parts of the picture have equal moving area (a conformal disk crowds the
    cortex around its centre), histogram by area. With a radius, its map is a sixth column.
    """
    r, radius = registration, area_radius(moving, registration.disk_moving)
    disk = Disk(r.disk_moving, moving.faces)
    figure = Figure(figsize=(16, 6.8), dpi=110)
    margins = {"left": 0.02, "right": 0.955, "bottom": 0.11, "top": 0.88}
    margins |= {"wspace": 0.08, "hspace": 0.1}
    widths = (1, 1, 1, 1, 0.8) if r.uncertainty is None else (1, 1, 1, 1, 0.8, 1.6)
    rows = figure.subplots(2, len(widths), width_ratios=widths, gridspec_kw=margins)
    curves = [list(side) for side in zip(*r.curves.values())] or [[], []]
    some, faces, means = drawn_part(disk, moving)
    mu = abs(r.mu) if len(some) == len(disk.z) else means @ (disk.to_vertices @ abs(r.mu))
    grey = means @ grey_levels(mean_curvature(moving), moving.vertex_areas)
    start, first = r.disk_moving[some], (faces, grey)
    if not r.curves:
        shown, sides, around = drawn_part(Disk(r.disk_control, control.faces), control)
        first = sides, around @ grey_levels(mean_curvature(control), control.vertex_areas)
        start = r.disk_control[shown]
    scales = (np.asarray, np.asarray), (radius.to_image, radius.from_image)
    for axes, (scale, unscale) in zip(rows, scales):
        lines = [unscale(line) for line in polar_lines()]
        mapped = map_curves(disk, scale(r.disk_map), curves[0] + lines)
        targets = [scale(curve) for curve in curves[1]]
        before = (scale(start), *first), [scale(curve) for curve in curves[0]], "detected"
        after = (scale(r.disk_map[some]), faces, grey), mapped[: len(targets)], "registered"
        for ax, (picture, drawn, style) in zip(axes, (before, after)):
            disk_plot(ax, *picture, cmap="gray", vmin=-80, vmax=335)
            curves_plot(ax, drawn, style)
            curves_plot(ax, targets, "target")
        lines_plot(disk_axes(axes[2]), mapped[len(targets) :], "#1F4E79")
        colours = disk_plot(axes[3], scale(r.disk_moving[some]), faces, mu, vmin=0, vmax=1)
        if r.uncertainty is not None:
            mesh = scale(r.disk_moving[some]), faces, means @ r.uncertainty
            uncertainty = disk_plot(axes[5], *mesh, cmap="magma_r", vmin=0)
            figure.colorbar(uncertainty, ax=axes[5], shrink=0.6)
    mu_histogram(rows[0, 4], r.mu)
    mu_histogram(rows[1, 4], r.mu, moving.face_areas)
    _label_registration(figure, rows, colours, r.report)
    return figure


def drawn_part(disk, surface):
    """(drawn vertices (N,) of a surface, triangles, sparse (N, V) that averages values there)."""
    if len(disk.z) <= DRAWN:
        return np.arange(len(disk.z)), disk.faces, sparse.eye_array(len(disk.z))
    some, small = thinned(disk, None, DRAWN)
    means = small.interpolation(disk.z).T @ sparse.diags_array(surface.vertex_areas)
    return some, small.faces, sparse.diags_array(1 / np.maximum(means.sum(1), 1e-300)) @ means


def _label_registration(figure, rows, colours, report):
    titles = (
        "mean curvature, curves" if report["curves"] else "mean curvature of the control",
        "after the map" if report["curves"] else "of the moving surface, after the map",
        "polar grid after the map",
        r"$|\mu|$ on the moving disk",
        r"histogram of $|\mu|$",
        "90 % radius, mm",
    )
    for ax, title in zip(rows[0], titles):
        ax.set_title(title, fontsize=11)
    beside = {"rotation": "vertical", "va": "center", "ha": "right", "fontsize": 11}
    for ax, text in zip(rows[:, 0], ("unit disk", "radius by cortical area")):
        ax.text(-0.03, 0.5, text, transform=ax.transAxes, **beside)
    for ax, style in zip(rows[1], ("detected", "registered") if report["curves"] else ()):
        curve_legend(ax, style, "target", detected="moving")  # detected here, or given
    place = rows[1, 3].get_position()
    bar = figure.add_axes((place.x0 + 0.2 * place.width, 0.07, 0.6 * place.width, 0.018))
    figure.colorbar(colours, cax=bar, orientation="horizontal", ticks=(0, 0.5, 1))
    rows[0, 4].set_xlabel("")
    for ax in rows[:, 4]:
        ax.yaxis.tick_right()
        ax.yaxis.set_label_position("right")
    state = "certified bijective" if report["bijective"] else f"{report['flipped']} faces flipped"
    landmarks = "no landmarks"
    if report["curves"]:
        before, after, mm = (report[f"landmark_error{name}"] for name in ("_before", "", "_mm"))
        landmarks = f"landmark error {before:.2g} before, {after:.2g} after ({mm:.2g} mm)"
    figure.suptitle(rf"{landmarks}; mean $|\mu|$ {report['mean_abs_mu']:.3f}; {state}", fontsize=12)
