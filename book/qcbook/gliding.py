"""Curves on pictures of a surface: in panels, or gliding from the best Möbius map to the registration as
a slider moves; before it is moved, and without a script, they glide there once."""

import base64
import html
import io

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from qcbook.scenes import require_renderer, surface_scene
from qclearn.plane import Disk
from qclearn.plot import map_curves

SIZE = 1100, 720
STEPS = 6  # places of a curve that are computed; between them it glides straight on
SECONDS = 3
SLIDE = "const s=this.closest('figure').querySelector('svg');s.pauseAnimations();s.setCurrentTime(this.value)"
ENDS = f"this.closest('figure').querySelector('input').value={1 + SECONDS}"


def pixels(plotter, points):
    """Where points in space are on the picture: a list of (x, y), from its top left corner."""
    renderer, found = plotter.renderer, []
    for point in points:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        x, y, _ = renderer.GetDisplayPoint()
        found.append((x, SIZE[1] - y))
    return found


class View:
    """One picture of `shape`, a surface with the faces of the disk map `z`, and where points of the
    disk are on it: `picture` (a PIL image), `box` (left, top, width, height of the surface).

    `more` goes to `surface_scene`.
    """

    def __init__(self, z, shape, **more):
        require_renderer()
        self.disk, self.shape = Disk(z, shape.faces), shape
        self.plotter = surface_scene(shape, **more)
        self.plotter.off_screen, self.plotter.window_size = True, SIZE
        self.plotter.camera.zoom(1.6)
        self.picture = Image.fromarray(self.plotter.screenshot(transparent_background=True, return_img=True))
        outline = np.array(pixels(self.plotter, shape.vertices))
        self.box = [*(outline.min(0) - 10).round(), *(np.ptp(outline, axis=0) + 20).round()]

    def seen(self, places):
        """Places (steps, k) in the disk as pixels (steps, n, 2); points on the surface's far side are
        left out at all steps."""
        at = [self.disk.locate(curve) for curve in places]
        points = np.array([self.disk.interpolate(self.shape.vertices, one) for one in at])
        normals = np.array([self.disk.interpolate(self.plotter.meshes[0]["Normals"], one) for one in at])
        towards = np.array(self.plotter.camera.position) - points
        shown = ((normals * towards).sum(-1) > 0).all(0)
        return np.array([pixels(self.plotter, curve[shown]) for curve in points])


def view_figure(view, panels, columns=3, width=3.4):
    """A Matplotlib figure of a `View` with curves. panels: title -> pairs (colour, curves in the disk)."""
    left, top, across, down = view.box
    rows = -(-len(panels) // columns)
    size = columns * width, rows * (width * down / across + 0.3)
    fig, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for ax in axes.flat:
        ax.axis("off")
    for ax, (title, groups) in zip(axes.flat, panels.items()):
        ax.imshow(view.picture)
        for colour, curves in groups:
            for curve in curves:
                (places,) = view.seen([curve])
                if len(places):
                    ax.plot(*places.T, color="black", linewidth=3.6, solid_capstyle="round")
                    ax.plot(*places.T, color=colour, linewidth=2.6, solid_capstyle="round")
        ax.set(xlim=(left, left + across), ylim=(top + down, top), title=title)
    return fig


class Gliding:
    """A picture of a `Registration` on `shape`, a surface with the control's faces, and a slider.

    groups: (colour, curves in the disk, whether they move); those that stay are numbered from 1. words:
    what is to be seen. `more` goes to `surface_scene`.
    """

    def __init__(self, registration, shape, groups, words, **more):
        self.words, r = words, registration
        view = View(r.disk_control, shape, **more)
        buffer = io.BytesIO()
        view.picture.save(buffer, "WEBP", quality=88)
        self.picture, self.box = base64.b64encode(buffer.getvalue()).decode(), view.box
        self.lines, self.numbers = [], ""
        for colour, curves, moves in groups:
            ends = map_curves(Disk(r.disk_moving, r.faces_moving), r.disk_map, curves) if moves else curves
            for number, (start, end) in enumerate(zip(curves, ends), 1):
                places = [start + t * (end - start) for t in np.linspace(0, 1, STEPS if moves else 1)]
                lines = [" ".join(f"{x:.1f},{y:.1f}" for x, y in curve) for curve in view.seen(places)]
                self.lines.append((colour, lines))
                if not moves and lines[0]:
                    places = lines[0].split()
                    self.numbers += self.number(number, *map(float, places[len(places) // 2].split(",")))
        view.plotter.close()

    def _repr_html_(self):
        lines = "".join(map(self.line, self.lines))
        box, (width, height), end = " ".join(f"{x:g}" for x in self.box), SIZE, 1 + SECONDS
        return f"""<figure class="gliding" style="margin:0;max-width:36rem">
<svg viewBox="{box}" role="img" aria-label="{html.escape(self.words)}"
style="width:100%;max-height:max(16rem, calc(100vh - 26rem))">
<image width="{width}" height="{height}" href="data:image/webp;base64,{self.picture}"/>
<set attributeName="class" to="glided" begin="1s" dur="{SECONDS}s" onend="{ENDS}"/>
<g fill="none" stroke-width="5" stroke-linejoin="round" style="filter:drop-shadow(0 0 2px black)">{lines}</g>
{self.numbers}</svg>
<label style="display:flex;gap:0.8em;align-items:center;white-space:nowrap"><span>Möbius map</span>
<input type="range" min="1" max="{end}" step="0.01" value="1" oninput="{SLIDE}"
style="flex:1;min-width:0;min-height:2rem">
<span>registered</span></label></figure>"""

    @staticmethod
    def number(number, x, y):
        """A number in a white disk at a place."""
        x, y = f"{x:.0f}", f"{y:.0f}"
        return (
            f'<circle cx="{x}" cy="{y}" r="14" fill="white" stroke="black"/>'
            f'<text x="{x}" y="{y}" dy="0.35em" text-anchor="middle" font-size="20">{number}</text>'
        )

    @staticmethod
    def line(line):
        colour, places = line
        if not places[0]:
            return ""
        glide = f'begin="1s" dur="{SECONDS}s" fill="freeze" values="{";".join(places)}"' if len(places) > 1 else ""
        inside = glide and f'<animate attributeName="points" {glide}/>'
        return f'<polyline stroke="{colour}" points="{places[0]}">{inside}</polyline>'
