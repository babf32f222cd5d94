"""Figures of the pages: deformed grids, fields of ellipses, a registration on four disks, hemispheres
with numbered sulci, pixels, pictures with their descriptions."""

import base64
import html

import numpy as np

from qclearn import plot
from qclearn.interrupts import signals_wait
from qclearn.io.fsaverage import demo_landmarks
from qclearn.plane import Disk
from qclearn.plane.disk import pairs
from qclearn.plot import curve_legend, curves_plot, disk_axes, disk_plot, lines_plot, map_curves, polar_lines
from qclearn.surfaces.curvature import area_radius, grey_levels, mean_curvature, parts_of_faces

with signals_wait():
    from matplotlib import rcParams
    from matplotlib.collections import EllipseCollection

FLIPPED_COLOUR = "#CC79A7"
YELLOW = plot.CURVE_STYLES["registered"]["color"]
NUMBER = {"fontsize": 9, "ha": "center", "va": "center", "bbox": {"boxstyle": "circle,pad=0.15", "fc": "white"}}


def square_lines(lines=17, samples=181):
    """Horizontal and vertical chords of the unit disk, `lines` each: list of complex curves."""
    offsets = np.linspace(-1, 1, lines + 2)[1:-1]
    chords = [np.linspace(-1, 1, samples) * np.sqrt(1 - c**2) + 1j * c for c in offsets]
    return chords + [chord.imag + 1j * chord.real for chord in chords]


def grid_plot(ax, z, faces, f, lines=None, color="#1F4E79"):
    """Draw grid lines of the disk (`polar_lines` by default) as the map f (V,) deforms them."""
    return lines_plot(disk_axes(ax), map_curves(Disk(z, faces), f, lines or polar_lines()), color)


def ellipse_field(ax, z, mu, size):
    """Draw the images of small circles at z (K,) under a map with mu (K,), up to f_z.

    `dz + mu conj(dz)`: long axis of length `size` at the angle `arg(mu) / 2`, axes' ratio `(1 +
    |mu|) / (1 - |mu|)`.
    """
    z, mu = np.asarray(z, complex), np.asarray(mu, complex)
    short = size * (1 - abs(mu)) / (1 + abs(mu))
    place = {"units": "xy", "offsets": pairs(z), "offset_transform": ax.transData}
    turns = np.degrees(np.angle(mu) / 2)
    sizes = np.full(len(z), size), short, turns
    return ax.add_collection(EllipseCollection(*sizes, facecolors="#0072B2", alpha=0.75, **place))


def mapped_legend(ax):
    """A legend below the Axes for mapped moving curves, before or after the registration, and their
    targets."""
    curve_legend(ax, "registered", "target", registered="moving, mapped")


def registration_disks(axes, registration, moving):
    """One `Registration` on four Axes: best Möbius map, registered, the deformed grid, |mu|.

    Equal parts of a picture have equal moving area. Returns the coloured artist of |mu|.
    """
    r, radius = registration, area_radius(moving, registration.disk_moving)
    curves, targets = (list(side) for side in zip(*r.curves.values()))
    lines = [radius.from_image(line) for line in polar_lines()]
    before, after = radius.to_image(r.disk_moving), radius.to_image(r.disk_map)
    mapped = map_curves(Disk(r.disk_moving, moving.faces), after, curves + lines)
    curvature = grey_levels(mean_curvature(moving), moving.vertex_areas)
    drawn = [radius.to_image(curve) for curve in curves], mapped[: len(curves)]
    titles = "best Möbius map only", "registered"
    for ax, z, registered, title in zip(axes, (before, after), drawn, titles):
        disk_plot(ax, z, moving.faces, curvature, cmap="gray", vmin=-80, vmax=335)
        curves_plot(ax, registered, "registered")
        curves_plot(ax, [radius.to_image(curve) for curve in targets], "target")
        numbers_plot(ax, [radius.to_image(curve) for curve in targets], r.curves)
        ax.set_title(title)
    mapped_legend(axes[0])
    lines_plot(disk_axes(axes[2]), mapped[len(curves) :], "#1F4E79")
    axes[2].set_title("polar grid after the map")
    axes[3].set_title(r"$|\mu|$")
    return disk_plot(axes[3], before, moving.faces, abs(r.mu), vmin=0)


def hemisphere_plot(ax, shape, values, disk, curves=(), beside=(), color=YELLOW, **colours):
    """Draw the outside of `shape`, a left hemisphere inflated, coloured by values (V,), with those of
    the curves in its `disk` that lie there, numbered from 1, and those `beside` them, yellow and without
    numbers. The front is on the left. Returns the coloured artist."""
    corners = shape.vertices[shape.faces]
    outward = -np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 0]
    seen = np.flatnonzero(outward > 0)
    faces = shape.faces[seen[np.argsort(-corners[seen, :, 0].mean(1))]]  # the nearest last
    x, y = -shape.vertices[:, 1], shape.vertices[:, 2]
    artist = ax.tripcolor(x, y, faces, values[faces].mean(1), rasterized=True, **colours)
    for number, curve in [*enumerate(curves, 1), *((None, curve) for curve in beside)]:
        place = disk.locate(curve)
        if outward[place[0]].mean() > 0:
            _, x, y = (disk.interpolate(shape.vertices, place) * [1, -1, 1]).T
            ax.plot(x, y, color=color if number else YELLOW, linewidth=2.5)
            if number:
                ax.text(x[len(x) // 2], y[len(y) // 2], str(number), **NUMBER)
    ax.set_aspect("equal")
    ax.axis("off")
    return artist


def picture_html(png, description, attributes=""):
    """PNG bytes as an element with a description."""
    data = base64.b64encode(png).decode()
    return f'<img alt="{html.escape(description)}" src="data:image/png;base64,{data}"{attributes}>'


def area_under_pixels(surface, z, radius, size=128):
    """Area of the surface under each pixel of its image, (size, size): each 64th of a face where
    its centroid falls."""
    points, areas = parts_of_faces(surface, z, 8)
    w = radius.to_image(points)
    edges = np.linspace(-1, 1, size + 1)
    return np.histogram2d(w.imag, w.real, [edges, edges], weights=areas)[0]


def resolved_share(pixel_areas, largest=25.0):
    """Share of the area that lies under pixels which cover at most `largest` (25 mm^2) each."""
    return float(pixel_areas[pixel_areas <= largest].sum() / pixel_areas.sum())


def sulcus_numbers(names):
    """The numbers that sulci have in all figures: their places among `demo_landmarks`."""
    known = [curve["name"] for curve in demo_landmarks()["curves"]]
    return [known.index(name) + 1 for name in names]


def numbers_plot(ax, curves, names=None):
    """Number complex curves of the disk (as `sulcus_numbers(names)`, or from 1), beside the middle of each, on the side
    with more room."""
    taken = np.concatenate(list(curves))
    box = {"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": "0.3", "linewidth": 0.6}
    numbers = range(1, len(curves) + 1) if names is None else sulcus_numbers(names)
    for number, curve in zip(numbers, curves, strict=True):
        middle, along = curve[len(curve) // 2], curve[-1] - curve[0]
        aside = 0.08j * along / abs(along)
        sides = sorted((middle + aside, middle - aside), key=abs)  # if both have room, the one away from the rim
        place = max(sides, key=lambda side: min(0.1, abs(taken - side).min()))
        taken = np.append(taken, place)
        ax.text(
            place.real,
            place.imag,
            str(number),
            fontsize=0.8 * rcParams["font.size"],
            ha="center",
            va="center",
            zorder=7,
            bbox=box,
        )


def sulci_in_words(names):
    """The names for a caption, with their numbers."""
    names = list(names)
    return ", ".join(f"{number} {name}" for number, name in sorted(zip(sulcus_numbers(names), names)))
